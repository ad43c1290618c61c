// An intersector on given pairs of a ray and a triangle, without grid or closest-hit search: what stability measures.
#include "intersect.clh"

#define HIT_CLAIMED 1      // the intersector claims a hit
#define HIT_ACCEPTED 2  // and the driver's rule takes its t

// LANES pairs a work-item, each lane with its own ray and triangle; the last work-item repeats its final pair.
kernel void test_pairs(const int count, global const int *ray_of_pair, global const int *triangle_of_pair,
                       global const float *origins, global const float *directions, global const float *t_max,
                       global const float *stored, global int *claimed, global float *t_out,
                       global float *u_out, global float *v_out)
{
    const int first = get_global_id(0) * LANES;
    if (first >= count)
        return;
    float field[7][LANES], values[STORED_FLOATS][LANES];
    int exponent[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        const int pair = min(first + lane, count - 1);
        const int i = ray_of_pair[pair];
        const Ray r = scaled_ray(vload3(i, origins), vload3(i, directions), t_max[i]);
        field[0][lane] = r.ox, field[1][lane] = r.oy, field[2][lane] = r.oz;
        field[3][lane] = r.dx, field[4][lane] = r.dy, field[5][lane] = r.dz;
        field[6][lane] = r.t_max;
        exponent[lane] = r.exponent;
        global const float *p = stored + (size_t)triangle_of_pair[pair] * STORED_FLOATS;
        for (int c = 0; c < STORED_FLOATS; ++c)
            values[c][lane] = p[c];
    }
    const RayLanes rays = {load_lanes(field[0]), load_lanes(field[1]), load_lanes(field[2]),
                           load_lanes(field[3]), load_lanes(field[4]), load_lanes(field[5])};
    const Stored triangle = STORED_OF(load_lanes, values);
    const Frame frame = intersector_setup(rays);
    real t = 0.0f, u = 0.0f, v = 0.0f;
    const mask hit = intersector_test(&frame, &triangle, &t, &u, &v);
    const mask taken = hit & accepted(t, load_lanes(field[6]));
    float t_of[LANES], u_of[LANES], v_of[LANES];
    int hit_of[LANES], taken_of[LANES];
    store_lanes(t, t_of);
    store_lanes(u, u_of);
    store_lanes(v, v_of);
    store_lanes(hit, hit_of);
    store_lanes(taken, taken_of);
    for (int lane = 0; lane < LANES && first + lane < count; ++lane) {
        claimed[first + lane] = (hit_of[lane] ? HIT_CLAIMED : 0) | (taken_of[lane] ? HIT_ACCEPTED : 0);
        t_out[first + lane] = ldexp(t_of[lane], -exponent[lane]);
        u_out[first + lane] = u_of[lane];
        v_out[first + lane] = v_of[lane];
    }
}
