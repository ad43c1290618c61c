// Intersection of the bins of the deferred tracer, and of everything by brute force.
#include "tracers/chunk.clh"

// Deferred intersection: one chunk of a bin against its cell's triangles.
kernel void intersect_bins(const int chunks, global const int *chunk_cell, global const int *chunk_start,
                           global const int *cell_count, global const Pair *pairs, global const int *cell_start,
                           global const int *references, global const float *triangles, global const Ray *rays,
                           global ulong *keys COUNTERS)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const int cell = chunk_cell[chunk];
    const int begin = cell_start[cell], end = cell_start[cell + 1];
    const int used = min(cell_count[cell] - (chunk - chunk_start[cell]) * LANES, LANES);
    real best_t;
    lane_index ray_of_lane, best = (lane_index)(-1);
#ifdef COPY_RAYS
    const RayLanes lanes = load_rays(pairs + (size_t)chunk * LANES, used, &best_t, &ray_of_lane);
#else
    const RayLanes lanes = gather_rays(rays, keys, pairs + (size_t)chunk * LANES, used, &best_t, &ray_of_lane);
#endif
    fetch_keys(keys, ray_of_lane);
    test_chunk(&lanes, used, triangles, references, begin, end, &best_t, &best);
    keep_hits(keys, ray_of_lane, best_t, best);
    COUNT_CHUNK(used, end - begin)
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
    const RayLanes lanes = gather_rays(rays, keys, pairs + (size_t)chunk * LANES, LANES, &best_t, &ray_of_lane);
    const Frame frame = intersector_setup(lanes);
    test_triangles(&frame, triangles, active_triangles, begin, end, &best_t, &best);
    keep_hits(keys, ray_of_lane, best_t, best);
    COUNT_TESTS_OF(used_lanes(ray_of_lane), end - begin, LANES * (ulong)(end - begin))
}
