// Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection", with Kahan's difference of products in place of
// the fall-back to double precision.
//
//   U = Cx By - Cy Bx and so on within 1.5 ulp: the sign is right and zero only where it is exact
//
// flops: 41 to accept or reject beside the selections, +11 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: yes, contraction on or off. The shear may be contracted, but alike for every triangle of a vertex.
// Known failures: t of a large triangle near the ray's origin errs by an ulp of the farthest vertex's distance, so
// that spawned rays hit where they start; rays at a vertex hit several of its triangles.

#include "intersect/shear.clh"

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const Sheared a = shear(f, s->x0, s->y0, s->z0);
    const Sheared b = shear(f, s->x1, s->y1, s->z1);
    const Sheared c = shear(f, s->x2, s->y2, s->z2);
    const real e0 = difference_of_products(c.x, b.y, c.y, b.x);
    const real e1 = difference_of_products(a.x, c.y, a.y, c.x);
    const real e2 = difference_of_products(b.x, a.y, b.y, a.x);
    return hit_of_edges(a, b, c, e0, e1, e2, t, u, v);
}
