// Woop 2004, "A Ray Tracing Hardware Architecture for Dynamic Scenes": an affine map takes the triangle to the unit
// triangle in the plane z = 0, and the ray with it.
//
//   p = v0 + u e1 + v e2 + w n;  o', d' = map(o), map(d);  t = -o'_w / d'_w,  u = o'_u + t d'_u,  v = o'_v + t d'_v
//
// flops: 38 and one division to accept or reject.
// Bytes a triangle: 48, all of it precomputed: the map.
// Watertight: no.
// Known failures: far from the world's origin; slivers; scales beyond 1e+-8, where |n|^2 leaves float32's range.
#define PRECOMPUTES

inline void intersector_precompute(float3 a, float3 b, float3 c, float *map)
{
    const scalar_wide ex = (scalar_wide)b.x - a.x, ey = (scalar_wide)b.y - a.y, ez = (scalar_wide)b.z - a.z;
    const scalar_wide fx = (scalar_wide)c.x - a.x, fy = (scalar_wide)c.y - a.y, fz = (scalar_wide)c.z - a.z;
    const scalar_wide nx = ey * fz - ez * fy, ny = ez * fx - ex * fz, nz = ex * fy - ey * fx;
    const scalar_wide over = 1 / (nx * nx + ny * ny + nz * nz);
    const scalar_wide row[3][3] = {
        {(fy * nz - fz * ny) * over, (fz * nx - fx * nz) * over, (fx * ny - fy * nx) * over},
        {(ny * ez - nz * ey) * over, (nz * ex - nx * ez) * over, (nx * ey - ny * ex) * over},
        {nx * over, ny * over, nz * over},
    };
    for (int i = 0; i < 3; ++i) {
        map[4 * i] = row[i][0], map[4 * i + 1] = row[i][1], map[4 * i + 2] = row[i][2];
        map[4 * i + 3] = -(row[i][0] * a.x + row[i][1] * a.y + row[i][2] * a.z);
    }
}

typedef RayLanes Frame;

inline Frame intersector_setup(const RayLanes ray) { return ray; }

inline mask intersector_test(const Frame *f, const Planes *s, real *t, real *u, real *v)
{
    const real ow = s->zx * f->ox + s->zy * f->oy + s->zz * f->oz + s->zw;
    const real dw = s->zx * f->dx + s->zy * f->dy + s->zz * f->dz;
    const real distance = -ow / dw;
    const real ou = s->xx * f->ox + s->xy * f->oy + s->xz * f->oz + s->xw;
    const real du = s->xx * f->dx + s->xy * f->dy + s->xz * f->dz;
    const real ov = s->yx * f->ox + s->yy * f->oy + s->yz * f->oz + s->yw;
    const real dv = s->yx * f->dx + s->yy * f->dy + s->yz * f->dz;
    const real a = ou + distance * du, b = ov + distance * dv;
    *t = distance;
    *u = a;
    *v = b;
    return (a >= 0.0f) & (b >= 0.0f) & (a + b <= 1.0f);
}
