// Traversal of the deferred tracer: walks rays through the grid without testing any triangle. A wave takes
// at most `wave` non-empty cells a ray, in order of encounter (paper, section 2).
#include "common.clh"
#include "tracers/refill.clh"

hot_path Group load_group(const Grid grid, int first, int active_count, global const int *active,
                          global const Ray *rays, global const ulong *keys, global const ulong *positions,
                          global const float *t_exit)
{
    Seats seats;
    fill_seats(&seats, first, active_count, active, rays, keys, positions, t_exit);
    return take_seats(&seats, grid);
}

// Keeps where each ray stopped, or that it has left the grid.
hot_path void save_group(const Group *g, const Grid grid, int first, int active_count, global const int *active,
                       global ulong *positions, global float *t_exit)
{
    int cell[3][WALK_LANES], inside[WALK_LANES];
    float t[WALK_LANES];
    walk_store(g->walk.x.cell, cell[0]), walk_store(g->walk.y.cell, cell[1]), walk_store(g->walk.z.cell, cell[2]);
    walk_store(walk_inside(&g->walk, grid_resolution(grid)), inside);
    walk_store(g->walk.t_exit, t);
    for (int lane = 0; lane < WALK_LANES && first + lane < active_count; ++lane) {
        const int i = active[first + lane];
        if (positions[i] == LEFT_GRID)
            continue;
        positions[i] = inside[lane] ? pack_position(cell[0][lane], cell[1][lane], cell[2][lane]) : LEFT_GRID;
        t_exit[i] = t[lane];
    }
}

#define WALK_ARGUMENTS                                                                                      \
    const int active_count, global const int *active, global const Ray *rays, global const ulong *keys,     \
        GRID_ARGUMENTS, const int wave
#define LOAD_GROUP                                                                                          \
    const int first = get_global_id(0) * WALK_LANES;                                                        \
    if (first >= active_count)                                                                              \
        return;                                                                                             \
    const Grid grid = GRID_VALUES;                                                                          \
    Group group = load_group(grid, first, active_count, active, rays, keys, positions, t_exit);

// First pass of the two-pass arrangement: counts ray visits to each cell.
kernel void count_pairs(WALK_ARGUMENTS, global const ulong *positions, global const float *t_exit,
                        global int *cell_count COUNTERS)
{
    LOAD_GROUP
    BEGIN_COUNTS
    while (walk_any(group.go)) {
        count_steps(group.go);
        int cell[WALK_LANES];
        const walk_int met = group_step(&group, grid, wave);
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
        walk_store(group_step(&group, grid, wave), cell);
        for (int lane = 0; lane < WALK_LANES; ++lane)
            if (cell[lane] != NO_CELL)
                pairs[atomic_inc(cursor + cell[lane])] = pair_of(active[first + lane], rays, keys);
    }
    save_group(&group, grid, first, active_count, active, positions, t_exit);
}

// Walks once and remembers each ray's cells, here at most `wave` of them in `wave` + 1 slots a ray: every step
// stores, a met cell moves on. A work-item walks `together` rays: every EXCHANGE steps, lanes that are through take
// the next.
kernel void record_pairs(WALK_ARGUMENTS, const int together, global ulong *positions, global float *t_exit,
                         global int *recorded, global int *recorded_count COUNTERS)
{
    int next = get_global_id(0) * together;
    if (next >= active_count)
        return;
    const int end = min(next + together, active_count), slots = wave + 1, nowhere = next * slots + wave;
    const Grid grid = GRID_VALUES;
    Seats seats;
    next = fill_seats(&seats, next, end, active, rays, keys, positions, t_exit);
    BEGIN_COUNTS
    for (int seated = 1; seated;) {
        Group group = take_seats(&seats, grid);
        int place[WALK_LANES], cell[WALK_LANES];
        for (int lane = 0; lane < WALK_LANES; ++lane)
            place[lane] = seats.row[lane] < 0 ? nowhere : seats.row[lane] * slots + seats.stored[lane];
        walk_int slot = walk_load(place);
        for (int step = 0; step < EXCHANGE && walk_any(group.go); ++step) {
            count_steps(group.go);
            const walk_int met = group_step(&group, grid, wave);
            count_cells_met(met);
            walk_store(met, cell);
            walk_store(slot, place);
            for (int lane = 0; lane < WALK_LANES; ++lane)
                recorded[place[lane]] = cell[lane];
            slot += walk_where(met >= 0, (walk_int)(1));
        }
        keep_seats(&group, &seats);
        seated = 0;
        for (int lane = 0; lane < WALK_LANES; ++lane) {
            if (seats.go[lane] == 0 && seats.row[lane] >= 0) {
                recorded_count[seats.row[lane]] = seats.stored[lane];
                stand_up(&seats, lane, grid_resolution(grid), active, positions, t_exit);
                seats.row[lane] = -1;
                if (next < end)
                    sit_down(&seats, lane, next++, active, rays, keys, positions, t_exit);
            }
            seated |= seats.row[lane] >= 0;
        }
    }
    END_COUNTS
}
