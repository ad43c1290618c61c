// Closest-hit policy around an intersector, for the bins of the deferred tracer and for brute force.
#include "intersect.clh"

// Rays of the pairs in one chunk; a lane without a ray has a best t that nothing is below.
inline RayLanes gather_rays(global const Ray *rays, global const ulong *keys, global const int *chunk,
                            real *best_t, lane_index *ray_of_lane)
{
    float field[7][LANES];
    int ray[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        ray[lane] = chunk[lane];
        const int i = max(ray[lane], 0);
        const Ray r = rays[i];
        field[0][lane] = r.ox, field[1][lane] = r.oy, field[2][lane] = r.oz;
        field[3][lane] = r.dx, field[4][lane] = r.dy, field[5][lane] = r.dz;
        // Other work-items may lower the key meanwhile; an older, larger t only tests more.
        field[6][lane] = ray[lane] < 0 ? -1.0f : just_above(key_t(keys[i]));
    }
    RayLanes lanes;
    lanes.ox = load_lanes(field[0]), lanes.oy = load_lanes(field[1]), lanes.oz = load_lanes(field[2]);
    lanes.dx = load_lanes(field[3]), lanes.dy = load_lanes(field[4]), lanes.dz = load_lanes(field[5]);
    *best_t = load_lanes(field[6]);
    *ray_of_lane = load_lane_indices(ray);
    return lanes;
}

#if LANES > 1
// Every second float of two vectors, from the first or from the second on: log2(8) times this turns rows of eight side
// by side into columns side by side.
#define even_of(a, b) ((real)((a).even, (b).even))
#define odd_of(a, b) ((real)((a).odd, (b).odd))

// Columns of LANES rows of eight floats, which lie one after another in f[0] to f[7].
hot_path void columns_of_eight(const real *f, real *column)
{
    const real a0 = even_of(f[0], f[1]), a1 = even_of(f[2], f[3]), a2 = even_of(f[4], f[5]), a3 = even_of(f[6], f[7]);
    const real b0 = odd_of(f[0], f[1]), b1 = odd_of(f[2], f[3]), b2 = odd_of(f[4], f[5]), b3 = odd_of(f[6], f[7]);
    const real c0 = even_of(a0, a1), c1 = even_of(a2, a3), d0 = odd_of(a0, a1), d1 = odd_of(a2, a3);
    const real e0 = even_of(b0, b1), e1 = even_of(b2, b3), g0 = odd_of(b0, b1), g1 = odd_of(b2, b3);
    column[0] = even_of(c0, c1), column[4] = odd_of(c0, c1);
    column[2] = even_of(d0, d1), column[6] = odd_of(d0, d1);
    column[1] = even_of(e0, e1), column[5] = odd_of(e0, e1);
    column[3] = even_of(g0, g1), column[7] = odd_of(g0, g1);
}
#endif

#if defined(COPY_RAYS) && LANES > 1
hot_path RayLanes load_rays(global const Pair *chunk, real *best_t, lane_index *ray_of_lane)
{
    real f[8], column[8];
    for (int i = 0; i < 8; ++i)
        f[i] = JOIN(vload, LANES)(i, (global const float *)chunk);
    columns_of_eight(f, column);
    const RayLanes lanes = {column[0], column[1], column[2], column[3], column[4], column[5]};
    *best_t = column[6];
    *ray_of_lane = JOIN(as_int, LANES)(column[7]);
    return lanes;
}
#elif defined(COPY_RAYS)
inline RayLanes load_rays(global const Pair *chunk, real *best_t, lane_index *ray_of_lane)
{
    const Pair p = *chunk;
    const RayLanes lanes = {p.s0, p.s1, p.s2, p.s3, p.s4, p.s5};
    *best_t = p.s6;
    *ray_of_lane = as_int(p.s7);
    return lanes;
}
#endif

// Asks for the cache lines of the keys that hits will lower.
inline void fetch_keys(global const ulong *keys, lane_index ray_of_lane)
{
#ifdef fetch_line
    int ray[LANES];
    store_lanes(ray_of_lane, ray);
    for (int lane = 0; lane < LANES; ++lane)
        fetch_line(keys + max(ray[lane], 0));
#endif
}

inline void keep_hits(global ulong *keys, lane_index ray_of_lane, real best_t, lane_index best)
{
    if (!mask_any(best >= 0))
        return;
    float t[LANES];
    int ray[LANES], primitive[LANES];
    store_lanes(best_t, t);
    store_lanes(ray_of_lane, ray);
    store_lanes(best, primitive);
    for (int lane = 0; lane < LANES; ++lane)
        if (primitive[lane] >= 0)
            atom_min(keys + ray[lane], hit_key(t[lane], (uint)primitive[lane]));
}

#define AHEAD 6  // triangles between the one tested and the one asked for: they lie anywhere in memory

#if defined(INSIDE_FIRST) && LANES > 1
#define as_it_is(value) (value)

