// Builds the grid of one leaf resolution: count, scan, fill. A triangle is referenced in every leaf cell that it
// overlaps.
#include "common.clh"
#include "structures/walk.clh"
#include "structures/overlap.clh"

inline int top_of(int3 cell)
{
    const int3 top = cell / LEAF_PER_TOP;
    return (top.z * TOP + top.y) * TOP + top.x;
}

#define TRIANGLE_ARGUMENTS                                                                                  \
    const int active_count, global const int *active, global const float *triangles, const float3 lower,    \
        const float3 inverse_cell, const float3 pad
#define LOAD_OVERLAP                                                                                        \
    const int i = get_global_id(0);                                                                         \
    if (i >= active_count)                                                                                  \
        return;                                                                                             \
    const int primitive = active[i];                                                                        \
    const Overlap o = overlap_setup(grid_vertex(triangles, primitive, 0, lower, inverse_cell),              \
                                    grid_vertex(triangles, primitive, 1, lower, inverse_cell),              \
                                    grid_vertex(triangles, primitive, 2, lower, inverse_cell), pad,       \
                                    (int3)(0), (int3)(RESOLUTION - 1));

// References of each triangle, and which top cells hold any.
kernel void count_references(TRIANGLE_ARGUMENTS, global uint *reference_count, global int *top_used)
{
    LOAD_OVERLAP
    uint count = 0;
    FOR_EACH_OVERLAPPED_CELL(o, count++; top_used[top_of(cell)] = 1;)
    reference_count[i] = count;
}

// One entry a reference: brick * 32 + bit, and the triangle; sets the occupancy bits.
kernel void emit_references(TRIANGLE_ARGUMENTS, global const uint *reference_start, global const int *top_block,
                            global uint *occupancy, global uint *entry_cell, global int *entry_primitive)
{
    LOAD_OVERLAP
    uint slot = reference_start[i];
    FOR_EACH_OVERLAPPED_CELL(o, {
        const int3 inner = cell - (cell / LEAF_PER_TOP) * LEAF_PER_TOP;
        const uint brick = brick_of(top_block[top_of(cell)], inner.x, inner.y, inner.z);
        const uint bit = bit_of(inner.x, inner.y, inner.z);
        atomic_or(occupancy + brick, 1u << bit);
        entry_cell[slot] = brick * 32u + bit;
        entry_primitive[slot] = primitive;
        slot++;
    })
}

// Turns an entry's brick and bit into the number of its non-empty cell, and counts.
kernel void count_cells(const uint entries, global const uint2 *bricks, global uint *entry_cell,
                        global int *cell_count)
{
    const uint i = get_global_id(0);
    if (i >= entries)
        return;
    const uint2 brick = bricks[entry_cell[i] / 32u];
    const int cell = cell_number(brick.x, brick.y, entry_cell[i] % 32u);
    entry_cell[i] = cell;
    atomic_inc(cell_count + cell);
}
