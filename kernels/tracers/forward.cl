// Forward tracing, one ray a work-item: step, test the cell's triangles, halt at the first hit that is not
// beyond the cell. With LANES > 1 a ray tests LANES triangles of a cell at a time. A hit beyond the cell is kept as
// the best so far; REJECT_BEYOND_EXIT forgets it, as in textbooks, and relies on a later cell to find it again.
#include "intersect.clh"
#include "structures/walk.clh"
#include "structures/cell_test.clh"

#ifdef REJECT_BEYOND_EXIT
inline ulong test_up_to(float t_exit, const Frame *frame, global const float *triangles,
                        global const int *references, int begin, int end, ulong best)
{
    const ulong beyond = hit_key(max(t_exit, 0.0f), NO_PRIMITIVE);
    const ulong found = test_cell(frame, triangles, references, begin, end, min(best, beyond));
    return found < beyond ? found : best;
}
#else
#define test_up_to(t_exit, ...) test_cell(__VA_ARGS__)
#endif

// Traces rays from the start; `visited` receives the number of non-empty cells walked up to the halt.
kernel void trace_forward(const int count, global const Ray *rays, global ulong *keys, STRUCTURE_ARGUMENTS,
                          global const int *cell_start, global const int *references,
                          global const float *triangles, global const ulong *positions,
                          global int *visited COUNTERS)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    visited[i] = 0;
    if (positions[i] == LEFT)
        return;
    const Structure structure = STRUCTURE_VALUES;
    const Frame frame = frame_of(rays[i]);
    Walk w = walk_of(structure, rays[i]);
    walk_to(&w, positions[i]);
    ulong best = keys[i];
    int cells = 0;
    uint steps = 0;
    BEGIN_COUNTS
    for (;;) {
        // Finished when the best hit is not beyond the cells walked, empty ones included.
        const int cell = walk_next(&w, structure, key_t(best), &steps);
        if (cell == NO_CELL)
            break;
        best = test_up_to(w.t_exit, &frame, triangles, references, cell_start[cell], cell_start[cell + 1], best);
        add_count(COUNT_TESTS, cell_start[cell + 1] - cell_start[cell]);
        add_count(COUNT_LANE_TESTS, LANES * ((cell_start[cell + 1] - cell_start[cell] + LANES - 1) / LANES));
        cells++;
    }
    keys[i] = best;
    visited[i] = cells;
    add_count(COUNT_PAIRS, cells);
    add_count(COUNT_STEPS, steps);
    END_COUNTS
}

// Writes down the first `visited` non-empty cells of each ray, for the work-optimal intersection.
kernel void record_visited(const int count, global const Ray *rays, STRUCTURE_ARGUMENTS, global const ulong *positions,
                           global const int *visited, global const int *visited_start, global int *visited_cell)
{
    const int i = get_global_id(0);
    if (i >= count || visited[i] == 0)
        return;
    const Structure structure = STRUCTURE_VALUES;
    Walk w = walk_of(structure, rays[i]);
    walk_to(&w, positions[i]);
    uint steps = 0;
    for (int k = 0; k < visited[i]; ++k)
        visited_cell[visited_start[i] + k] = walk_next(&w, structure, INFINITY, &steps);
}
