// Kensler & Shirley 2006, "Optimizing Ray-Triangle Intersection via Automated Search".
//
//   n = (p0 - p2) x (p1 - p0),  q = (p0 - o) / n . d,  i = d x q
//   beta = i . (p0 - p2),  gamma = i . (p1 - p0),  t = n . q
//
// flops: 51 and one division to accept or reject.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: no.
// Known failures: those of Moller & Trumbore's test.

typedef RayLanes Frame;

inline Frame intersector_setup(const RayLanes ray) { return ray; }

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real ax = s->x1 - s->x0, ay = s->y1 - s->y0, az = s->z1 - s->z0;
    const real bx = s->x0 - s->x2, by = s->y0 - s->y2, bz = s->z0 - s->z2;
    const real nx = by * az - bz * ay;
    const real ny = bz * ax - bx * az;
    const real nz = bx * ay - by * ax;
    const real over = 1.0f / (nx * f->dx + ny * f->dy + nz * f->dz);
    const real qx = (s->x0 - f->ox) * over, qy = (s->y0 - f->oy) * over, qz = (s->z0 - f->oz) * over;
    const real ix = f->dy * qz - f->dz * qy;
    const real iy = f->dz * qx - f->dx * qz;
    const real iz = f->dx * qy - f->dy * qx;
    const real beta = ix * bx + iy * by + iz * bz;
    const real gamma = ix * ax + iy * ay + iz * az;
    *t = nx * qx + ny * qy + nz * qz;
    *u = beta;
    *v = gamma;
    return (beta >= 0.0f) & (gamma >= 0.0f) & (beta + gamma <= 1.0f);
}
