// Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection", with everything after loading in double
// precision: what accuracy costs when it is bought with width.
//
//   as woop_benthin_wald.cl; the shear is not rounded to float32 either
//
// flops: 32 in double precision to accept or reject beside the selections, +11 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed; needs double precision.
// Watertight: only without contraction; with it rays exactly through edges leak, in double precision too.
// Known failures: contraction; coplanar rays; spawned rays that hit where they start; slow where doubles are.

typedef struct {
    wide ox, oy, oz;
    wide_mask by_x, by_y;
    wide sx, sy, sz;
} Frame;

inline wide first_axis(const Frame *f, wide x, wide y, wide z) { return pick(pick(x, z, f->by_y), y, f->by_x); }
inline wide second_axis(const Frame *f, wide x, wide y, wide z) { return pick(pick(y, x, f->by_y), z, f->by_x); }
inline wide last_axis(const Frame *f, wide x, wide y, wide z) { return pick(pick(z, y, f->by_y), x, f->by_x); }

inline Frame intersector_setup(const RayLanes ray)
{
    const wide dx = widen(ray.dx), dy = widen(ray.dy), dz = widen(ray.dz);
    const real ax = fabs(ray.dx), ay = fabs(ray.dy), az = fabs(ray.dz);
    const mask by_x = (ax >= ay) & (ax >= az), by_y = mask_not(by_x) & (ay >= az);
    Frame f;
    f.ox = widen(ray.ox), f.oy = widen(ray.oy), f.oz = widen(ray.oz);
    f.by_x = widen_mask(by_x), f.by_y = widen_mask(by_y);
    const wide last = last_axis(&f, dx, dy, dz);
    f.sx = first_axis(&f, dx, dy, dz) / last;
    f.sy = second_axis(&f, dx, dy, dz) / last;
    f.sz = 1.0 / last;
    return f;
}

typedef struct {
    wide x, y, z;
} Sheared;

inline Sheared shear(const Frame *f, real x, real y, real z)
{
    const wide px = widen(x) - f->ox, py = widen(y) - f->oy, pz = widen(z) - f->oz;
    const wide last = last_axis(f, px, py, pz);
    Sheared p;
    p.x = first_axis(f, px, py, pz) - f->sx * last;
    p.y = second_axis(f, px, py, pz) - f->sy * last;
    p.z = f->sz * last;
    return p;
}

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    const Sheared a = shear(f, s->x0, s->y0, s->z0);
    const Sheared b = shear(f, s->x1, s->y1, s->z1);
    const Sheared c = shear(f, s->x2, s->y2, s->z2);
    const wide e0 = c.x * b.y - c.y * b.x;
    const wide e1 = a.x * c.y - a.y * c.x;
    const wide e2 = b.x * a.y - b.y * a.x;
    const wide sum = e0 + e1 + e2;
    const wide_mask found =
        (((e0 >= 0.0) & (e1 >= 0.0) & (e2 >= 0.0)) | ((e0 <= 0.0) & (e1 <= 0.0) & (e2 <= 0.0))) &
        ((sum > 0.0) | (sum < 0.0));
    const mask inside = narrow_mask(found);
    if (!mask_any(inside))
        return inside;

    const wide inverse = 1.0 / sum;
    *t = narrow((e0 * a.z + e1 * b.z + e2 * c.z) * inverse);
    *u = narrow(e1 * inverse);
    *v = narrow(e2 * inverse);
    return inside;
}
