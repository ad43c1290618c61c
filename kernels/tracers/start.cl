// Prepares a batch: reads the rays, scales directions by a power of two, and finds where each enters the grid.
#include "common.clh"
#include "structures/walk.clh"

// WALK_LANES rays a work-item.
kernel void start_rays(const int count, global const float *origins, global const float *directions,
                       global const float *t_max, GRID_ARGUMENTS, global Ray *rays, global ulong *keys,
                       global ulong *positions, global float *t_exit)
{
    const int first = get_global_id(0) * WALK_LANES;
    if (first >= count)
        return;
    const Grid grid = GRID_VALUES;
    float field[7][WALK_LANES];
    for (int lane = 0; lane < WALK_LANES; ++lane) {
        const int i = min(first + lane, count - 1);
        const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), t_max[i]);
        field[0][lane] = ray.ox, field[1][lane] = ray.oy, field[2][lane] = ray.oz;
        field[3][lane] = ray.dx, field[4][lane] = ray.dy, field[5][lane] = ray.dz;
        field[6][lane] = ray.t_max;
        rays[i] = ray;
        keys[i] = hit_key(ray.t_max, NO_PRIMITIVE);
        t_exit[i] = 0.0f;
    }
    Walk w;
    w.x = axis_setup(walk_load(field[0]), walk_load(field[3]), grid.lower.x, grid.inverse_cell.x);
    w.y = axis_setup(walk_load(field[1]), walk_load(field[4]), grid.lower.y, grid.inverse_cell.y);
    w.z = axis_setup(walk_load(field[2]), walk_load(field[5]), grid.lower.z, grid.inverse_cell.z);
    int cell[3][WALK_LANES], enters[WALK_LANES];
    walk_store(walk_enter(&w, grid, walk_load(field[6])), enters);
    walk_store(w.x.cell, cell[0]), walk_store(w.y.cell, cell[1]), walk_store(w.z.cell, cell[2]);
    for (int lane = 0; lane < WALK_LANES && first + lane < count; ++lane)
        positions[first + lane] =
            enters[lane] ? pack_position(cell[0][lane], cell[1][lane], cell[2][lane]) : LEFT_GRID;
}

kernel void start_rays_without_grid(const int count, global const float *origins, global const float *directions,
                                    global const float *t_max, global Ray *rays, global ulong *keys)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    rays[i] = scaled_ray(vload3(i, origins), vload3(i, directions), t_max[i]);
    keys[i] = hit_key(rays[i].t_max, NO_PRIMITIVE);
}
