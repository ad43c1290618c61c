// Ellis, Shaffer & Hart, "Deferred Ray Tracing Using Intersection Binning", section 2, in an orthonormal frame: what
// ray_space.cl is with the sheared one.
//
//   X_i = (p_i - o) . u,  Y_i = (p_i - o) . v      six dot products; (u, v) span the plane across the ray
//   (E0, E1, E2) = (X0,X1,X2) x (Y0,Y1,Y2)         one cross product: the three edge functions
//   hit when no two edge functions differ in sign; t = n . (p_0 - o) / n . d,  n = (p_1 - p_0) x (p_2 - p_0)
//
// The mean of the vertices' depths weighted by E_i would serve as t, but on a large triangle it is off by an ulp
// of the vertices' distance, which turns into self-hits where a ray starts on the triangle. The plane's t is right
// there and wrong where the ray lies in the plane, so that t is the plane's, held to within DEPTH_ERROR of the mean.
// A plain rounded cross product is watertight too, but rounds to zero for small triangles far from the ray's origin
// and then reports hits hundreds of units beside the ray; Kahan's difference of products does not.
// flops: 57 to accept or reject, +63 and two divisions on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: yes, contraction on or off: X_i and Y_i depend on vertex and ray alone, and a difference of
// products within 1.5 ulp never has the wrong sign.
// Known failures: t of triangles so thin that their edges' rounding tilts the plane.

#include "intersect/orthonormal_frame.clh"

#define DEPTH_ERROR 0x1p-21f  // eight roundings of the farthest vertex's depth

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real px0 = s->x0 - f->ox, py0 = s->y0 - f->oy, pz0 = s->z0 - f->oz;
    const real px1 = s->x1 - f->ox, py1 = s->y1 - f->oy, pz1 = s->z1 - f->oz;
    const real px2 = s->x2 - f->ox, py2 = s->y2 - f->oy, pz2 = s->z2 - f->oz;

    // Six dot products take the vertices across the ray.
    const real x0 = fma(px0, f->ux, fma(py0, f->uy, pz0 * f->uz));
    const real y0 = fma(px0, f->vx, fma(py0, f->vy, pz0 * f->vz));
    const real x1 = fma(px1, f->ux, fma(py1, f->uy, pz1 * f->uz));
    const real y1 = fma(px1, f->vx, fma(py1, f->vy, pz1 * f->vz));
    const real x2 = fma(px2, f->ux, fma(py2, f->uy, pz2 * f->uz));
    const real y2 = fma(px2, f->vx, fma(py2, f->vy, pz2 * f->vz));

    // One cross product gives the edge functions, without cancellation: zero only where it is exact.
    const real e0 = difference_of_products(x1, y2, x2, y1);
    const real e1 = difference_of_products(x2, y0, x0, y2);
    const real e2 = difference_of_products(x0, y1, x1, y0);
    const real least = min(e0, min(e1, e2)), most = max(e0, max(e1, e2));
    const mask inside = (least >= 0.0f) | (most <= 0.0f);
    if (!mask_any(inside))
        return inside;

    // Only a hit computes t: on the triangle's plane, by a normal without cancellation, and within the rounding error
    // of the mean of the vertices' depths, which keeps the hit of a coplanar ray on its triangle. A NaN stays one.
    const real z0 = fma(px0, f->dx, fma(py0, f->dy, pz0 * f->dz));
    const real z1 = fma(px1, f->dx, fma(py1, f->dy, pz1 * f->dz));
    const real z2 = fma(px2, f->dx, fma(py2, f->dy, pz2 * f->dz));
    const real ax = s->x1 - s->x0, ay = s->y1 - s->y0, az = s->z1 - s->z0;
    const real bx = s->x2 - s->x0, by = s->y2 - s->y0, bz = s->z2 - s->z0;
    const real nx = difference_of_products(ay, bz, az, by);
    const real ny = difference_of_products(az, bx, ax, bz);
    const real nz = difference_of_products(ax, by, ay, bx);
    const real depth = fma(nx, px0, fma(ny, py0, nz * pz0));
    const real slope = fma(nx, f->dx, fma(ny, f->dy, nz * f->dz)) * f->squared;
    const real sum = e0 + e1 + e2;
    const real inverse = 1.0f / sum;
    const real between = fma(e0, z0, fma(e1, z1, e2 * z2)) * inverse;
    const real reach = DEPTH_ERROR * max(fabs(z0), max(fabs(z1), fabs(z2)));
    const real plane = depth / slope;
    const real above = pick(plane, between - reach, plane < between - reach);
    *t = pick(above, between + reach, above > between + reach);
    *u = e1 * inverse;
    *v = e2 * inverse;
    return inside & ((sum > 0.0f) | (sum < 0.0f));
}
