// Synthetic work-optimal intersection (paper, section 3): spins over the cells recorded up to the hit, in
// order, and reports the first intersection. Forward tracing with traversal free of charge.
#include "intersect.clh"
#include "structures/cell_test.clh"

kernel void intersect_visited(const int count, global const Ray *rays, global ulong *keys,
                              global const int *visited, global const int *visited_start,
                              global const int *visited_cell, global const int *cell_start,
                              global const int *references, global const float *triangles COUNTERS)
{
    const int i = get_global_id(0);
    if (i >= count || visited[i] == 0)
        return;
    const Frame frame = frame_of(rays[i]);
    ulong best = keys[i];
    BEGIN_COUNTS
    for (int k = visited_start[i]; k < visited_start[i] + visited[i]; ++k) {
        const int cell = visited_cell[k];
        best = test_cell(&frame, triangles, references, cell_start[cell], cell_start[cell + 1], best);
        add_count(COUNT_TESTS, cell_start[cell + 1] - cell_start[cell]);
        add_count(COUNT_LANE_TESTS, LANES * ((cell_start[cell + 1] - cell_start[cell] + LANES - 1) / LANES));
    }
    keys[i] = best;
    add_count(COUNT_PAIRS, visited[i]);
    END_COUNTS
}
