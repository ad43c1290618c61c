// Writes down the leaf cells that rays walk through, for the check of the walk.
#include "common.clh"
#include "structures/walk.clh"

// `visited`: room for `slots` cells a ray, filled with the linear positions of its non-empty leaf cells, in order;
// `found` their number, `steps` those taken, each at most `slots`.
kernel void walk_cells(const int count, global const float *origins, global const float *directions,
                       GRID_ARGUMENTS, const int slots, global int *visited, global int *found, global int *steps)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Grid grid = GRID_VALUES;
    const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), INFINITY);
    Walk w = walk_setup(grid, ray);
    const ulong position = walk_entry(&w, grid, INFINITY);
    found[i] = steps[i] = 0;
    if (position == LEFT_GRID)
        return;
    walk_to(&w, position);
    int cells = 0, step = 0;
    for (; step < slots && walk_inside(&w, grid_resolution(grid)); ++step) {
        const int here = (w.z.cell * RESOLUTION + w.y.cell) * RESOLUTION + w.x.cell;
        if (walk_step(&w, grid, 1) != NO_CELL)
            visited[(size_t)i * slots + cells++] = here;
    }
    found[i] = cells;
    steps[i] = step;
}
