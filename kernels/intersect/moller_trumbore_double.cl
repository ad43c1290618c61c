// Moller & Trumbore 1997, "Fast, minimum storage ray-triangle intersection", in double precision.
//
//   as moller_trumbore.cl, with a determinant of exactly zero as a miss
//
// flops: 45 in double precision to accept or reject, +9 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed; needs double precision.
// Watertight: no: rays exactly through an edge leak, because triple products are rounded in double too.
// Known failures: exact ties.

typedef struct {
    wide ox, oy, oz, dx, dy, dz;
} Frame;

inline Frame intersector_setup(const RayLanes ray)
{
    const Frame f = {widen(ray.ox), widen(ray.oy), widen(ray.oz), widen(ray.dx), widen(ray.dy), widen(ray.dz)};
    return f;
}

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const wide x0 = widen(s->x0), y0 = widen(s->y0), z0 = widen(s->z0);
    const wide ax = widen(s->x1) - x0, ay = widen(s->y1) - y0, az = widen(s->z1) - z0;
    const wide bx = widen(s->x2) - x0, by = widen(s->y2) - y0, bz = widen(s->z2) - z0;
    const wide px = f->dy * bz - f->dz * by;
    const wide py = f->dz * bx - f->dx * bz;
    const wide pz = f->dx * by - f->dy * bx;
    const wide determinant = ax * px + ay * py + az * pz;
    const wide sx = f->ox - x0, sy = f->oy - y0, sz = f->oz - z0;
    const wide qx = sy * az - sz * ay;
    const wide qy = sz * ax - sx * az;
    const wide qz = sx * ay - sy * ax;
    const wide sign = copysign((wide)1.0, determinant);
    const wide size = fabs(determinant);
    const wide a = sign * (sx * px + sy * py + sz * pz);
    const wide b = sign * (f->dx * qx + f->dy * qy + f->dz * qz);
    const wide_mask found = (a >= 0.0) & (b >= 0.0) & (a + b <= size) & (size > 0.0);
    const mask inside = narrow_mask(found);
    if (!mask_any(inside))
        return inside;

    const wide inverse = 1.0 / size;
    *t = narrow(sign * (bx * qx + by * qy + bz * qz) * inverse);
    *u = narrow(a * inverse);
    *v = narrow(b * inverse);
    return inside;
}
