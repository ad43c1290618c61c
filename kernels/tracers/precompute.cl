// Turns vertices into the form that an intersector stores. Built with LANES = 1.
#include "intersect.clh"

kernel void precompute_triangles(const int count, global const float *triangles, global float *stored)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    global const float *p = triangles + (size_t)i * 9;
    float values[STORED_FLOATS];
#ifdef PRECOMPUTES
    intersector_precompute(vload3(0, p), vload3(1, p), vload3(2, p), values);
#else
    for (int c = 0; c < STORED_FLOATS; ++c)
        values[c] = p[c];
#endif
    for (int c = 0; c < STORED_FLOATS; ++c)
        stored[(size_t)i * STORED_FLOATS + c] = values[c];
}
