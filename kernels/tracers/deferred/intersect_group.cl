// Deferred intersection as GPUs like it: one ray a work-item, a work-group for every GROUP pairs that lie side by
// side, whatever their bins. Bins are not padded, and a long one falls to several groups.
//
// A group whose pairs share a cell reads each triangle once, TILE at a time, into local memory. In a group of several
// cells each work-item goes through its own cell's list: work-items of one cell sit side by side and ask for the same
// triangle at the same time, which the cache serves at once, and nobody waits for the others' cells.
#include "tracers/hit_policy.clh"

#if LANES != 1
#error "LANES is not 1: a work-item of a group has one ray"
#endif
#ifndef GROUP
#error "GROUP not defined: work-items of a group"
#endif
#define TILE GROUP  // triangles

// The bin among [low, high) that holds pair `i`: the last that begins at `i` or before.
inline int bin_of(global const int *bin_start, int low, int high, int i)
{
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (bin_start[middle] <= i)
            low = middle;
        else
            high = middle;
    }
    return low;
}

// As test_triangles, from local memory.
inline void test_tile(const Frame *frame, local const float *tile, local const int *primitives, int count,
                      real *best_t, lane_index *best)
{
    for (int k = 0; k < count; ++k) {
        local const float *p = tile + k * STORED_FLOATS;
        const Stored triangle = STORED_OF((real), p);
        real t = 0.0f, u, v;
        if (intersector_test(frame, &triangle, &t, &u, &v) && accepted(t, *best_t)) {
            *best_t = t;
            *best = primitives[k];
        }
    }
}

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void
intersect_bins_group(const int count, const int cells, global const int *bin_start, global const Pair *pairs,
                     global const int *cell_start, global const int *references, global const float *triangles,
                     global const Ray *rays, global ulong *keys COUNTERS)
{
    local float tile[TILE * STORED_FLOATS];
    local int primitives[TILE], ends[2];
    const int me = get_local_id(0), first = get_group_id(0) * GROUP, last = min(first + GROUP, count) - 1;
    const int place = min(first + me, last);
    if (me < 2)
        ends[me] = bin_of(bin_start, 0, cells, me ? last : first);
    barrier(CLK_LOCAL_MEM_FENCE);
    const int shared = ends[0] == ends[1];
    const int cell = bin_of(bin_start, ends[0], ends[1] + 1, place);
    const int begin = cell_start[cell], end = cell_start[cell + 1];

    const int used = first + me <= last;  // else it helps to load, and hits nothing
    real best_t;
    lane_index ray, best = -1;
#ifdef COPY_RAYS
    const RayLanes lanes = load_rays(pairs + place, used, &best_t, &ray);
#else
    const RayLanes lanes = gather_rays(rays, keys, pairs + place, used, &best_t, &ray);
#endif

    if (shared) {
        for (int from = begin; from < end; from += TILE) {
            const int held = min(TILE, end - from);
            for (int f = me; f < held * STORED_FLOATS; f += GROUP) {
                const int k = f / STORED_FLOATS, coordinate = f % STORED_FLOATS, primitive = references[from + k];
                tile[f] = triangles[(size_t)primitive * STORED_FLOATS + coordinate];
                if (coordinate == 0)
                    primitives[k] = primitive;
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            // Made anew: Intel's runtime of 2026 for CPUs loses parts of a Frame across a barrier.
            const Frame frame = intersector_setup(lanes);
            test_tile(&frame, tile, primitives, held, &best_t, &best);
            barrier(CLK_LOCAL_MEM_FENCE);
        }
    } else if (ray >= 0) {
        const Frame frame = intersector_setup(lanes);
        test_triangles(&frame, triangles, references, begin, end, &best_t, &best);
    }
    keep_hits(keys, ray, best_t, best);
    if (shared || ray >= 0) {
        COUNT_CHUNK(ray >= 0, end - begin)
    }
}
