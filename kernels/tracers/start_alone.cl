// Prepares a batch for tracers that walk no structure: reads the rays and scales directions by a power of two.
#include "common.clh"

kernel void start_rays_alone(const int count, global const float *origins, global const float *directions,
                             global const float *t_max, global Ray *rays, global ulong *keys)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    rays[i] = scaled_ray(vload3(i, origins), vload3(i, directions), t_max[i]);
    keys[i] = hit_key(rays[i].t_max, NO_PRIMITIVE);
}
