// Deferred tracing in streams: each work-item bins the pairs of its own rays and intersects a bin as soon as it holds a
// chunk, while its rays and triangles are in the cache. No pair is counted, ranked or moved, and no key is shared.
#define PRIVATE_KEYS
#include "chunk.clh"
#include "seats.clh"

#define BLOCK 1024  // consecutive rays of one stream; the next ones belong to the next
#define LISTED 128  // bit of a bin's fill: the cell is on the list of those to empty at the wave's end

// What a stream works on.
typedef struct {
    global const Ray *rays;
    global ulong *keys;
    global const int *cell_start, *references;
    global const float *triangles;
    global int *bins;      // int32[cells, LANES]: the rays waiting in each cell
    global uchar *filled;  // how many, and LISTED
    global int *listed;    // cells on the list
    int listed_count;
#ifdef COUNT_WORK
    global ulong *counters;
#endif
} Stream;

// One chunk of a bin against its cell's triangles.
cold_path void intersect_chunk(const Stream *s, int cell)
{
    const int begin = s->cell_start[cell], end = s->cell_start[cell + 1];
    real best_t;
    lane_index ray_of_lane, best = (lane_index)(-1);
    const RayLanes lanes = gather_rays(s->rays, s->keys, s->bins + (size_t)cell * LANES, &best_t, &ray_of_lane);
    const Frame frame = intersector_setup(lanes);
    test_triangles(&frame, s->triangles, s->references, begin, end, &best_t, &best);
    keep_hits(s->keys, ray_of_lane, best_t, best);
#ifdef COUNT_WORK
    global ulong *counters = s->counters;
#endif
    COUNT_CHUNK(ray_of_lane, end - begin)
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
        intersect_chunk(s, cell);
}

// Intersects the chunks that are not full, in the order in which their cells were first met.
inline void empty_bins(Stream *s)
{
    for (int i = 0; i < s->listed_count; ++i) {
        const int cell = s->listed[i], count = s->filled[cell] & ~LISTED;
        s->filled[cell] = 0;
        for (int slot = count; slot < LANES; ++slot)
            s->bins[(size_t)cell * LANES + slot] = -1;
        if (count > 0)
            intersect_chunk(s, cell);
    }
    s->listed_count = 0;
}

// Walks every active ray through at most `wave` non-empty cells, as in traverse.cl, into the bins.
hot_path void walk_wave(Stream *s, const Grid grid, int active_count, global const int *active, int wave,
                        global ulong *positions, global float *t_exit COUNTERS)
{
    Seats seats;
    int next = 0, ray[WALK_LANES];
    for (int lane = 0; lane < WALK_LANES; ++lane) {
        sit_down(&seats, lane, min(next, active_count - 1), active, s->rays, s->keys, positions, t_exit);
        ray[lane] = active[seats.row[lane]];
        if (next == active_count)
            seats.row[lane] = -1, seats.go[lane] = 0;
        else
            next++;
    }
    BEGIN_COUNTS
    for (int seated = 1; seated;) {
        Group group = take_seats(&seats, grid);
        // Every step writes; a cell met moves on.
        int met_cell[(EXCHANGE + 1) * WALK_LANES], met_ray[(EXCHANGE + 1) * WALK_LANES], count = 0;
        for (int step = 0; step < EXCHANGE && walk_any(group.go); ++step) {
            count_steps(group.go);
            int cell[WALK_LANES];
            const walk_int met = group_step(&group, grid, wave);
            count_cells_met(met);
            walk_store(met, cell);
#pragma unroll
            for (int lane = 0; lane < WALK_LANES; ++lane) {
                met_cell[count] = cell[lane], met_ray[count] = ray[lane];
                count += cell[lane] >= 0;
            }
        }
        keep_seats(&group, &seats);
        for (int i = 0; i < count; ++i)
            append_pair(s, met_cell[i], met_ray[i]);
        seated = 0;
        for (int lane = 0; lane < WALK_LANES; ++lane) {
            if (seats.go[lane] == 0 && seats.row[lane] >= 0) {
                stand_up(&seats, lane, grid_resolution(grid), active, positions, t_exit);
                seats.row[lane] = -1;
                if (next < active_count) {
                    ray[lane] = active[next];
                    sit_down(&seats, lane, next++, active, s->rays, s->keys, positions, t_exit);
                }
            }
            seated |= seats.row[lane] >= 0;
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
                         global const Ray *rays, global ulong *keys, GRID_ARGUMENTS, global ulong *positions,
                         global float *t_exit, global const int *cell_start, global const int *references,
                         global const float *triangles, const int cells, global int *active_rays, global int *bins,
                         global uchar *filled, global int *listed COUNTERS)
{
    const size_t id = get_global_id(0);
    if (id >= (size_t)streams)
        return;
    const Grid grid = GRID_VALUES;
    Stream s = {rays, keys, cell_start, references, triangles, bins + id * cells * LANES, filled + id * cells,
                listed + id * (cells + 1), 0};
    global int *active = active_rays + id * active_room;
    int active_count = 0;
    for (size_t first = id * BLOCK; first < (size_t)count; first += (size_t)streams * BLOCK)
        for (int i = (int)first; i < min((int)first + BLOCK, count); ++i)
            active[active_count++] = i;
#ifdef COUNT_WORK
    s.counters = counters;
#define COUNTERS_GIVEN , counters
#else
#define COUNTERS_GIVEN
#endif
    for (int length = wave; active_count > 0; length = min(length * growth, 1 << 24)) {
        walk_wave(&s, grid, active_count, active, length, positions, t_exit COUNTERS_GIVEN);
        empty_bins(&s);
        active_count = keep_active(active_count, active, keys, positions, t_exit);
    }
}
