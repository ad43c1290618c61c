// Ellis, Shaffer & Hart's ray-space test in the sheared frame of Woop, Benthin & Wald 2013: with k the direction's
// largest component,
//
//   u = e_i - (d_i / d_k) e_k,  v = e_j - (d_j / d_k) e_k,  depth axis e_k / d_k
//   X_i = (p_i - o) . u,  Y_i = (p_i - o) . v,  otherwise as ray_space.cl
//
// A frame needs not be orthonormal for the signs of the edge functions. This one's entries 0 and 1 are exact, so that
// X_i and Y_i see a rounded factor once, and rays of different k lie side by side in lanes without a permutation.
// flops: 66 to accept or reject, +58 and two divisions on a hit. Bytes a triangle: 36, nothing precomputed.
// Watertight: yes, contraction on or off, for the reason given in ray_space.cl.
// Known failures: t of triangles so thin that their edges' rounding tilts the plane.

#define DEPTH_ERROR 0x1p-21f  // eight roundings of the farthest vertex's depth

typedef struct {
    real ox, oy, oz;
    real ux, uy, uz;
    real vx, vy, vz;
    real dx, dy, dz;  // depth axis
    real rx, ry, rz;  // direction
} Frame;

inline Frame intersector_setup(const RayLanes ray)
{
    const real ax = fabs(ray.dx), ay = fabs(ray.dy), az = fabs(ray.dz);
    const mask by_x = (ax >= ay) & (ax >= az), by_y = mask_not(by_x) & (ay >= az);
    const real zero = 0.0f, one = 1.0f;
    const real largest = pick(pick(ray.dz, ray.dy, by_y), ray.dx, by_x);
    const real inverse = one / largest;
    const real sx = ray.dx / largest, sy = ray.dy / largest, sz = ray.dz / largest;
    Frame f;
    f.ox = ray.ox, f.oy = ray.oy, f.oz = ray.oz;
    f.rx = ray.dx, f.ry = ray.dy, f.rz = ray.dz;
    // (i, j, k) is (y, z, x), (z, x, y) or (x, y, z).
    f.ux = pick(pick(one, zero, by_y), -sy, by_x);
    f.uy = pick(pick(zero, -sz, by_y), one, by_x);
    f.uz = pick(pick(-sx, one, by_y), zero, by_x);
    f.vx = pick(pick(zero, one, by_y), -sz, by_x);
    f.vy = pick(pick(one, -sx, by_y), zero, by_x);
    f.vz = pick(pick(-sy, zero, by_y), one, by_x);
    f.dx = pick(zero, inverse, by_x);
    f.dy = pick(zero, inverse, by_y);
    f.dz = pick(inverse, zero, by_x | by_y);
    return f;
}

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const real px0 = s->x0 - f->ox, py0 = s->y0 - f->oy, pz0 = s->z0 - f->oz;
    const real px1 = s->x1 - f->ox, py1 = s->y1 - f->oy, pz1 = s->z1 - f->oz;
    const real px2 = s->x2 - f->ox, py2 = s->y2 - f->oy, pz2 = s->z2 - f->oz;
    const real x0 = fma(px0, f->ux, fma(py0, f->uy, pz0 * f->uz));
    const real y0 = fma(px0, f->vx, fma(py0, f->vy, pz0 * f->vz));
    const real x1 = fma(px1, f->ux, fma(py1, f->uy, pz1 * f->uz));
    const real y1 = fma(px1, f->vx, fma(py1, f->vy, pz1 * f->vz));
    const real x2 = fma(px2, f->ux, fma(py2, f->uy, pz2 * f->uz));
    const real y2 = fma(px2, f->vx, fma(py2, f->vy, pz2 * f->vz));
    const real e0 = difference_of_products(x1, y2, x2, y1);
    const real e1 = difference_of_products(x2, y0, x0, y2);
    const real e2 = difference_of_products(x0, y1, x1, y0);
    const mask inside = (min(e0, min(e1, e2)) >= 0.0f) | (max(e0, max(e1, e2)) <= 0.0f);
    if (!mask_any(inside))
        return inside;

    // On the triangle's plane, and within rounding of the mean of the vertices' depths; see ray_space.cl.
    const real z0 = fma(px0, f->dx, fma(py0, f->dy, pz0 * f->dz));
    const real z1 = fma(px1, f->dx, fma(py1, f->dy, pz1 * f->dz));
    const real z2 = fma(px2, f->dx, fma(py2, f->dy, pz2 * f->dz));
    const real ax = s->x1 - s->x0, ay = s->y1 - s->y0, az = s->z1 - s->z0;
    const real bx = s->x2 - s->x0, by = s->y2 - s->y0, bz = s->z2 - s->z0;
    const real nx = difference_of_products(ay, bz, az, by);
    const real ny = difference_of_products(az, bx, ax, bz);
    const real nz = difference_of_products(ax, by, ay, bx);
    const real depth = fma(nx, px0, fma(ny, py0, nz * pz0));
    const real slope = fma(nx, f->rx, fma(ny, f->ry, nz * f->rz));
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
