// Deferred tracing in streams: each work-item bins the pairs of its own rays and intersects a bin as soon as it holds
// a chunk, while its rays and triangles are in the cache. No pair is counted, ranked or moved, and no key is shared.
#include "tracers/hit_policy.clh"
#include "tracers/refill.clh"

// BLOCK: consecutive rays of one stream, from the host; the next ones belong to the next.
#define QUEUE 4     // chunks between the one asked for and the one intersected
#define LISTED 128  // bit of a bin's fill: the cell is on the list of those to empty at the wave's end

// A chunk of one cell's rays; -1 for a lane without a ray.
typedef struct {
    int cell, ray[LANES];
} Chunk;

// What a stream works on. A ray's t_max is its best t so far.
typedef struct {
    global Ray *rays;
    global ulong *keys;
    global const int *cell_start, *references;
    global const float *triangles;
    global int *bins;      // int32[cells, LANES]: the rays waiting in each cell
    global uchar *filled;  // how many, and LISTED
    global int *listed;    // cells on the list
    int listed_count;
    Chunk queue[QUEUE];  // full chunks whose rays and references have been asked for
    uint queued;
#ifdef COUNT_WORK
    global ulong *counters, *wave_counters;
#endif
} Stream;

// Counted beside the usual: unused lanes of chunks, then the rays that finish in each wave.
#ifdef COUNT_WORK
#define WAVE_COUNTERS COUNTERS, global ulong *wave_counters
#define count_wave(which, amount) atom_add(s.wave_counters + (which), (ulong)(amount))
#else
#define WAVE_COUNTERS
#define count_wave(which, amount)
#endif

// The least float above non-negative ones, infinity for infinity.
inline real just_above_each(real t)
{
#if LANES == 1
    return just_above(t);
#else
    return JOIN(as_float, LANES)(min(JOIN(as_int, LANES)(t) + 1, 0x7f800000));
#endif
}

// Rays of a chunk; a lane without a ray has a best t that nothing is below.
hot_path RayLanes gather_chunk(const Stream *s, lane_index ray_of_lane, real *best_t)
{
    int row[LANES];
    store_lanes(max(ray_of_lane, (lane_index)(0)), row);
#if LANES == 1
    const Ray r = s->rays[row[0]];
    const RayLanes lanes = {r.ox, r.oy, r.oz, r.dx, r.dy, r.dz};
    const real t = r.t_max;
#else
    real column[8];
    gather_rows((global const float *)s->rays, 8, row, column);
    const RayLanes lanes = {column[0], column[1], column[2], column[4], column[5], column[6]};
    const real t = column[3];
#endif
    *best_t = pick(just_above_each(t), (real)(-1.0f), ray_of_lane < 0);
    return lanes;
}

// A chunk against its cell's triangles.
cold_path void intersect_chunk(const Stream *s, const Chunk *chunk)
{
    const int begin = s->cell_start[chunk->cell], end = s->cell_start[chunk->cell + 1];
    real best_t;
    const lane_index ray_of_lane = load_lane_indices(chunk->ray);
    const int used = used_lanes(ray_of_lane);
    lane_index best = (lane_index)(-1);
    const RayLanes lanes = gather_chunk(s, ray_of_lane, &best_t);
    test_chunk(&lanes, used, s->triangles, s->references, begin, end, &best_t, &best);
    if (mask_any(best >= 0)) {
        float t[LANES];
        int primitive[LANES];
        store_lanes(best_t, t);
        store_lanes(best, primitive);
        for (int lane = 0; lane < LANES; ++lane)
            if (primitive[lane] >= 0) {
                const int i = chunk->ray[lane];
                const ulong key = hit_key(t[lane], (uint)primitive[lane]);
                // Read only for a tie: a key that is only written keeps nobody waiting.
                s->keys[i] = t[lane] < s->rays[i].t_max ? key : min(s->keys[i], key);
                s->rays[i].t_max = t[lane];
            }
    }
#ifdef COUNT_WORK
    global ulong *counters = s->counters;
    atom_add(s->wave_counters, (ulong)(LANES - used));
#endif
    COUNT_CHUNK(used, end - begin)
}

// Moves a cell's chunk into the queue, asks for what it needs, and intersects the oldest one there.
cold_path void queue_chunk(Stream *s, int cell)
{
    Chunk *chunk = s->queue + s->queued % QUEUE;
    if (s->queued >= QUEUE) {
        const int next = s->queue[(s->queued + 1) % QUEUE].cell;
        fetch_triangles(s->triangles, s->references, s->cell_start[next], s->cell_start[next + 1]);
        intersect_chunk(s, chunk);
    }
    chunk->cell = cell;
    for (int lane = 0; lane < LANES; ++lane)
        chunk->ray[lane] = s->bins[(size_t)cell * LANES + lane];
#ifdef fetch_line
    for (int lane = 0; lane < LANES; ++lane)
        fetch_line(s->rays + max(chunk->ray[lane], 0));
    fetch_line(s->references + s->cell_start[cell]);
#endif
    s->queued++;
}

// Puts a ray into the bin of a cell that it meets.
hot_path void append_pair(Stream *s, int cell, int ray)
{
    const int fill = s->filled[cell], count = (fill & ~LISTED) + 1;
    s->listed[s->listed_count] = cell;
    s->listed_count += fill == 0;
    s->bins[(size_t)cell * LANES + count - 1] = ray;
    s->filled[cell] = LISTED | (count == LANES ? 0 : count);
    if (count == LANES)
        queue_chunk(s, cell);
}

