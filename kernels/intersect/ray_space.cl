// Ellis, Shaffer & Hart, "Deferred Ray Tracing Using Intersection Binning", section 2: the triangle is taken into ray
// space and a 2D point-in-polygon test decides. The frame is the sheared one of Woop, Benthin & Wald 2013: with k the
// direction's largest component,
//
//   u = e_i - (d_i / d_k) e_k,  v = e_j - (d_j / d_k) e_k
//   X_i = (p_i - o) . u,  Y_i = (p_i - o) . v      six dot products, of two terms each
//   (E0, E1, E2) = (X0,X1,X2) x (Y0,Y1,Y2)         one cross product: the three edge functions
//   hit when no two edge functions differ in sign; t = n . (p_0 - o) / n . d,  n = (p_1 - p_0) x (p_2 - p_0)
//
// The signs ask of a frame only that it spans the plane across the ray. This one is rounded once, has two terms a dot
// product, and leaves registers free; z changes places with axis k, a selection a lane. A mirrored frame is as good.
// A plain rounded cross product is watertight too, but rounds to zero for small triangles far from the ray's origin
// and then reports hits hundreds of units beside the ray; Kahan's difference of products does not. The mean of the
// vertices' depths weighted by E_i would serve as t, but on a large triangle it is off by an ulp of the vertices'
// distance, which turns into self-hits where a ray starts on the triangle. The plane's t is right there and wrong
// where the ray lies in the plane, so that t is the plane's, held to within DEPTH_ERROR of the mean.
// flops: 39 to accept or reject beside the selections, +53 and two divisions on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: yes, contraction on or off: X_i and Y_i depend on vertex and ray alone, and a difference of products
// within 1.5 ulp never has the wrong sign.
// Known failures: t of triangles so thin that their edges' rounding tilts the plane.

#define DEPTH_ERROR 0x1p-21f  // eight roundings of the farthest vertex's depth

typedef struct {
    real ox, oy, oz;
    mask by_x, by_y;  // axis k is x, y, else z
    real sx, sy;      // d_i / d_k and d_j / d_k
    real sz;          // 1 / d_k
    real dx, dy, dz;
} Frame;

inline Frame intersector_setup(const RayLanes ray)
{
    const real ax = fabs(ray.dx), ay = fabs(ray.dy), az = fabs(ray.dz);
    Frame f;
    f.ox = ray.ox, f.oy = ray.oy, f.oz = ray.oz;
    f.dx = ray.dx, f.dy = ray.dy, f.dz = ray.dz;
    f.by_x = (ax >= ay) & (ax >= az);
    f.by_y = mask_not(f.by_x) & (ay >= az);
    const real longest = pick(pick(ray.dz, ray.dy, f.by_y), ray.dx, f.by_x);
    f.sx = pick(ray.dx, ray.dz, f.by_x) / longest;
    f.sy = pick(ray.dy, ray.dz, f.by_y) / longest;
    f.sz = 1.0f / longest;
    return f;
}

// A vertex relative to the origin across the ray, and its coordinate along axis k.
typedef struct {
    real x, y, along;
} Across;

inline Across across(const Frame *f, real px, real py, real pz)
{
    Across a;
    a.along = pick(pick(pz, py, f->by_y), px, f->by_x);
    a.x = fma(-f->sx, a.along, pick(px, pz, f->by_x));
    a.y = fma(-f->sy, a.along, pick(py, pz, f->by_y));
    return a;
}

// Only a hit computes t: on the triangle's plane, by a normal without cancellation, and within the rounding error of
// the mean of the vertices' depths, which keeps the hit of a coplanar ray on its triangle. A NaN stays one. Not
// inlined: its registers would be taken from the loop over triangles, a third of whose speed that costs.
cold_path mask finish_hit(const Frame *f, const Triangle *s, const Across *corners, const real *edge,
                          real *t, real *u, real *v)
{
    const real px = s->x0 - f->ox, py = s->y0 - f->oy, pz = s->z0 - f->oz;
    const real ax = s->x1 - s->x0, ay = s->y1 - s->y0, az = s->z1 - s->z0;
    const real bx = s->x2 - s->x0, by = s->y2 - s->y0, bz = s->z2 - s->z0;
    const real nx = difference_of_products(ay, bz, az, by);
    const real ny = difference_of_products(az, bx, ax, bz);
    const real nz = difference_of_products(ax, by, ay, bx);
    const real depth = fma(nx, px, fma(ny, py, nz * pz));
    const real slope = fma(nx, f->dx, fma(ny, f->dy, nz * f->dz));
    const real z0 = corners[0].along * f->sz, z1 = corners[1].along * f->sz, z2 = corners[2].along * f->sz;
    const real sum = edge[0] + edge[1] + edge[2];
    const real inverse = 1.0f / sum;
    const real between = fma(edge[0], z0, fma(edge[1], z1, edge[2] * z2)) * inverse;
    const real reach = DEPTH_ERROR * max(fabs(z0), max(fabs(z1), fabs(z2)));
    const real plane = depth / slope;
    const real above = pick(plane, between - reach, plane < between - reach);
    *t = pick(above, between + reach, above > between + reach);
    *u = edge[1] * inverse;
    *v = edge[2] * inverse;
    return (sum > 0.0f) | (sum < 0.0f);
}

// The vertices across the ray, and whether the ray passes inside: where no two edge functions differ in sign. One
// cross product gives those, without cancellation: zero only where it is exact.
inline mask edge_functions(const Frame *f, const Triangle *s, Across *corners, real *edge)
{
    const Across a = across(f, s->x0 - f->ox, s->y0 - f->oy, s->z0 - f->oz);
    const Across b = across(f, s->x1 - f->ox, s->y1 - f->oy, s->z1 - f->oz);
    const Across c = across(f, s->x2 - f->ox, s->y2 - f->oy, s->z2 - f->oz);
    const real e0 = difference_of_products(b.x, c.y, c.x, b.y);
    const real e1 = difference_of_products(c.x, a.y, a.x, c.y);
    const real e2 = difference_of_products(a.x, b.y, b.x, a.y);
    corners[0] = a, corners[1] = b, corners[2] = c;
    edge[0] = e0, edge[1] = e1, edge[2] = e2;
    return (min(e0, min(e1, e2)) >= 0.0f) | (max(e0, max(e1, e2)) <= 0.0f);
}

#define INSIDE_FIRST
inline mask intersector_inside(const Frame *f, const Triangle *s)
{
    Across corners[3];
    real edge[3];
    return edge_functions(f, s, corners, edge);
}

inline mask intersector_test(const Frame *f, const Triangle *s, real *t, real *u, real *v)
{
    Across corners[3];
    real edge[3];
    const mask inside = edge_functions(f, s, corners, edge);
    if (!mask_any(inside))
        return inside;
    return inside & finish_hit(f, s, corners, edge, t, u, v);
}
