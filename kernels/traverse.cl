// Traversal of the deferred tracer: walks rays through the grid without testing any triangle. A wave takes
// at most `wave` non-empty cells a ray, in order of encounter (paper, section 2).
#include "common.clh"
#include "walk.clh"

// Rays that walk together, one a lane, from where they stopped. Lanes without an unfinished ray do not `go`.
typedef struct {
    Walk walk;
    walk_real limit;  // best t so far: a ray stops beyond it
    walk_int go;
    walk_int stored;  // non-empty cells met in this wave
} Group;

// A finished ray has left the grid or has a hit no farther than the cells it has walked.
inline int ray_finished(ulong position, ulong key, float t_exit)
{
    return position == LEFT_GRID || key_t(key) <= t_exit;
}

// The rays that walk together in memory, where one can be exchanged for another.
typedef struct {
    float field[8][WALK_LANES];  // origin, direction, t_exit, best t
    int cell[3][WALK_LANES], go[WALK_LANES], stored[WALK_LANES];
    int row[WALK_LANES];         // place of the ray among the active ones, -1 for none
} Seats;

inline void sit_down(Seats *s, int lane, int row, global const int *active, global const Ray *rays,
                     global const ulong *keys, global const ulong *positions, global const float *t_exit)
{
    const int i = active[row];
    const Ray r = rays[i];
    const ulong position = positions[i], key = keys[i];
    s->field[0][lane] = r.ox, s->field[1][lane] = r.oy, s->field[2][lane] = r.oz;
    s->field[3][lane] = r.dx, s->field[4][lane] = r.dy, s->field[5][lane] = r.dz;
    s->field[6][lane] = t_exit[i], s->field[7][lane] = key_t(key);
    for (int axis = 0; axis < 3; ++axis)
        s->cell[axis][lane] = unpack_axis(position, axis);
    s->go[lane] = ray_finished(position, key, t_exit[i]) ? 0 : -1;
    s->stored[lane] = 0;
    s->row[lane] = row;
}

hot_path Group take_seats(const Seats *s, const Grid grid)
{
    Group g;
    g.walk.x = axis_setup(walk_load(s->field[0]), walk_load(s->field[3]), grid.lower.x, grid.inverse_cell.x);
    g.walk.y = axis_setup(walk_load(s->field[1]), walk_load(s->field[4]), grid.lower.y, grid.inverse_cell.y);
    g.walk.z = axis_setup(walk_load(s->field[2]), walk_load(s->field[5]), grid.lower.z, grid.inverse_cell.z);
    g.walk.x.cell = walk_load(s->cell[0]), g.walk.y.cell = walk_load(s->cell[1]);
    g.walk.z.cell = walk_load(s->cell[2]);
    g.walk.t_exit = walk_load(s->field[6]);
    g.limit = walk_load(s->field[7]);
    g.go = walk_load(s->go) != 0;
    g.stored = walk_load(s->stored);
    return g;
}

hot_path Group load_group(const Grid grid, int first, int active_count, global const int *active,
                          global const Ray *rays, global const ulong *keys, global const ulong *positions,
                          global const float *t_exit)
{
    Seats seats;
    for (int lane = 0; lane < WALK_LANES; ++lane) {
        sit_down(&seats, lane, min(first + lane, active_count - 1), active, rays, keys, positions, t_exit);
        if (first + lane >= active_count)
            seats.go[lane] = 0;
    }
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

// One step of all lanes; returns each lane's non-empty cell or NO_CELL, and stops the lanes that are through.
hot_path walk_int group_step(Group *g, const Grid grid, int wave)
{
    const walk_int cell = walk_step(&g->walk, grid, g->go);
    const walk_int met = g->go & (cell >= 0);
    g->stored += walk_where(met, (walk_int)(1));
    const walk_int enough = (g->stored >= wave) | (g->limit <= g->walk.t_exit);
    g->go &= walk_inside(&g->walk, grid_resolution(grid)) & walk_not(enough);
    return walk_pick((walk_int)(NO_CELL), cell, met);
}

#ifdef COUNT_WORK
inline int count_lanes(walk_int m)
{
    int value[WALK_LANES], total = 0;
    walk_store(m, value);
    for (int lane = 0; lane < WALK_LANES; ++lane)
        total += value[lane] != 0;
    return total;
}
#define count_steps(go) add_count(COUNT_STEPS, count_lanes(go))
#define count_cells_met(cell) add_count(COUNT_PAIRS, count_lanes((cell) >= 0))
#else
#define count_steps(go)
#define count_cells_met(cell)
#endif

#if WALK_LANES == 1
#define RAYS_PER_ITEM 1
#else
#define RAYS_PER_ITEM (8 * WALK_LANES)
#endif
#define EXCHANGE 6

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

// Keeps where a ray stopped, or that it has left the grid.
inline void stand_up(const Seats *s, int lane, int3 resolution, global const int *active, global ulong *positions,
                     global float *t_exit, global int *recorded_count)
{
    const int i = active[s->row[lane]];
    const int x = s->cell[0][lane], y = s->cell[1][lane], z = s->cell[2][lane];
    const int inside = (uint)x < (uint)resolution.x && (uint)y < (uint)resolution.y && (uint)z < (uint)resolution.z;
    recorded_count[s->row[lane]] = s->stored[lane];
    if (positions[i] == LEFT_GRID)
        return;
    positions[i] = inside ? pack_position(x, y, z) : LEFT_GRID;
    t_exit[i] = s->field[6][lane];
}

hot_path void keep_seats(const Group *g, Seats *s)
{
    walk_store(g->walk.x.cell, s->cell[0]), walk_store(g->walk.y.cell, s->cell[1]);
    walk_store(g->walk.z.cell, s->cell[2]);
    walk_store(g->walk.t_exit, s->field[6]);
    walk_store(g->go, s->go);
    walk_store(g->stored, s->stored);
}

// Walks once and remembers each ray's cells, here at most `wave` of them in `wave` + 1 slots a ray: every step
// stores, a met cell moves on. A work-item walks RAYS_PER_ITEM rays: every EXCHANGE steps, lanes that are through
// take the next.
kernel void record_pairs(WALK_ARGUMENTS, global ulong *positions, global float *t_exit, global int *recorded,
                         global int *recorded_count COUNTERS)
{
    int next = get_global_id(0) * RAYS_PER_ITEM;
    if (next >= active_count)
        return;
    const int end = min(next + RAYS_PER_ITEM, active_count), slots = wave + 1, nowhere = next * slots + wave;
    const Grid grid = GRID_VALUES;
    Seats seats;
    for (int lane = 0; lane < WALK_LANES; ++lane) {
        // A lane without a ray repeats the first, and goes nowhere.
        sit_down(&seats, lane, min(next, end - 1), active, rays, keys, positions, t_exit);
        if (next == end)
            seats.row[lane] = -1, seats.go[lane] = 0;
        else
            next++;
    }
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
                stand_up(&seats, lane, grid_resolution(grid), active, positions, t_exit, recorded_count);
                seats.row[lane] = -1;
                if (next < end)
                    sit_down(&seats, lane, next++, active, rays, keys, positions, t_exit);
            }
            seated |= seats.row[lane] >= 0;
        }
    }
    END_COUNTS
}
