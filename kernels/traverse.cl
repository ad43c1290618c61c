// Traversal of the deferred tracer: walks rays through the grid without testing any triangle. A wave takes
// at most `wave` non-empty cells a ray, in order of encounter (paper, section 2).
#include "common.clh"
#include "walk.clh"

#define WALK_ARGUMENTS                                                                                      \
    const int active_count, global const int *active, global const Ray *rays, global const ulong *keys,     \
        GRID_ARGUMENTS, const int wave

// A finished ray has left the grid or has a hit no farther than the cells it has walked.
inline int ray_finished(ulong position, ulong key, float t_exit)
{
    return position == LEFT_GRID || key_t(key) <= t_exit;
}

// Walks up to `wave` non-empty cells of ray `i` and does BODY with each `cell`; a ray stops beyond its best t.
#define WALK_WAVE(BODY)                                                                                     \
    const Grid grid = GRID_VALUES;                                                                          \
    Walk w = walk_setup(grid, rays[i]);                                                                     \
    w.cell = unpack_position(position);                                                                     \
    const float limit = key_t(keys[i]);                                                                     \
    int left = 0;                                                                                           \
    for (int k = 0; k < wave;) {                                                                            \
        const int cell = walk_next(&w, grid);                                                               \
        left = cell == NO_CELL;                                                                             \
        if (left)                                                                                           \
            break;                                                                                          \
        BODY                                                                                                \
        ++k;                                                                                                \
        if (limit <= w.t_exit)                                                                              \
            break;                                                                                          \
    }                                                                                                       \
    left |= !walk_inside(&w);

#define NEXT_ACTIVE_RAY                                                                                     \
    const int a = get_global_id(0);                                                                         \
    if (a >= active_count)                                                                                  \
        return;                                                                                             \
    const int i = active[a];

// First pass of the two-pass arrangement: counts ray visits to each cell.
kernel void count_pairs(WALK_ARGUMENTS, global const ulong *positions, global const float *t_exit,
                        global int *cell_count COUNTERS)
{
    NEXT_ACTIVE_RAY
    const ulong position = positions[i];
    if (ray_finished(position, keys[i], t_exit[i]))
        return;
    WALK_WAVE(atomic_inc(cell_count + cell); add_count(COUNT_PAIRS, 1);)
    add_count(COUNT_STEPS, w.steps);
}

// Second pass: walks again and stores each ray in its cell's bin.
kernel void pack_pairs(WALK_ARGUMENTS, global ulong *positions, global float *t_exit, global int *cursor,
                       global int *pairs)
{
    NEXT_ACTIVE_RAY
    const ulong position = positions[i];
    if (ray_finished(position, keys[i], t_exit[i]))
        return;
    WALK_WAVE(pairs[atomic_inc(cursor + cell)] = i;)
    positions[i] = left ? LEFT_GRID : pack_position(w.cell);
    t_exit[i] = w.t_exit;
}

// Walks once and remembers, for each encounter, the cell and the ray's rank in its bin.
kernel void record_pairs(WALK_ARGUMENTS, global ulong *positions, global float *t_exit, global int *cell_count,
                         global int2 *recorded, global int *recorded_count COUNTERS)
{
    NEXT_ACTIVE_RAY
    const ulong position = positions[i];
    int stored = 0;
    if (!ray_finished(position, keys[i], t_exit[i])) {
        global int2 *slots = recorded + (size_t)a * wave;
        WALK_WAVE(slots[stored++] = (int2)(cell, atomic_inc(cell_count + cell)); add_count(COUNT_PAIRS, 1);)
        positions[i] = left ? LEFT_GRID : pack_position(w.cell);
        t_exit[i] = w.t_exit;
        add_count(COUNT_STEPS, w.steps);
    }
    recorded_count[a] = stored;
}
