// Ellis, Shaffer & Hart, "Deferred Ray Tracing Using Intersection Binning", section 2, with the origin folded into
// the frame: three subtractions a triangle less.
//
//   X_i = p_i . u - o . u,  Y_i = p_i . v - o . v,  Z_i = p_i . d - o . d, otherwise as ray_space_plain.cl
//
// flops: 45 to accept or reject, +28 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: only without contraction, and then only in topology: an edge is where both triangles think it is, but
// not where it truly is.
// Known failures: far from the world's origin p_i . u and o . u cancel; the error grows with the distance.

#define Frame OrthonormalFrame
#define intersector_setup orthonormal_setup
#include "intersect/orthonormal_frame.clh"
#undef Frame
#undef intersector_setup

typedef struct {
    OrthonormalFrame axes;
    real ou, ov, od;
} Frame;

inline Frame intersector_setup(const RayLanes ray)
{
    Frame f;
    f.axes = orthonormal_setup(ray);
    f.ou = ray.ox * f.axes.ux + ray.oy * f.axes.uy + ray.oz * f.axes.uz;
    f.ov = ray.ox * f.axes.vx + ray.oy * f.axes.vy + ray.oz * f.axes.vz;
    f.od = ray.ox * f.axes.dx + ray.oy * f.axes.dy + ray.oz * f.axes.dz;
    return f;
}

inline mask intersector_test(const Frame *frame, const Triangle *s, real *t, real *u, real *v)
{
    const OrthonormalFrame *f = &frame->axes;
    const real x0 = s->x0 * f->ux + s->y0 * f->uy + s->z0 * f->uz - frame->ou;
    const real y0 = s->x0 * f->vx + s->y0 * f->vy + s->z0 * f->vz - frame->ov;
    const real x1 = s->x1 * f->ux + s->y1 * f->uy + s->z1 * f->uz - frame->ou;
    const real y1 = s->x1 * f->vx + s->y1 * f->vy + s->z1 * f->vz - frame->ov;
    const real x2 = s->x2 * f->ux + s->y2 * f->uy + s->z2 * f->uz - frame->ou;
    const real y2 = s->x2 * f->vx + s->y2 * f->vy + s->z2 * f->vz - frame->ov;
    const real e0 = x1 * y2 - x2 * y1;
    const real e1 = x2 * y0 - x0 * y2;
    const real e2 = x0 * y1 - x1 * y0;
    const mask inside = (min(e0, min(e1, e2)) >= 0.0f) | (max(e0, max(e1, e2)) <= 0.0f);
    if (!mask_any(inside))
        return inside;

    const real z0 = s->x0 * f->dx + s->y0 * f->dy + s->z0 * f->dz - frame->od;
    const real z1 = s->x1 * f->dx + s->y1 * f->dy + s->z1 * f->dz - frame->od;
    const real z2 = s->x2 * f->dx + s->y2 * f->dy + s->z2 * f->dz - frame->od;
    const real sum = e0 + e1 + e2;
    const real inverse = 1.0f / sum;
    *t = (e0 * z0 + e1 * z1 + e2 * z2) * inverse;
    *u = e1 * inverse;
    *v = e2 * inverse;
    return inside & ((sum > 0.0f) | (sum < 0.0f));
}
