// Pluecker coordinates as in Embree 4's robust mode (Davis & Wald's edge test, with a tolerance of one ulp of the
// sum).
//
//   U = ((v2 - v0) x (v2 + v0)) . d and so on, vertices relative to the origin
//   hit when min(U, V, W) >= -e or max(U, V, W) <= e,  e = 2^-23 |U + V + W|;  t = v0 . n / n . d
//
// flops: 72 to accept or reject, +39 and two divisions on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: nearly; an edge gets opposite values from its two triangles, and the tolerance serves the vertices.
// Known failures: most rays near an edge hit both triangles; grazing rays.
#ifndef EDGE_TOLERANCE
#define EDGE_TOLERANCE 0x1p-23f
#endif

typedef RayLanes Frame;

inline Frame intersector_setup(const RayLanes ray) { return ray; }

// ((a - b) x (a + b)) . d
inline real edge_function(const Frame *f, real ax, real ay, real az, real bx, real by, real bz)
{
    const real ex = ax - bx, ey = ay - by, ez = az - bz;
    const real sx = ax + bx, sy = ay + by, sz = az + bz;
    const real cx = ey * sz - ez * sy;
    const real cy = ez * sx - ex * sz;
    const real cz = ex * sy - ey * sx;
    return cx * f->dx + cy * f->dy + cz * f->dz;
}

// One component of the normal, from the edges that lose least: Embree's stable_triangle_normal.
inline real stable_component(real ay, real az, real by, real bz, real cy, real cz)
{
    const real first = ay * bz - az * by, second = by * cz - bz * cy;
    return pick(second, first, fabs(az * by) < fabs(bz * cy));
}

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real x0 = s->x0 - f->ox, y0 = s->y0 - f->oy, z0 = s->z0 - f->oz;
    const real x1 = s->x1 - f->ox, y1 = s->y1 - f->oy, z1 = s->z1 - f->oz;
    const real x2 = s->x2 - f->ox, y2 = s->y2 - f->oy, z2 = s->z2 - f->oz;
    const real e1 = edge_function(f, x2, y2, z2, x0, y0, z0);
    const real e2 = edge_function(f, x0, y0, z0, x1, y1, z1);
    const real e0 = edge_function(f, x1, y1, z1, x2, y2, z2);
    const real sum = e0 + e1 + e2;
    const real tolerance = EDGE_TOLERANCE * fabs(sum);
    const mask inside = (min(e0, min(e1, e2)) >= -tolerance) | (max(e0, max(e1, e2)) <= tolerance);
    if (!mask_any(inside))
        return inside;

    const real ax = x2 - x0, ay = y2 - y0, az = z2 - z0;
    const real bx = x0 - x1, by = y0 - y1, bz = z0 - z1;
    const real cx = x1 - x2, cy = y1 - y2, cz = z1 - z2;
    const real nx = stable_component(ay, az, by, bz, cy, cz);
    const real ny = stable_component(az, ax, bz, bx, cz, cx);
    const real nz = stable_component(ax, ay, bx, by, cx, cy);
    const real slope = nx * f->dx + ny * f->dy + nz * f->dz;
    const real inverse = 1.0f / sum;
    *t = (nx * x0 + ny * y0 + nz * z0) / slope;
    *u = clamp(e1 * inverse, 0.0f, 1.0f);
    *v = clamp(e2 * inverse, 0.0f, 1.0f);
    return inside & ((slope > 0.0f) | (slope < 0.0f)) & ((sum > 0.0f) | (sum < 0.0f));
}
