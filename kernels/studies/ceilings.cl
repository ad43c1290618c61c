// What the device can do at most, for rooflines: copying memory, and fused multiply-adds that wait for nothing.
#include "common.clh"

#ifndef VECTORS
#error "VECTORS not defined: vectors of LANES floats that a work-item copies"
#endif

// A work-item of a CPU copies vectors side by side; on a GPU those of a work-group lie side by side.
#if LANES > 1
#define vector_of(k) (get_global_id(0) * VECTORS + (k))
#else
#define vector_of(k) (get_group_id(0) * get_local_size(0) * VECTORS + (k) * get_local_size(0) + get_local_id(0))
#endif

kernel void copy_vectors(const int items, global const real *from, global real *to)
{
    if (get_global_id(0) >= items)
        return;
    for (int k = 0; k < VECTORS; ++k)
        to[vector_of(k)] = from[vector_of(k)];
}

// Two flops a lane, chain and round. Ten chains hide the latency of two units and still fit 16 registers.
#define CHAINS 10
kernel void chain_fmas(const int rounds, const float factor, const float addend, global float *sums)
{
    const real f = factor, b = addend;
    real a0 = get_global_id(0), a1 = 1, a2 = 2, a3 = 3, a4 = 4, a5 = 5, a6 = 6, a7 = 7, a8 = 8, a9 = 9;
    for (int round = 0; round < rounds; ++round) {
        a0 = fma(a0, f, b), a1 = fma(a1, f, b), a2 = fma(a2, f, b), a3 = fma(a3, f, b), a4 = fma(a4, f, b);
        a5 = fma(a5, f, b), a6 = fma(a6, f, b), a7 = fma(a7, f, b), a8 = fma(a8, f, b), a9 = fma(a9, f, b);
    }
    const real all = a0 + a1 + a2 + a3 + a4 + a5 + a6 + a7 + a8 + a9;
    float lane[LANES];
    store_lanes(all, (&lane[0]));
    float sum = 0.0f;
    for (int i = 0; i < LANES; ++i)
        sum += lane[i];
    sums[get_global_id(0)] = sum;
}
