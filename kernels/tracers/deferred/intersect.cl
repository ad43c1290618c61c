// Intersection of the bins of the deferred tracer: one chunk of a bin against its cell's triangles.
#include "tracers/hit_policy.clh"

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
