// Builds the grid whose second level follows the scene: triangles are counted and listed by top cell, then, each top
// cell having its level, by leaf cell. Built with ADAPTIVE.
#include "common.clh"
#include "structures/walk.clh"
#include "structures/overlap.clh"

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

// Cells from each top cell to the next used one, or to the grid's border, in the cube ahead along an octant, at most
// LONGEST_EDGE: one axis a launch, `length` cells `stride` apart, looking `towards` +1 or -1. `from` holds the
// distance along the axes done before, 0 where a cell is used.
kernel void spread_distance(const int cells, const int length, const int stride, const int towards,
                            global const int *from, global int *to)
{
    const int i = get_global_id(0);
    if (i >= cells)
        return;
    const int place = i / stride % length, border = towards > 0 ? length - place : place + 1;
    int nearest = min(from[i], min(border, LONGEST_EDGE));
    for (int step = 1; step < nearest; ++step)
        nearest = min(nearest, max(step, from[i + step * towards * stride]));
    to[i] = nearest;
}

// Writes an octant's code into the empty top cells.
kernel void code_top_cells(const int cells, const int octant, global const int *distance, global int *top_cells)
{
    const int i = get_global_id(0);
    if (i < cells && top_cells[i] < 0)
        top_cells[i] |= edge_code(distance[i]) << 3 * octant;
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

// One entry a reference: leaf cell and triangle; marks the leaf cells that hold any.
kernel void emit_leaves(const uint entries, global const int *entry_top, global const int *entry_primitive,
                        TRIANGLE_ARGUMENTS, global const int *top_cells, global const uint *reference_start,
                        global int *leaves, global uint *reference_leaf, global int *reference_primitive)
{
    LOAD_LEAF_OVERLAP
    uint slot = reference_start[i];
    FOR_EACH_OVERLAPPED_CELL(o, {
        const int3 inner = cell - first;
        const int leaf = (top_cells[top] >> 3) + (((inner.z << level) + inner.y) << level) + inner.x;
        leaves[leaf] = 1;
        reference_leaf[slot] = leaf;
        reference_primitive[slot] = primitive;
        slot++;
    })
}

// Turns an entry's leaf cell into its number among the non-empty ones, and counts.
kernel void count_cells(const uint entries, global const int *leaves, global uint *entry_cell, global int *cell_count)
{
    const uint i = get_global_id(0);
    if (i >= entries)
        return;
    const int cell = leaves[entry_cell[i]];
    entry_cell[i] = cell;
    atomic_inc(cell_count + cell);
}

// Edge of the largest empty cube that starts at a leaf cell and goes on in a direction of `step` (-1 or +1 each):
// one more than the least of its seven neighbours there, which must be known.
inline int cube_edge(global const uchar *edges, int3 place, int3 step, int across)
{
    const int3 next = place + step;
    if (any(next < 0) || any(next >= across))
        return 1;
    const int x = step.x, y = step.y * across, z = step.z * across * across;
    global const uchar *at = edges + (place.z * across + place.y) * across + place.x;
    const int planar = min((int)at[x], min((int)at[y], (int)at[x + y]));
    return 1 + min(planar, min(min((int)at[z], (int)at[z + x]), min((int)at[z + y], (int)at[z + x + y])));
}

// Writes the codes of all octants into the empty leaf cells of a top cell, a work-item each. `edges`: room for a byte
// a leaf cell.
kernel void code_leaves(const int cells, global const int *top_cells, global int *leaves, global uchar *edges)
{
    const int top = get_global_id(0);
    if (top >= cells || top_cells[top] < 0)
        return;
    const int level = top_cells[top] & 7, first = top_cells[top] >> 3, across = 1 << level, count = 1 << 3 * level;
    for (int octant = 0; octant < 8; ++octant) {
        const int3 step = (int3)(octant & 1 ? 1 : -1, octant & 2 ? 1 : -1, octant & 4 ? 1 : -1);
        for (int n = 0; n < count; ++n) {
            // Cells farther along the octant come first.
            const int3 place = (int3)(n & (across - 1), n >> level & (across - 1), n >> 2 * level);
            const int3 here = select(place, across - 1 - place, step > 0);
            const int i = first + (((here.z << level) + here.y) << level) + here.x;
            edges[i] = leaves[i] < 0 ? cube_edge(edges + first, here, step, across) : 0;
            if (leaves[i] < 0)
                leaves[i] |= edge_code(edges[i]) << 3 * octant;
        }
    }
}

// A convex polygon, of at most the nine corners that a triangle cut by six planes has.
typedef struct {
    float3 corner[9];
    int corners;
} Polygon;

inline float component(float3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

// Cuts off what lies below a plane across an axis, or above it with `side` -1.
inline void cut(Polygon *p, int axis, float plane, float side)
{
    Polygon kept;
    kept.corners = 0;
    for (int i = 0; i < p->corners; ++i) {
        const float3 from = p->corner[i == 0 ? p->corners - 1 : i - 1], to = p->corner[i];
        const float before = side * (component(from, axis) - plane), after = side * (component(to, axis) - plane);
        if ((before < 0.0f) != (after < 0.0f) && kept.corners < 9)
            kept.corner[kept.corners++] = from + (to - from) * (before / (before - after));
        if (after >= 0.0f && kept.corners < 9)
            kept.corner[kept.corners++] = to;
    }
    *p = kept;
}

// Grows a box by the part of a triangle that lies in a cell, in places of it. The cell and the result are larger by
// `slack`, which covers the rounding of the cuts.
inline void grow_box(float3 *low, float3 *high, const float3 *v, float3 slack)
{
    const float3 edge = (float)BOX_PLACES + slack;
    const float3 smallest = min(v[0], min(v[1], v[2])), largest = max(v[0], max(v[1], v[2]));
    float3 from = max(smallest, -slack), to = min(largest, edge);
    if (all(from - slack >= *low) && all(to + slack <= *high))
        return;
    if (any(smallest < -slack) || any(largest > edge)) {
        Polygon p = {{v[0], v[1], v[2]}, 3};
        for (int axis = 0; axis < 3; ++axis) {
            cut(&p, axis, -component(slack, axis), 1.0f);
            cut(&p, axis, component(edge, axis), -1.0f);
        }
        // Where rounding leaves nothing, the bounds have to do.
        for (int i = 0; i < p.corners; ++i) {
            from = i == 0 ? p.corner[i] : min(from, p.corner[i]);
            to = i == 0 ? p.corner[i] : max(to, p.corner[i]);
        }
    }
    *low = min(*low, from - slack);
    *high = max(*high, to + slack);
}

// Writes the leaf cells as the walk reads them: each with the box around what lies in it. A work-item a top cell.
kernel void bound_cells(const int cells, TRIANGLE_ARGUMENTS, global const int *top_cells, global const int *leaves,
                        global const int *cell_start, global const int *references, global int2 *walked)
{
    const int top = get_global_id(0);
    if (top >= cells || top_cells[top] < 0)
        return;
    const int level = top_cells[top] & 7, first = top_cells[top] >> 3, count = 1 << 3 * level;
    const int shift = shape.w - level;
    const int3 place = (int3)(top % shape.x, top / shape.x % shape.y, top / shape.x / shape.y) << level;
    const float scale = ldexp(1.0f, BOX_BITS - shift);
    for (int n = 0; n < count; ++n) {
        const int cell = leaves[first + n], across = (1 << level) - 1;
        walked[first + n] = (int2)(cell, 0);
        if (cell < 0)
            continue;
        const int3 inner = (int3)(n & across, n >> level & across, n >> 2 * level);
        const float3 corner = convert_float3((place + inner) << shift);
        float3 low = BOX_PLACES, high = 0;
        for (int r = cell_start[cell]; r < cell_start[cell + 1]; ++r) {
            float3 v[3];
            for (int i = 0; i < 3; ++i)
                v[i] = (grid_vertex(triangles, references[r], i, lower, inverse_cell) - corner) * scale;
            grow_box(&low, &high, v, pad * scale);
        }
        const int3 from = clamp(convert_int3_rtn(low), 0, BOX_PLACES - 1);
        const int3 to = clamp(convert_int3_rtp(high) - 1, from, BOX_PLACES - 1);
        walked[first + n].y = from.x | from.y << BOX_BITS | from.z << 2 * BOX_BITS | to.x << 3 * BOX_BITS |
                              to.y << 4 * BOX_BITS | to.z << 5 * BOX_BITS;
    }
}
