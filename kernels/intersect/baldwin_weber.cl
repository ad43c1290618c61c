// Baldwin & Weber 2016, "Fast Ray-Triangle Intersections by Coordinate Transformation": the map to the triangle's own
// coordinates whose third axis is the world axis nearest to the normal, so that one column of it is (0, 0, 1).
//
//   t = -(row_w . o) / (row_w . d),  p = o + t d,  u = row_u . p,  v = row_v . p
//
// flops: 30 and one division to accept or reject, the trivial column included: triangles of different normals lie
// side by side in lanes.
// Bytes a triangle: 48, all of it precomputed: the whole map; the paper's form leaves the trivial column out.
// Watertight: no.
// Known failures: far from the world's origin, where the error grows with the distance; edges and vertices leak.
#define PRECOMPUTES

inline void intersector_precompute(float3 a, float3 b, float3 c, float *map)
{
    const scalar_wide v0[3] = {a.x, a.y, a.z};
    const scalar_wide e1[3] = {(scalar_wide)b.x - a.x, (scalar_wide)b.y - a.y, (scalar_wide)b.z - a.z};
    const scalar_wide e2[3] = {(scalar_wide)c.x - a.x, (scalar_wide)c.y - a.y, (scalar_wide)c.z - a.z};
    scalar_wide n[3];
    for (int i = 0; i < 3; ++i)
        n[i] = e1[(i + 1) % 3] * e2[(i + 2) % 3] - e1[(i + 2) % 3] * e2[(i + 1) % 3];
    const int k = fabs(n[0]) > fabs(n[1]) && fabs(n[0]) > fabs(n[2]) ? 0 : fabs(n[1]) > fabs(n[2]) ? 1 : 2;
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    const scalar_wide over = 1 / n[k];
    for (int m = 0; m < 12; ++m)
        map[m] = 0.0f;
    // With v0 as origin, u = (e2_j x_i - e2_i x_j) / n_k and v = (e1_i x_j - e1_j x_i) / n_k.
    map[i] = e2[j] * over, map[j] = -e2[i] * over;
    map[3] = -(e2[j] * v0[i] - e2[i] * v0[j]) * over;
    map[4 + i] = -e1[j] * over, map[4 + j] = e1[i] * over;
    map[7] = -(e1[i] * v0[j] - e1[j] * v0[i]) * over;
    map[8 + i] = n[i] * over, map[8 + j] = n[j] * over, map[8 + k] = 1.0f;
    map[11] = -(n[0] * v0[0] + n[1] * v0[1] + n[2] * v0[2]) * over;
}

typedef RayLanes Frame;

inline Frame intersector_setup(const RayLanes ray) { return ray; }

inline mask intersector_test(const Frame *f, const Planes *s, real *t, real *u, real *v)
{
    const real depth = s->zx * f->ox + s->zy * f->oy + s->zz * f->oz + s->zw;
    const real slope = s->zx * f->dx + s->zy * f->dy + s->zz * f->dz;
    const real distance = -depth / slope;
    const real x = f->ox + distance * f->dx, y = f->oy + distance * f->dy, z = f->oz + distance * f->dz;
    const real a = s->xx * x + s->xy * y + s->xz * z + s->xw;
    const real b = s->yx * x + s->yy * y + s->yz * z + s->yw;
    *t = distance;
    *u = a;
    *v = b;
    return (a >= 0.0f) & (b >= 0.0f) & (a + b <= 1.0f);
}
