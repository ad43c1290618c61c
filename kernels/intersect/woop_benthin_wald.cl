// Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection".
//
//   A_i: vertices relative to the origin, permuted and sheared so that the ray is (0, 0, 1)
//   U = Cx By - Cy Bx,  V = Ax Cy - Ay Cx,  W = Bx Ay - By Ax; all three again in double where one is zero
//   hit when no two differ in sign,  t = (U Az + V Bz + W Cz) / (U + V + W)
//
// flops: 32 to accept or reject beside the selections, +11 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed; needs double precision.
// Watertight: only without contraction, which breaks the antisymmetry of U, V and W.
// Known failures: contraction; t of slivers.

#include "intersect/shear.clh"

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const Sheared a = shear(f, s->x0, s->y0, s->z0);
    const Sheared b = shear(f, s->x1, s->y1, s->z1);
    const Sheared c = shear(f, s->x2, s->y2, s->z2);
    real e0 = c.x * b.y - c.y * b.x;
    real e1 = a.x * c.y - a.y * c.x;
    real e2 = b.x * a.y - b.y * a.x;
    const mask zero = (e0 == 0.0f) | (e1 == 0.0f) | (e2 == 0.0f);
    if (mask_any(zero)) {
        const wide ax = widen(a.x), ay = widen(a.y), bx = widen(b.x), by = widen(b.y);
        const wide cx = widen(c.x), cy = widen(c.y);
        e0 = pick(e0, narrow(cx * by - cy * bx), zero);
        e1 = pick(e1, narrow(ax * cy - ay * cx), zero);
        e2 = pick(e2, narrow(bx * ay - by * ax), zero);
    }
    return hit_of_edges(a, b, c, e0, e1, e2, t, u, v);
}
