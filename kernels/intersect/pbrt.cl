// Pharr, Jakob & Humphreys 2023, "Physically Based Rendering", 4th edition, section 6.5.3: Woop, Benthin & Wald's
// test with differences of products, the fall-back to double precision, and a bound on t's rounding error below which
// a hit is not believed.
//
//   deltaT = 3 (gamma(3) maxE maxZ + deltaE maxZ + deltaZ maxE) / |E0 + E1 + E2|;  a hit needs t > deltaT
//
// flops: 70, 29 of them the check of zero area, to accept or reject beside the selections, +31 and one division on a
// hit.
// Bytes a triangle: 36, nothing precomputed; needs double precision.
// Watertight: nearly: the bound loses 1 or 2 rays in a million.
// Known failures: refuses long slivers, far triangles and grazing hits, whose bound exceeds t; expects unit
// directions; takes triangles smaller than 1e-12 for ones without area.

#include "intersect/shear.clh"

#define rounding_bound(n) ((n) * 0x1p-24f / (1.0f - (n) * 0x1p-24f))
#define largest_of(a, b, c) max(fabs(a), max(fabs(b), fabs(c)))

// Whether t exceeds the bound on its own rounding error.
inline mask beyond_error(Sheared a, Sheared b, Sheared c, real e0, real e1, real e2, real t)
{
    const real most_z = largest_of(a.z, b.z, c.z), delta_z = rounding_bound(3) * most_z;
    const real most_x = largest_of(a.x, b.x, c.x), delta_x = rounding_bound(5) * (most_x + most_z);
    const real most_y = largest_of(a.y, b.y, c.y), delta_y = rounding_bound(5) * (most_y + most_z);
    const real delta_e = 2.0f * (rounding_bound(2) * most_x * most_y + delta_y * most_x + delta_x * most_y);
    const real most_e = largest_of(e0, e1, e2), inverse = 1.0f / (e0 + e1 + e2);
    const real delta_t =
        3.0f * (rounding_bound(3) * most_e * most_z + delta_e * most_z + delta_z * most_e) * fabs(inverse);
    return t > delta_t;
}

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real qx = s->x2 - s->x0, qy = s->y2 - s->y0, qz = s->z2 - s->z0;
    const real rx = s->x1 - s->x0, ry = s->y1 - s->y0, rz = s->z1 - s->z0;
    const real nx = difference_of_products(qy, rz, qz, ry);
    const real ny = difference_of_products(qz, rx, qx, rz);
    const real nz = difference_of_products(qx, ry, qy, rx);
    const mask has_area = nx * nx + ny * ny + nz * nz > 0.0f;

    const Sheared a = shear(f, s->x0, s->y0, s->z0);
    const Sheared b = shear(f, s->x1, s->y1, s->z1);
    const Sheared c = shear(f, s->x2, s->y2, s->z2);
    real e0 = difference_of_products(b.x, c.y, b.y, c.x);
    real e1 = difference_of_products(c.x, a.y, c.y, a.x);
    real e2 = difference_of_products(a.x, b.y, a.y, b.x);
    const mask zero = (e0 == 0.0f) | (e1 == 0.0f) | (e2 == 0.0f);
    if (mask_any(zero)) {
        const wide ax = widen(a.x), ay = widen(a.y), bx = widen(b.x), by = widen(b.y);
        const wide cx = widen(c.x), cy = widen(c.y);
        e0 = pick(e0, narrow(cy * bx - cx * by), zero);
        e1 = pick(e1, narrow(ay * cx - ax * cy), zero);
        e2 = pick(e2, narrow(by * ax - bx * ay), zero);
    }
    const mask hit = hit_of_edges(a, b, c, e0, e1, e2, t, u, v) & has_area;
    if (!mask_any(hit))
        return hit;
    return hit & beyond_error(a, b, c, e0, e1, e2, *t);
}
