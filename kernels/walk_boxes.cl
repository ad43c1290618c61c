// Writes down the boxes that rays walk through in an adaptive grid, for the check of the walk. Built with ADAPTIVE.
#include "common.clh"
#include "walk.clh"

// `boxes`: room for `slots` boxes a ray: low corner and size in positions of the finest level, then the number of the
// leaf cell or NO_CELL; int32[5]. `found`: those taken, at most `slots`.
kernel void walk_boxes(const int count, global const float *origins, global const float *directions, GRID_ARGUMENTS,
                       const int slots, global int *boxes, global int *found)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Grid grid = GRID_VALUES;
    const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), INFINITY);
    Walk w = walk_setup(grid, ray);
    const ulong position = walk_entry(&w, grid, INFINITY);
    found[i] = 0;
    if (position == LEFT_GRID)
        return;
    walk_to(&w, position);
    int step = 0;
    for (; step < slots && walk_inside(&w, grid_resolution(grid)); ++step) {
        global int *box = boxes + ((size_t)i * slots + step) * 5;
        const int3 here = (int3)(w.x.cell, w.y.cell, w.z.cell), top = here >> grid.shape.w;
        const int entry = grid.top_cells[(top.z * grid.shape.y + top.y) * grid.shape.x + top.x];
        const int shift = entry < 0 ? grid.shape.w : grid.shape.w - (entry & 7), before = entry < 0 ? -entry - 1 : 0;
        const int3 low = ((here >> shift) - before) << shift;
        box[0] = low.x, box[1] = low.y, box[2] = low.z, box[3] = (2 * before + 1) << shift;
        box[4] = walk_step(&w, grid, 1);
    }
    found[i] = step;
}
