// Prepares a batch: reads the rays, scales directions by a power of two, and finds where each enters the grid.
#include "common.clh"
#include "walk.clh"

kernel void start_rays(const int count, global const float *origins, global const float *directions,
                       global const float *t_max, GRID_ARGUMENTS, global Ray *rays, global ulong *keys,
                       global ulong *positions, global float *t_exit)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Grid grid = GRID_VALUES;
    const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), t_max[i]);
    const Walk w = walk_setup(grid, ray);
    rays[i] = ray;
    keys[i] = hit_key(ray.t_max, NO_PRIMITIVE);
    positions[i] = walk_entry(&w, grid, ray.t_max);
    t_exit[i] = 0.0f;
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
