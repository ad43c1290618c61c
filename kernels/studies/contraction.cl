// Whether the compiler contracts a * b - c to one fma: the rest of a rounded product is zero without, rarely with.
#include "common.clh"

#ifdef CONTRACT
#pragma OPENCL FP_CONTRACT ON
#endif
kernel void product_rest(const int count, global const float *a, global const float *b, global const float *product,
                         global float *rest)
{
    const int i = get_global_id(0);
    if (i < count)
        rest[i] = a[i] * b[i] - product[i];
}
