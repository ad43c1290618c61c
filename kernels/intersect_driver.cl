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

// Tests a list of triangles, in ascending order, against the rays in the lanes. Nearer hits replace.
inline void test_triangles(const Frame *frame, global const float *triangles, global const int *references,
                           int begin, int end, real *best_t, lane_index *best)
{
    for (int k = begin; k < end; ++k) {
        const int primitive = references[k];
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
kernel void intersect_bins(const int chunks, global const int *chunk_cell, global const int *pairs,
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
    const RayLanes lanes = gather_rays(rays, keys, pairs + (size_t)chunk * LANES, &best_t, &ray_of_lane);
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
