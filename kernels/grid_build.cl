// Builds the two-level grid: count, scan, fill. A triangle is referenced in every leaf cell whose box, grown
// by `pad`, it overlaps: Akenine-Moller 2001's separating axes, closed and with the rounding error on the
// side of overlap, so that no walk or intersector error within the pad can lose a triangle. BINNING chooses other
// tests, to show what each costs and loses.
#include "common.clh"
#include "walk.clh"

#define PADDED 0  // closed, pad and rounding on the side of overlap
#define CLOSED 1  // closed, as in textbooks: `pad` is 0, rounding falls as it may
#define OPEN 2    // strict inequalities: a wall on a cell plane overlaps no cell
#define BOX 3     // the triangle's bounding box alone, rounded down: a wall on a cell plane is in the cell above
#ifndef BINNING
#define BINNING PADDED
#endif

#if BINNING == PADDED
#define ROUNDING 0x1p-20f  // bounds the error of the test itself, for a span of 1
#else
#define ROUNDING 0.0f
#endif
#if BINNING == OPEN
#define not_above(a, b) ((a) < (b))
#else
#define not_above(a, b) ((a) <= (b))
#endif

typedef struct {
    int3 low, high;        // leaf positions, inclusive
    float3 base;           // what vertices and cells are measured from, to keep numbers small
    float3 half_size;      // half a cell and the pad
    float3 normal;
    float plane_low, plane_high;
    float3 edge[3];
    float axis_low[9], axis_high[9];
} Overlap;

inline float3 grid_vertex(global const float *triangles, int primitive, int corner, float3 lower, float3 inverse_cell)
{
    return (vload3(corner, triangles + (size_t)primitive * 9) - lower) * inverse_cell;
}

// Interval of a projection axis with coefficients (p, q) that a cell's centre must fall into.
inline void axis_interval(Overlap *o, int axis, float a, float b, float2 coefficients, float2 half_size, float span)
{
    const float slack = dot(coefficients, half_size) + (coefficients.x + coefficients.y) * span * ROUNDING;
    o->axis_low[axis] = min(a, b) - slack;
    o->axis_high[axis] = max(a, b) + slack;
#if BINNING == OPEN
    // An edge parallel to the box's leaves no axis, and nothing lies strictly between 0 and 0.
    if (coefficients.x + coefficients.y == 0.0f)
        o->axis_low[axis] = -INFINITY, o->axis_high[axis] = INFINITY;
#endif
}

// The first and last cell that an interval along each axis can overlap.
#if BINNING == CLOSED
inline int3 first_cell(float3 smallest) { return convert_int3_rtp(smallest) - 1; }
#else
inline int3 first_cell(float3 smallest) { return convert_int3_rtn(smallest); }
#endif
#if BINNING == OPEN
inline int3 last_cell(float3 largest) { return convert_int3_rtp(largest) - 1; }
#else
inline int3 last_cell(float3 largest) { return convert_int3_rtn(largest); }
#endif

inline Overlap overlap_setup(float3 a, float3 b, float3 c, float3 pad)
{
    Overlap o;
    const float3 smallest = min(a, min(b, c)), largest = max(a, max(b, c));
    o.low = clamp(first_cell(smallest - pad), (int3)(0), (int3)(RESOLUTION - 1));
    o.high = clamp(last_cell(largest + pad), (int3)(0), (int3)(RESOLUTION - 1));
    o.base = convert_float3(o.low);
    o.half_size = 0.5f + pad;
    const float3 h = o.half_size;
    a -= o.base, b -= o.base, c -= o.base;
    o.edge[0] = b - a, o.edge[1] = c - b, o.edge[2] = a - c;
    const float3 opposite[3] = {c, a, b}, start[3] = {a, b, c};
    const float3 reach = largest - smallest;
    const float span = max(reach.x, max(reach.y, reach.z)) + 2.0f;
    for (int i = 0; i < 3; ++i) {
        const float3 e = o.edge[i], p = start[i], q = opposite[i], m = fabs(e);
        axis_interval(&o, 3 * i + 0, e.z * p.y - e.y * p.z, e.z * q.y - e.y * q.z, m.zy, h.yz, span);
        axis_interval(&o, 3 * i + 1, e.x * p.z - e.z * p.x, e.x * q.z - e.z * q.x, m.xz, h.zx, span);
        axis_interval(&o, 3 * i + 2, e.y * p.x - e.x * p.y, e.y * q.x - e.x * q.y, m.yx, h.xy, span);
    }
    // A sliver's normal is mostly rounding: its slack grows with the product of the edges.
    o.normal = cross(o.edge[0], o.edge[1]);
    const float size = fabs(o.normal.x) + fabs(o.normal.y) + fabs(o.normal.z);
    const float slack = dot(fabs(o.normal), h) + size * span * ROUNDING + span * span * span * ROUNDING;
    const float distance = dot(o.normal, a);
    o.plane_low = distance - slack;
    o.plane_high = distance + slack;
    return o;
}

