// Moller & Trumbore 1997, "Fast, minimum storage ray-triangle intersection", in the form without division
// before acceptance; a determinant of exactly zero is a miss.
//
//   det = e1 . (d x e2),  U = (o - v0) . (d x e2),  V = d . ((o - v0) x e1),  t = e2 . ((o - v0) x e1) / det
//
// flops: 45 to accept or reject, +9 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: no (a shared edge is evaluated differently by its two triangles).
// Known failures: edges and vertices leak; t of slivers.
#ifndef LEAST_DETERMINANT
#define LEAST_DETERMINANT 0.0f
#endif

typedef RayLanes Frame;

inline Frame intersector_setup(const RayLanes ray) { return ray; }

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real ax = s->x1 - s->x0, ay = s->y1 - s->y0, az = s->z1 - s->z0;
    const real bx = s->x2 - s->x0, by = s->y2 - s->y0, bz = s->z2 - s->z0;
    const real px = f->dy * bz - f->dz * by;
    const real py = f->dz * bx - f->dx * bz;
    const real pz = f->dx * by - f->dy * bx;
    const real determinant = ax * px + ay * py + az * pz;

    const real sx = f->ox - s->x0, sy = f->oy - s->y0, sz = f->oz - s->z0;
    const real qx = sy * az - sz * ay;
    const real qy = sz * ax - sx * az;
    const real qz = sx * ay - sy * ax;

    // Multiplying by the determinant's sign lets one comparison serve both faces.
    const real sign = copysign((real)1.0f, determinant);
    const real size = fabs(determinant);
    const real a = sign * (sx * px + sy * py + sz * pz);
    const real b = sign * (f->dx * qx + f->dy * qy + f->dz * qz);
    const mask inside = (a >= 0.0f) & (b >= 0.0f) & (a + b <= size) & (size > LEAST_DETERMINANT);
    if (!mask_any(inside))
        return inside;

    const real inverse = 1.0f / size;
    *t = sign * (bx * qx + by * qy + bz * qz) * inverse;
    *u = a * inverse;
    *v = b * inverse;
    return inside;
}
