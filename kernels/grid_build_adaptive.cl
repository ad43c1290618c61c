// Builds the grid whose second level follows the scene: triangles are counted and listed by top cell, then, each top
// cell having its level, by leaf cell. Built with ADAPTIVE.
#include "common.clh"
#include "walk.clh"
#include "overlap.clh"

#define TRIANGLE_ARGUMENTS                                                                                  \
    global const float *triangles, const float3 lower, const float3 inverse_cell, const float3 pad, const int4 shape

// `shift`: each cell is 2^shift positions of the finest level wide; scaling by that is exact. `first` and `last` in
// such cells.
inline Overlap overlap_at(TRIANGLE_ARGUMENTS, int primitive, int shift, int3 first, int3 last)
{
    const float scale = ldexp(1.0f, -shift);
    return overlap_setup(grid_vertex(triangles, primitive, 0, lower, inverse_cell) * scale,
                         grid_vertex(triangles, primitive, 1, lower, inverse_cell) * scale,
                         grid_vertex(triangles, primitive, 2, lower, inverse_cell) * scale, pad * scale, first, last);
}

#define LOAD_TOP_OVERLAP                                                                                    \
    const int i = get_global_id(0);                                                                         \
    if (i >= active_count)                                                                                  \
        return;                                                                                             \
    const int primitive = active[i];                                                                        \
    const Overlap o = overlap_at(triangles, lower, inverse_cell, pad, shape, primitive, shape.w, (int3)(0), \
                                 shape.xyz - 1);

// Top cells that each triangle overlaps.
kernel void count_top(const int active_count, global const int *active, TRIANGLE_ARGUMENTS, global uint *entry_count)
{
    LOAD_TOP_OVERLAP
    uint count = 0;
    FOR_EACH_OVERLAPPED_CELL(o, count++;)
    entry_count[i] = count;
}

// One entry a triangle and top cell, and the triangles of each top cell counted.
kernel void emit_top(const int active_count, global const int *active, TRIANGLE_ARGUMENTS,
                     global const uint *entry_start, global int *entry_top, global int *entry_primitive,
                     global int *top_count)
{
    LOAD_TOP_OVERLAP
    uint slot = entry_start[i];
    FOR_EACH_OVERLAPPED_CELL(o, {
        const int top = (cell.z * shape.y + cell.y) * shape.x + cell.x;
        atomic_inc(top_count + top);
        entry_top[slot] = top;
        entry_primitive[slot] = primitive;
        slot++;
    })
}

// Chebyshev distance to the next used top cell, one axis a launch: `length` cells `stride` apart. `from` holds the
// distance along the axes done before, 0 where a cell is used.
kernel void spread_distance(const int cells, const int length, const int stride, global const int *from,
                            global int *to)
{
    const int i = get_global_id(0);
    if (i >= cells)
        return;
    const int place = i / stride % length;
    int nearest = from[i];
    for (int step = 1; step < nearest && step < length; ++step) {
        if (place >= step)
            nearest = min(nearest, max(step, from[i - step * stride]));
        if (place + step < length)
            nearest = min(nearest, max(step, from[i + step * stride]));
    }
    to[i] = nearest;
}

#define LOAD_LEAF_OVERLAP                                                                                   \
    const uint i = get_global_id(0);                                                                        \
    if (i >= entries)                                                                                       \
        return;                                                                                             \
    const int top = entry_top[i], primitive = entry_primitive[i];                                           \
    const int level = top_cells[top] & 7;                                                                   \
    const int3 place = (int3)(top % shape.x, top / shape.x % shape.y, top / shape.x / shape.y);             \
    const int3 first = place << level;                                                                      \
    const Overlap o = overlap_at(triangles, lower, inverse_cell, pad, shape, primitive, shape.w - level, first, \
                                 first + (1 << level) - 1);

// Leaf cells that the triangle of each entry overlaps in its top cell.
kernel void count_leaves(const uint entries, global const int *entry_top, global const int *entry_primitive,
                         TRIANGLE_ARGUMENTS, global const int *top_cells, global uint *reference_count)
{
    LOAD_LEAF_OVERLAP
    uint count = 0;
    FOR_EACH_OVERLAPPED_CELL(o, count++;)
    reference_count[i] = count;
}

// One entry a reference: brick * 32 + bit, and the triangle; sets the occupancy bits.
kernel void emit_leaves(const uint entries, global const int *entry_top, global const int *entry_primitive,
                        TRIANGLE_ARGUMENTS, global const int *top_cells, global const uint *reference_start,
                        global uint *occupancy, global uint *reference_cell, global int *reference_primitive)
{
    LOAD_LEAF_OVERLAP
    uint slot = reference_start[i];
    FOR_EACH_OVERLAPPED_CELL(o, {
        const int3 inner = cell - first;
        const uint brick = (top_cells[top] >> 3) + brick_in_block(level, inner.x, inner.y, inner.z);
        const uint bit = bit_of(inner.x, inner.y, inner.z);
        atomic_or(occupancy + brick, 1u << bit);
        reference_cell[slot] = brick * 32u + bit;
        reference_primitive[slot] = primitive;
        slot++;
    })
}