// Takes the whole test of one triangle a lane, where one waits.
cold_path void settle(const Frame *frame, global const float *triangles, lane_index waiting, real *best_t,
                      lane_index *best)
{
    // Rows of eight floats are loaded whole and transposed: gathered one by one they take longer than the test.
    float rows[LANES * 8], rest[STORED_FLOATS][LANES];
    int primitive[LANES];
    store_lanes(waiting, primitive);
    for (int lane = 0; lane < LANES; ++lane) {
        global const float *p = triangles + (size_t)max(primitive[lane], 0) * STORED_FLOATS;
        vstore8(vload8(0, p), lane, rows);
        for (int c = 8; c < STORED_FLOATS; ++c)
            rest[c][lane] = p[c];
    }
    real f[8], values[STORED_FLOATS];
    for (int i = 0; i < 8; ++i)
        f[i] = JOIN(vload, LANES)(i, rows);
    columns_of_eight(f, values);
    for (int c = 8; c < STORED_FLOATS; ++c)
        values[c] = load_lanes(rest[c]);
    const Stored triangle = STORED_OF(as_it_is, values);
    real t = 0.0f, u, v;
    const mask hit = intersector_test(frame, &triangle, &t, &u, &v) & (waiting >= 0) & accepted(t, *best_t);
    *best_t = pick(*best_t, t, hit);
    *best = pick(*best, waiting, hit);
}

// Tests a list of triangles, in ascending order, against the rays in the lanes; nearer hits replace. A triangle that
// the ray of a lane passes through waits until the lane meets another, so that few tests are taken to their end, and
// those for many lanes at once.
inline void test_triangles(const Frame *frame, global const float *triangles, global const int *references,
                           int begin, int end, real *best_t, lane_index *best)
{
    const mask live = *best_t > 0.0f;
    lane_index waiting = -1;
    for (int k = begin; k < end; ++k) {
        const int primitive = references[k];
#ifdef fetch_line
        fetch_line(triangles + (size_t)references[min(k + AHEAD, end - 1)] * STORED_FLOATS);
#endif
        const Stored triangle = load_stored(triangles, primitive);
        const mask inside = intersector_inside(frame, &triangle) & live;
        // The only branch, and seldom taken: whether some ray passes inside is a coin's toss.
        if (mask_any(inside & (waiting >= 0))) {
            settle(frame, triangles, waiting, best_t, best);
            waiting = -1;
        }
        waiting = pick(waiting, (lane_index)(primitive), inside);
    }
    if (mask_any(waiting >= 0))
        settle(frame, triangles, waiting, best_t, best);
}
#else
// Tests a list of triangles, in ascending order, against the rays in the lanes. Nearer hits replace.
inline void test_triangles(const Frame *frame, global const float *triangles, global const int *references,
                           int begin, int end, real *best_t, lane_index *best)
{
    for (int k = begin; k < end; ++k) {
        const int primitive = references[k];
#ifdef fetch_line
        fetch_line(triangles + (size_t)references[min(k + AHEAD, end - 1)] * STORED_FLOATS);
#endif
        const Stored triangle = load_stored(triangles, primitive);
        real t = 0.0f, u, v;
        mask hit = intersector_test(frame, &triangle, &t, &u, &v);
        if (mask_any(hit)) {
            hit &= accepted(t, *best_t);
            *best_t = pick(*best_t, t, hit);
            *best = pick(*best, (lane_index)(primitive), hit);
        }
    }
}
#endif

// Lanes that hold a ray.
inline int used_lanes(lane_index ray_of_lane)
{
    int ray[LANES], used = 0;
    store_lanes(ray_of_lane, ray);
    for (int lane = 0; lane < LANES; ++lane)
        used += ray[lane] >= 0;
    return used;
}
#define COUNT_CHUNK(ray_of_lane, triangles)                                                                 \
    BEGIN_COUNTS                                                                                            \
    add_count(COUNT_TESTS, used_lanes(ray_of_lane) * (ulong)(triangles));                                   \
    add_count(COUNT_LANE_TESTS, LANES * (ulong)(triangles));                                                \
    END_COUNTS

// Deferred intersection: one chunk of a bin against its cell's triangles.
kernel void intersect_bins(const int chunks, global const int *chunk_cell, global const Pair *pairs,
                           global const int *cell_start, global const int *references,
                           global const float *triangles, global const Ray *rays, global ulong *keys COUNTERS)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const int cell = chunk_cell[chunk];
    const int begin = cell_start[cell], end = cell_start[cell + 1];
    real best_t;
    lane_index ray_of_lane, best = (lane_index)(-1);
#ifdef COPY_RAYS
    const RayLanes lanes = load_rays(pairs + (size_t)chunk * LANES, &best_t, &ray_of_lane);
#else
    const RayLanes lanes = gather_rays(rays, keys, pairs + (size_t)chunk * LANES, &best_t, &ray_of_lane);
#endif
    fetch_keys(keys, ray_of_lane);
    const Frame frame = intersector_setup(lanes);
    test_triangles(&frame, triangles, references, begin, end, &best_t, &best);
    keep_hits(keys, ray_of_lane, best_t, best);
    COUNT_CHUNK(ray_of_lane, end - begin)
}

// Brute force: one chunk of rays against one block of the active triangles.
kernel void intersect_all(const int chunks, const int blocks, const int block_size, global const int *pairs,
                          const int active_count, global const int *active_triangles,
                          global const float *triangles, global const Ray *rays, global ulong *keys COUNTERS)
{
    const size_t id = get_global_id(0);
    if (id >= (size_t)chunks * blocks)
        return;
    const int chunk = (int)(id % chunks), begin = (int)(id / chunks) * block_size;
    const int end = min(begin + block_size, active_count);
    real best_t;
    lane_index ray_of_lane, best = (lane_index)(-1);
    const RayLanes lanes = gather_rays(rays, keys, pairs + (size_t)chunk * LANES, &best_t, &ray_of_lane);
    const Frame frame = intersector_setup(lanes);
    test_triangles(&frame, triangles, active_triangles, begin, end, &best_t, &best);
    keep_hits(keys, ray_of_lane, best_t, best);
    COUNT_CHUNK(ray_of_lane, end - begin)
}
