// Havel & Herout 2010, "Yet Faster Ray-Triangle Intersection (Using SSE4)": three precomputed planes and no division
// before acceptance.
//
//   D = n . d,  T = n_w - n . o,  P = D o + T d,  U = n1 . P + D n1_w,  V = n2 . P + D n2_w
//   hit when U, V and D - U - V have the sign of D;  t = T / D
//
// flops: 37 to accept or reject, +4 and one division on a hit.
// Bytes a triangle: 48, all of it precomputed: the planes.
// Watertight: no.
// Known failures: far from the world's origin; slivers; scales where |n|^2 leaves float32's range.
#define PRECOMPUTES

inline void intersector_precompute(float3 a, float3 b, float3 c, float *planes)
{
    const scalar_wide ex = (scalar_wide)b.x - a.x, ey = (scalar_wide)b.y - a.y, ez = (scalar_wide)b.z - a.z;
    const scalar_wide fx = (scalar_wide)c.x - a.x, fy = (scalar_wide)c.y - a.y, fz = (scalar_wide)c.z - a.z;
    const scalar_wide nx = ey * fz - ez * fy, ny = ez * fx - ex * fz, nz = ex * fy - ey * fx;
    const scalar_wide over = 1 / (nx * nx + ny * ny + nz * nz);
    const scalar_wide ux = (fy * nz - fz * ny) * over, uy = (fz * nx - fx * nz) * over,
                      uz = (fx * ny - fy * nx) * over;
    const scalar_wide vx = (ny * ez - nz * ey) * over, vy = (nz * ex - nx * ez) * over,
                      vz = (nx * ey - ny * ex) * over;
    planes[0] = ux, planes[1] = uy, planes[2] = uz, planes[3] = -(ux * a.x + uy * a.y + uz * a.z);
    planes[4] = vx, planes[5] = vy, planes[6] = vz, planes[7] = -(vx * a.x + vy * a.y + vz * a.z);
    planes[8] = nx, planes[9] = ny, planes[10] = nz, planes[11] = nx * a.x + ny * a.y + nz * a.z;
}

typedef RayLanes Frame;

inline Frame intersector_setup(const RayLanes ray) { return ray; }

inline mask intersector_test(const Frame *f, const Planes *s, real *t, real *u, real *v)
{
    const real determinant = s->zx * f->dx + s->zy * f->dy + s->zz * f->dz;
    const real distance = s->zw - (s->zx * f->ox + s->zy * f->oy + s->zz * f->oz);
    const real x = f->ox * determinant + f->dx * distance;
    const real y = f->oy * determinant + f->dy * distance;
    const real z = f->oz * determinant + f->dz * distance;
    const real sign = copysign((real)1.0f, determinant);
    const real size = fabs(determinant);
    const real a = sign * (s->xx * x + s->xy * y + s->xz * z + s->xw * determinant);
    const real b = sign * (s->yx * x + s->yy * y + s->yz * z + s->yw * determinant);
    const mask inside = (a >= 0.0f) & (b >= 0.0f) & (a + b <= size) & (size > 0.0f);
    if (!mask_any(inside))
        return inside;

    const real inverse = 1.0f / size;
    *t = sign * distance * inverse;
    *u = a * inverse;
    *v = b * inverse;
    return inside;
}
