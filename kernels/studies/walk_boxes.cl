// Writes down the boxes that rays walk through in an adaptive grid, for the check of the walk. Built with ADAPTIVE.
#include "common.clh"
#include "structures/walk.clh"

// `boxes`: room for `slots` boxes a ray: low corner and size in positions of the finest level, the number of the leaf
// cell or NO_CELL, and what the step returned; int32[6]. `found`: those taken, at most `slots`.
kernel void walk_boxes(const int count, global const float *origins, global const float *directions, STRUCTURE_ARGUMENTS,
                       const int slots, global int *boxes, global int *found)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Structure structure = STRUCTURE_VALUES;
    const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), INFINITY);
    Walk w = walk_of(structure, ray);
    const ulong position = walk_entry(&w, structure, INFINITY);
    found[i] = 0;
    if (position == LEFT)
        return;
    walk_to(&w, position);
    int step = 0;
    for (; step < slots && walk_inside(&w, structure); ++step) {
        global int *box = boxes + ((size_t)i * slots + step) * 6;
        const Cube c = cube_ahead(&w, structure, 1);
        box[0] = (c.x - (w.x.ahead ? 0 : c.edge - 1)) << c.shift;
        box[1] = (c.y - (w.y.ahead ? 0 : c.edge - 1)) << c.shift;
        box[2] = (c.z - (w.z.ahead ? 0 : c.edge - 1)) << c.shift;
        box[3] = c.edge << c.shift;
        box[4] = max(c.entry, NO_CELL);
        box[5] = walk_step(&w, structure, 1);
    }
    found[i] = step;
}
