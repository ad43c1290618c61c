// Writes down the leaf cells that rays walk through, for the check of the walk.
#include "common.clh"
#include "structures/walk.clh"

// `visited`: room for `slots` cells a ray, filled with the linear positions of its non-empty leaf cells, in order;
// `found` their number, `steps` those taken, each at most `slots`.
kernel void walk_cells(const int count, global const float *origins, global const float *directions,
                       STRUCTURE_ARGUMENTS, const int slots, global int *visited, global int *found, global int *steps)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Structure structure = STRUCTURE_VALUES;
    const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), INFINITY);
    Walk w = walk_of(structure, ray);
    const ulong position = walk_entry(&w, structure, INFINITY);
    found[i] = steps[i] = 0;
    if (position == LEFT)
        return;
    walk_to(&w, position);
    int cells = 0, step = 0;
    for (; step < slots && walk_inside(&w, structure); ++step) {
        const int here = (w.z.cell * RESOLUTION + w.y.cell) * RESOLUTION + w.x.cell;
        if (walk_step(&w, structure, 1) != NO_CELL)
            visited[(size_t)i * slots + cells++] = here;
    }
    found[i] = cells;
    steps[i] = step;
}
