// From best keys to hits, the same kernel for every tracer, LANES rays a work-item.
#include "intersect.clh"

#define HITS_AHEAD (4 * LANES)  // rays between the one written and the one whose triangle is asked for

// Undoes the direction's scaling and evaluates u and v of the winning triangle.
kernel void write_hits(const int count, global const Ray *rays, global const ulong *keys,
                       global const float *triangles, global float *t, global int *primitive, global float *u,
                       global float *v)
{
    const int first = get_global_id(0) * LANES;
    if (first >= count)
        return;
#ifdef fetch_line
    for (int lane = 0; lane < LANES; ++lane) {
        const int later = (int)key_primitive(keys[min(first + lane + HITS_AHEAD, count - 1)]);
        fetch_line(triangles + (size_t)max(later, 0) * STORED_FLOATS);
        fetch_line(triangles + (size_t)max(later, 0) * STORED_FLOATS + STORED_FLOATS - 1);
    }
#endif
    float field[6][LANES], values[STORED_FLOATS][LANES];
    int hit[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        const int i = min(first + lane, count - 1);
        const ulong key = keys[i];
        const Ray r = rays[i];
        const float distance = times_power(key_t(key), -r.exponent);
        // A t that only overflows in the ray's own units is out of reach.
        hit[lane] = key_primitive(key) != NO_PRIMITIVE && isfinite(distance) ? (int)key_primitive(key) : -1;
        t[i] = hit[lane] < 0 ? INFINITY : distance;
        primitive[i] = hit[lane];
        field[0][lane] = r.ox, field[1][lane] = r.oy, field[2][lane] = r.oz;
        field[3][lane] = r.dx, field[4][lane] = r.dy, field[5][lane] = r.dz;
        global const float *p = triangles + (size_t)max(hit[lane], 0) * STORED_FLOATS;
        for (int c = 0; c < STORED_FLOATS; ++c)
            values[c][lane] = p[c];
    }
    const RayLanes lanes = {load_lanes(field[0]), load_lanes(field[1]), load_lanes(field[2]),
                            load_lanes(field[3]), load_lanes(field[4]), load_lanes(field[5])};
    const Frame frame = intersector_setup(lanes);
    const Stored triangle = STORED_OF(load_lanes, values);
    real scaled_t = 0.0f, hit_u = 0.0f, hit_v = 0.0f;
    intersector_test(&frame, &triangle, &scaled_t, &hit_u, &hit_v);
    store_lanes(hit_u, field[0]);
    store_lanes(hit_v, field[1]);
    for (int lane = 0; lane < LANES && first + lane < count; ++lane) {
        u[first + lane] = hit[lane] < 0 ? 0.0f : field[0][lane];
        v[first + lane] = hit[lane] < 0 ? 0.0f : field[1][lane];
    }
}
