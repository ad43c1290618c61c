// Walks a sample of rays to their hits and past them, and writes down what they meet, for the choice of a grid.
#include "intersect.clh"
#include "structures/walk.clh"
#include "structures/cell_test.clh"

// Non-empty cells of each ray in order, `slots` a ray: which, its references, and the steps taken when it was met.
// `needed`: cells up to the hit or the way out, and the steps and tests up to there; `found`: cells written down;
// `end_steps`: steps when the walk ended, past the hit and at most at cell `slots`.
kernel void sample_rays(const int count, global const Ray *rays, global const ulong *keys, STRUCTURE_ARGUMENTS,
                        global const int *cell_start, global const int *references, global const float *triangles,
                        global const ulong *positions, const int slots, global int *cells,
                        global int *cell_references, global int *cell_steps, global int *found, global int *needed,
                        global int *needed_steps, global int *needed_tests, global int *end_steps)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    found[i] = needed[i] = needed_steps[i] = needed_tests[i] = end_steps[i] = 0;
    if (positions[i] == LEFT)
        return;
    const Structure structure = STRUCTURE_VALUES;
    const Frame frame = frame_of(rays[i]);
    Walk w = walk_of(structure, rays[i]);
    walk_to(&w, positions[i]);
    ulong best = keys[i];
    uint steps = 0;
    int met = 0, tests = 0, halted = 0;
    while (!halted || met < slots) {
        const int cell = walk_next(&w, structure, halted ? rays[i].t_max : key_t(best), &steps);
        if (cell == NO_CELL) {
            if (halted)
                break;
            halted = 1, needed[i] = met, needed_steps[i] = steps, needed_tests[i] = tests;
            continue;
        }
        const int begin = cell_start[cell], end = cell_start[cell + 1];
        if (!halted) {
            best = test_cell(&frame, triangles, references, begin, end, best);
            tests += end - begin;
        }
        if (met < slots) {
            const size_t slot = (size_t)i * slots + met;
            cells[slot] = cell, cell_references[slot] = end - begin, cell_steps[slot] = steps;
        }
        met++;
    }
    found[i] = min(met, slots);
    end_steps[i] = steps;
}
