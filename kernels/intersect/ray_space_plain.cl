// Ellis, Shaffer & Hart, "Deferred Ray Tracing Using Intersection Binning", section 2, as the paper writes it: plain
// products and differences, t interpolated between the vertices' depths.
//
//   X_i = (p_i - o) . u,  Y_i = (p_i - o) . v,  Z_i = (p_i - o) . d / d . d
//   (E0, E1, E2) = (X0,X1,X2) x (Y0,Y1,Y2),  hit when no two differ in sign,  t = E . Z / (E0 + E1 + E2)
//
// flops: 48 to accept or reject, +25 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: only without contraction: an fma in E_i sees one product rounded and one exact, and two triangles that
// share the edge no longer get opposite values.
// Known failures: contraction; t of slivers; small triangles far from the origin, whose E_i round to zero together.

#include "intersect/orthonormal_frame.clh"

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real px0 = s->x0 - f->ox, py0 = s->y0 - f->oy, pz0 = s->z0 - f->oz;
    const real px1 = s->x1 - f->ox, py1 = s->y1 - f->oy, pz1 = s->z1 - f->oz;
    const real px2 = s->x2 - f->ox, py2 = s->y2 - f->oy, pz2 = s->z2 - f->oz;
    const real x0 = px0 * f->ux + py0 * f->uy + pz0 * f->uz, y0 = px0 * f->vx + py0 * f->vy + pz0 * f->vz;
    const real x1 = px1 * f->ux + py1 * f->uy + pz1 * f->uz, y1 = px1 * f->vx + py1 * f->vy + pz1 * f->vz;
    const real x2 = px2 * f->ux + py2 * f->uy + pz2 * f->uz, y2 = px2 * f->vx + py2 * f->vy + pz2 * f->vz;
    const real e0 = x1 * y2 - x2 * y1;
    const real e1 = x2 * y0 - x0 * y2;
    const real e2 = x0 * y1 - x1 * y0;
    const mask inside = (min(e0, min(e1, e2)) >= 0.0f) | (max(e0, max(e1, e2)) <= 0.0f);
    if (!mask_any(inside))
        return inside;

    const real z0 = px0 * f->dx + py0 * f->dy + pz0 * f->dz;
    const real z1 = px1 * f->dx + py1 * f->dy + pz1 * f->dz;
    const real z2 = px2 * f->dx + py2 * f->dy + pz2 * f->dz;
    const real sum = e0 + e1 + e2;
    const real inverse = 1.0f / sum;
    *t = (e0 * z0 + e1 * z1 + e2 * z2) * inverse;
    *u = e1 * inverse;
    *v = e2 * inverse;
    return inside & ((sum > 0.0f) | (sum < 0.0f));
}
