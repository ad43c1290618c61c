// Traversal of the deferred tracer: walks rays through a structure without testing any triangle. A wave takes
// at most `wave` cells a ray, in order of encounter (paper, section 2).
#include "common.clh"
#include "tracers/refill.clh"

// Keeps where each ray stopped, or that it has left.
hot_path void save_group(const Group *g, LaneState *lanes, const Structure structure, global const int *active,
                         global ulong *positions, global float *t_exit)
{
    store_group(g, lanes);
    for (int lane = 0; lane < WALK_LANES && lanes->row[lane] >= 0; ++lane)
        store_lane(lanes, lane, structure, active, positions, t_exit);
}

#define WALK_ARGUMENTS                                                                                      \
    const int active_count, global const int *active, global const Ray *rays, global const ulong *keys,     \
        STRUCTURE_ARGUMENTS, const int wave
#define LOAD_GROUP                                                                                          \
    const int first = get_global_id(0) * WALK_LANES;                                                        \
    if (first >= active_count)                                                                              \
        return;                                                                                             \
    const Structure structure = STRUCTURE_VALUES;                                                           \
    LaneState lanes;                                                                                        \
    fill_lanes(&lanes, first, active_count, active, rays, keys, positions, t_exit);                         \
    Group group = load_group(&lanes, structure);

// First pass of the two-pass arrangement: counts ray visits to each cell.
kernel void count_pairs(WALK_ARGUMENTS, global const ulong *positions, global const float *t_exit,
                        global int *cell_count COUNTERS)
{
    LOAD_GROUP
    BEGIN_COUNTS
    while (walk_any(group.go)) {
        count_steps(group.go);
        int cell[WALK_LANES];
        const walk_int met = group_step(&group, structure, wave);
        count_cells_met(met);
        walk_store(met, cell);
        for (int lane = 0; lane < WALK_LANES; ++lane)
            if (cell[lane] != NO_CELL)
                atomic_inc(cell_count + cell[lane]);
    }
    END_COUNTS
}

// Second pass: walks again and stores each ray in its cell's bin.
kernel void pack_pairs(WALK_ARGUMENTS, global ulong *positions, global float *t_exit, global int *cursor,
                       global Pair *pairs)
{
    LOAD_GROUP
    while (walk_any(group.go)) {
        int cell[WALK_LANES];
        walk_store(group_step(&group, structure, wave), cell);
        for (int lane = 0; lane < WALK_LANES; ++lane)
            if (cell[lane] != NO_CELL)
                pairs[atomic_inc(cursor + cell[lane])] = pair_of(active[first + lane], rays, keys);
    }
    save_group(&group, &lanes, structure, active, positions, t_exit);
}

// Walks once and remembers each ray's cells, here at most `wave` of them in `wave` + 1 slots a ray: every step
// stores, a met cell moves on. A work-item walks `together` rays: every REFILL_STEPS steps, lanes that are through take
// the next.
kernel void record_pairs(WALK_ARGUMENTS, const int together, global ulong *positions, global float *t_exit,
                         global int *recorded, global int *recorded_count COUNTERS)
{
    int next = get_global_id(0) * together;
    if (next >= active_count)
        return;
    const int end = min(next + together, active_count), slots = wave + 1, nowhere = next * slots + wave;
    const Structure structure = STRUCTURE_VALUES;
    LaneState lanes;
    next = fill_lanes(&lanes, next, end, active, rays, keys, positions, t_exit);
    BEGIN_COUNTS
    for (int busy = 1; busy;) {
        Group group = load_group(&lanes, structure);
        int place[WALK_LANES], cell[WALK_LANES];
        for (int lane = 0; lane < WALK_LANES; ++lane)
            place[lane] = lanes.row[lane] < 0 ? nowhere : lanes.row[lane] * slots + lanes.stored[lane];
        walk_int slot = walk_load(place);
        for (int step = 0; step < REFILL_STEPS && walk_any(group.go); ++step) {
            count_steps(group.go);
            const walk_int met = group_step(&group, structure, wave);
            count_cells_met(met);
            walk_store(met, cell);
            walk_store(slot, place);
            for (int lane = 0; lane < WALK_LANES; ++lane)
                recorded[place[lane]] = cell[lane];
            slot += walk_where(met >= 0, (walk_int)(1));
        }
        store_group(&group, &lanes);
        busy = 0;
        for (int lane = 0; lane < WALK_LANES; ++lane) {
            if (lanes.go[lane] == 0 && lanes.row[lane] >= 0) {
                recorded_count[lanes.row[lane]] = lanes.stored[lane];
                store_lane(&lanes, lane, structure, active, positions, t_exit);
                lanes.row[lane] = -1;
                if (next < end)
                    load_lane(&lanes, lane, next++, active, rays, keys, positions, t_exit);
            }
            busy |= lanes.row[lane] >= 0;
        }
    }
    END_COUNTS
}
