// From best keys to hits, the same kernel for every tracer. Built with LANES = 1.
#include "intersect.clh"

// Undoes the direction's scaling and evaluates u and v of the winning triangle.
kernel void write_hits(const int count, global const Ray *rays, global const ulong *keys,
                       global const float *triangles, global float *t, global int *primitive, global float *u,
                       global float *v)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const ulong key = keys[i];
    const float distance = ldexp(key_t(key), -rays[i].exponent);
    // A t that only overflows in the ray's own units is out of reach.
    const int hit = key_primitive(key) != NO_PRIMITIVE && isfinite(distance);
    t[i] = INFINITY;
    primitive[i] = -1;
    u[i] = v[i] = 0.0f;
    if (!hit)
        return;
    const Ray r = rays[i];
    const RayLanes lanes = {r.ox, r.oy, r.oz, r.dx, r.dy, r.dz};
    const Frame frame = intersector_setup(lanes);
    const Stored triangle = load_stored(triangles, (int)key_primitive(key));
    real scaled_t = 0.0f, hit_u = 0.0f, hit_v = 0.0f;
    intersector_test(&frame, &triangle, &scaled_t, &hit_u, &hit_v);
    t[i] = distance;
    primitive[i] = (int)key_primitive(key);
    u[i] = hit_u;
    v[i] = hit_v;
}
