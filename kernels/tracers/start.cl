// Prepares a batch: reads the rays, scales directions by a power of two, and finds where each enters the structure.
#include "common.clh"
#include "structures/walk.clh"

// WALK_LANES rays a work-item.
kernel void start_rays(const int count, global const float *origins, global const float *directions,
                       global const float *t_max, STRUCTURE_ARGUMENTS, global Ray *rays, global ulong *keys,
                       global ulong *positions, global float *t_exit)
{
    const int first = get_global_id(0) * WALK_LANES;
    if (first >= count)
        return;
    const Structure structure = STRUCTURE_VALUES;
    float field[7][WALK_LANES];
    for (int lane = 0; lane < WALK_LANES; ++lane) {
        const int i = min(first + lane, count - 1);
        const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), t_max[i]);
        field[0][lane] = ray.ox, field[1][lane] = ray.oy, field[2][lane] = ray.oz;
        field[3][lane] = ray.dx, field[4][lane] = ray.dy, field[5][lane] = ray.dz;
        field[6][lane] = ray.t_max;
        rays[i] = ray;
        keys[i] = hit_key(ray.t_max, NO_PRIMITIVE);
        t_exit[i] = 0.0f;
    }
    Walk w = walk_setup(structure, walk_load(field[0]), walk_load(field[1]), walk_load(field[2]), walk_load(field[3]),
                        walk_load(field[4]), walk_load(field[5]));
    int word[POSITION_WORDS][WALK_LANES], enters[WALK_LANES];
    walk_int words[POSITION_WORDS];
    walk_store(walk_enter(&w, structure, walk_load(field[6])), enters);
    walk_get_position(&w, words);
    for (int k = 0; k < POSITION_WORDS; ++k)
        walk_store(words[k], word[k]);
    for (int lane = 0; lane < WALK_LANES && first + lane < count; ++lane)
        positions[first + lane] = enters[lane] ? POSITION_OF(structure, word, lane) : LEFT;
}
