// Brute force: one chunk of rays against one block of the active triangles.
#include "tracers/hit_policy.clh"

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
    const RayLanes lanes = gather_rays(rays, keys, pairs + (size_t)chunk * LANES, LANES, &best_t, &ray_of_lane);
    const Frame frame = intersector_setup(lanes);
    test_triangles(&frame, triangles, active_triangles, begin, end, &best_t, &best);
    keep_hits(keys, ray_of_lane, best_t, best);
    COUNT_TESTS_OF(used_lanes(ray_of_lane), end - begin, LANES * (ulong)(end - begin))
}