// Intersects the chunks that are not full, in the order in which their cells were first met, and those in the queue.
inline void empty_bins(Stream *s)
{
    for (int i = 0; i < s->listed_count; ++i) {
        const int cell = s->listed[i], count = s->filled[cell] & ~LISTED;
        s->filled[cell] = 0;
        for (int slot = count; slot < LANES; ++slot)
            s->bins[(size_t)cell * LANES + slot] = -1;
        if (count > 0)
            queue_chunk(s, cell);
    }
    s->listed_count = 0;
    for (uint i = s->queued > QUEUE ? s->queued - QUEUE : 0; i < s->queued; ++i)
        intersect_chunk(s, s->queue + i % QUEUE);
    s->queued = 0;
}

// Asks for what a ray needs that soon takes a lane.
hot_path void fetch_ray(const Stream *s, int i, global ulong *positions, global float *t_exit)
{
#ifdef fetch_line
    fetch_line(s->rays + i);
    fetch_line(s->keys + i);
    fetch_line(positions + i);
    fetch_line(t_exit + i);
#endif
}

// Walks every active ray through at most `wave` cells, as in deferred/walk.cl, into the bins.
hot_path void walk_wave(Stream *s, const Structure structure, int active_count, global const int *active, int wave,
                        global ulong *positions, global float *t_exit COUNTERS)
{
    LaneState lanes;
    int ray[WALK_LANES];
    int next = fill_lanes(&lanes, 0, active_count, active, s->rays, s->keys, positions, t_exit);
    for (int lane = 0; lane < WALK_LANES; ++lane)
        ray[lane] = active[max(lanes.row[lane], 0)];
    BEGIN_COUNTS
    for (int busy = 1; busy;) {
        Group group = load_group(&lanes, structure);
        // Every step writes; a cell met moves on.
        int met_cell[(REFILL_STEPS + 1) * WALK_LANES], met_ray[(REFILL_STEPS + 1) * WALK_LANES], count = 0;
        for (int step = 0; step < REFILL_STEPS && walk_any(group.go); ++step) {
            count_steps(group.go);
            int cell[WALK_LANES];
            const walk_int met = group_step(&group, structure, wave);
            count_cells_met(met);
            walk_store(met, cell);
#pragma unroll
            for (int lane = 0; lane < WALK_LANES; ++lane) {
                met_cell[count] = cell[lane], met_ray[count] = ray[lane];
                count += cell[lane] >= 0;
            }
        }
        store_group(&group, &lanes);
        for (int i = 0; i < count; ++i)
            append_pair(s, met_cell[i], met_ray[i]);
        busy = 0;
        for (int lane = 0; lane < WALK_LANES; ++lane) {
            if (lanes.go[lane] == 0 && lanes.row[lane] >= 0) {
                store_lane(&lanes, lane, structure, active, positions, t_exit);
                lanes.row[lane] = -1;
                if (next < active_count) {
                    fetch_ray(s, active[min(next + 2 * WALK_LANES, active_count - 1)], positions, t_exit);
                    ray[lane] = active[next];
                    load_lane(&lanes, lane, next++, active, s->rays, s->keys, positions, t_exit);
                }
            }
            busy |= lanes.row[lane] >= 0;
        }
    }
    END_COUNTS
}

// Keeps the unfinished rays, in order; returns their number.
inline int keep_active(int active_count, global int *active, global const ulong *keys, global const ulong *positions,
                       global const float *t_exit)
{
    int kept = 0;
    for (int a = 0; a < active_count; ++a) {
        const int i = active[a];
        active[kept] = i;
        kept += !ray_finished(positions[i], keys[i], t_exit[i]);
    }
    return kept;
}

// All waves of a stream's rays, `active_room` at most: blocks of them, every `streams`-th. `filled` is zero.
kernel void trace_stream(const int count, const int streams, const int active_room, const int wave, const int growth,
                         global Ray *rays, global ulong *keys, STRUCTURE_ARGUMENTS, global ulong *positions,
                         global float *t_exit, global const int *cell_start, global const int *references,
                         global const float *triangles, const int cells, global int *active_rays, global int *bins,
                         global uchar *filled, global int *listed WAVE_COUNTERS)
{
    const size_t id = get_global_id(0);
    if (id >= (size_t)streams)
        return;
    const Structure structure = STRUCTURE_VALUES;
    Stream s;
    s.rays = rays, s.keys = keys, s.cell_start = cell_start, s.references = references, s.triangles = triangles;
    s.bins = bins + id * cells * LANES, s.filled = filled + id * cells, s.listed = listed + id * (cells + 1);
    s.listed_count = 0, s.queued = 0;
    global int *active = active_rays + id * active_room;
    int active_count = 0;
    for (size_t first = id * BLOCK; first < (size_t)count; first += (size_t)streams * BLOCK)
        for (int i = (int)first; i < min((int)first + BLOCK, count); ++i)
            active[active_count++] = i;
#ifdef COUNT_WORK
    s.counters = counters, s.wave_counters = wave_counters;
    int waves = 0;
#define COUNTERS_GIVEN , counters
#else
#define COUNTERS_GIVEN
#endif
    for (int length = wave; active_count > 0; length = min(length * growth, 1 << 24)) {
        walk_wave(&s, structure, active_count, active, length, positions, t_exit COUNTERS_GIVEN);
        empty_bins(&s);
        const int kept = keep_active(active_count, active, keys, positions, t_exit);
        count_wave(++waves, active_count - kept);
        active_count = kept;
    }
}
