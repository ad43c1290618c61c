// Writes down every step of rays that halt as the tracers do, for counting coherence: one ray a work-item, LANES 1.
#include "intersect.clh"
#include "structures/walk.clh"
#include "structures/cell_test.clh"

// The best hit decides where a ray halts only after each wave of `wave` non-empty cells; 1 is forward tracing.
// `steps`: taken by each ray. Where `writes`, each step's cell or NO_CELL and its wave, from `first` on.
kernel void write_steps(const int count, global const Ray *rays, global const ulong *keys, STRUCTURE_ARGUMENTS,
                        global const int *cell_start, global const int *references, global const float *triangles,
                        global const ulong *positions, const int wave, const int writes, global const ulong *first,
                        global int *step_cell, global int *step_wave, global int *steps)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    steps[i] = 0;
    if (positions[i] == LEFT)
        return;
    const Structure structure = STRUCTURE_VALUES;
    const Frame frame = frame_of(rays[i]);
    Walk w = walk_of(structure, rays[i]);
    walk_to(&w, positions[i]);
    ulong best = keys[i];
    int taken = 0;
    for (int number = 0; walk_inside(&w, structure) && w.t_exit < key_t(best); ++number) {
        const float limit = key_t(best);
        for (int stored = 0; stored < wave && walk_inside(&w, structure) && w.t_exit < limit; ++taken) {
            const int cell = walk_step(&w, structure, 1);
            if (writes)
                step_cell[first[i] + taken] = cell, step_wave[first[i] + taken] = number;
            if (cell == NO_CELL)
                continue;
            best = test_cell(&frame, triangles, references, cell_start[cell], cell_start[cell + 1], best);
            stored++;
        }
    }
    steps[i] = taken;
}