inline int overlaps(const Overlap *o, int3 cell)
{
    if (BINNING == BOX)
        return 1;
    const float3 centre = convert_float3(cell) - o->base + 0.5f;
    for (int i = 0; i < 3; ++i) {
        const float3 e = o->edge[i];
        const float x = e.z * centre.y - e.y * centre.z;
        const float y = e.x * centre.z - e.z * centre.x;
        const float z = e.y * centre.x - e.x * centre.y;
        if (!(not_above(o->axis_low[3 * i], x) && not_above(x, o->axis_high[3 * i]) &&
              not_above(o->axis_low[3 * i + 1], y) && not_above(y, o->axis_high[3 * i + 1]) &&
              not_above(o->axis_low[3 * i + 2], z) && not_above(z, o->axis_high[3 * i + 2])))
            return 0;
    }
    const float s = dot(o->normal, centre);
    return not_above(o->plane_low, s) && not_above(s, o->plane_high);
}

// The part of a row of cells along x that the triangle's plane can pass through, and a little more either side.
inline int2 row_range(const Overlap *o, int y, int z)
{
    if (BINNING == BOX)
        return (int2)(o->low.x, o->high.x);
    const float n = o->normal.x;
    const float rest = o->normal.y * ((float)y - o->base.y + 0.5f) + o->normal.z * ((float)z - o->base.z + 0.5f);
    const float p = (o->plane_low - rest) / n, q = (o->plane_high - rest) / n;
    if (!(fabs(p) < 0x1p20f && fabs(q) < 0x1p20f))
        return (int2)(o->low.x, o->high.x);
    const int first = o->low.x + (int)floor(min(p, q)) - 2, last = o->low.x + (int)ceil(max(p, q)) + 2;
    return (int2)(max(o->low.x, first), min(o->high.x, last));
}

inline int top_of(int3 cell)
{
    const int3 top = cell / LEAF_PER_TOP;
    return (top.z * TOP + top.y) * TOP + top.x;
}

#define FOR_EACH_OVERLAPPED_CELL(o, BODY)                                                                   \
    if (BINNING != OPEN && all(o.low == o.high)) {                                                                             \
        const int3 cell = o.low;                                                                            \
        BODY                                                                                                \
    } else                                                                                                  \
        for (int z = o.low.z; z <= o.high.z; ++z)                                                           \
            for (int y = o.low.y; y <= o.high.y; ++y) {                                                     \
                const int2 row = row_range(&o, y, z);                                                       \
                for (int x = row.x; x <= row.y; ++x) {                                                      \
                    const int3 cell = (int3)(x, y, z);                                                      \
                    if (overlaps(&o, cell)) {                                                               \
                        BODY                                                                                \
                    }                                                                                       \
                }                                                                                           \
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
                                    grid_vertex(triangles, primitive, 2, lower, inverse_cell), pad);

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
kernel void count_cells(const uint entries, global const uint2 *bricks, global uint *entry_cell, global int *cell_count)
{
    const uint i = get_global_id(0);
    if (i >= entries)
        return;
    const uint2 brick = bricks[entry_cell[i] / 32u];
    const int cell = cell_number(brick.x, brick.y, entry_cell[i] % 32u);
    entry_cell[i] = cell;
    atomic_inc(cell_count + cell);
}

kernel void fill_cells(const uint entries, global const uint *entry_cell, global const int *entry_primitive,
                       global int *cursor, global int *references)
{
    const uint i = get_global_id(0);
    if (i < entries)
        references[atomic_inc(cursor + entry_cell[i])] = entry_primitive[i];
}

inline void sift_down(global int *heap, int root, int count)
{
    const int value = heap[root];
    for (int child = 2 * root + 1; child < count; child = 2 * root + 1) {
        if (child + 1 < count && heap[child + 1] > heap[child])
            child++;
        if (heap[child] <= value)
            break;
        heap[root] = heap[child];
        root = child;
    }
    heap[root] = value;
}

// Ascending order in each cell (heap sort): the grid's bytes do not depend on the order of the atomics, and
// among equal t the first triangle tested is the lowest.
kernel void sort_cells(const int cells, global const int *cell_start, global int *references)
{
    const int cell = get_global_id(0);
    if (cell >= cells)
        return;
    global int *heap = references + cell_start[cell];
    const int count = cell_start[cell + 1] - cell_start[cell];
    for (int root = count / 2 - 1; root >= 0; --root)
        sift_down(heap, root, count);
    for (int last = count - 1; last > 0; --last) {
        const int largest = heap[0];
        heap[0] = heap[last];
        heap[last] = largest;
        sift_down(heap, 0, last);
    }
}
