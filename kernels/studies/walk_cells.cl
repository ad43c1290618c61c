// Writes down the leaf cells that rays walk through, for the check of the walk.
#include "common.clh"
#include "structures/walk.clh"

#ifdef MISTAKE
#define ACCUMULATED 1  // exit planes by repeated addition, as in Amanatides & Woo 1987
#define ZERO_AHEAD 2   // a component of -0.0 counts as ahead, although its inverse is -infinity
// One step of a textbook walk with a mistake, for the tests of the check.
inline void mistaken_step(Walk *w, float3 *accumulated)
{
    Axis *axes[3] = {&w->x, &w->y, &w->z};
    float t[3];
    for (int i = 0; i < 3; ++i) {
        const Axis *a = axes[i];
        t[i] = plane_t(a, a->cell + (a->ahead ? 1 : 0));
        if (MISTAKE == ZERO_AHEAD && a->direction == 0.0f)
            t[i] = (convert_float(a->cell + 1) - a->origin) * (1.0f / a->direction);
    }
    if (MISTAKE == ACCUMULATED && isnan(accumulated->x))
        *accumulated = (float3)(t[0], t[1], t[2]);
    if (MISTAKE == ACCUMULATED)
        t[0] = accumulated->x, t[1] = accumulated->y, t[2] = accumulated->z;
    const int i = t[0] <= t[1] ? (t[0] <= t[2] ? 0 : 2) : (t[1] <= t[2] ? 1 : 2);
    Axis *a = axes[i];
    const float delta = fabs(a->inverse);
    *accumulated += (float3)(i == 0 ? delta : 0.0f, i == 1 ? delta : 0.0f, i == 2 ? delta : 0.0f);
    a->cell += (MISTAKE == ZERO_AHEAD ? a->direction >= 0.0f : a->ahead) ? 1 : -1;
}
#endif

// `visited`: room for `slots` cells a ray, filled with the linear positions of its non-empty leaf cells, in order;
// `found` their number, `steps` those taken, each at most `slots`.
kernel void walk_cells(const int count, global const float *origins, global const float *directions,
                       STRUCTURE_ARGUMENTS, const int slots, global int *visited, global int *found, global int *steps)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Structure structure = STRUCTURE_VALUES;
    const Ray ray = scaled_ray(vload3(i, origins), vload3(i, directions), INFINITY);
    Walk w = walk_of(structure, ray);
    const ulong position = walk_entry(&w, structure, INFINITY);
    found[i] = steps[i] = 0;
    if (position == LEFT)
        return;
    walk_to(&w, position);
    int cells = 0, step = 0;
    float3 accumulated = NAN;
    for (; step < slots && walk_inside(&w, structure); ++step) {
        const int here = (w.z.cell * RESOLUTION + w.y.cell) * RESOLUTION + w.x.cell;
#ifdef MISTAKE
        const int used = 1;
        mistaken_step(&w, &accumulated);
#else
        const int used = walk_step(&w, structure, 1) != NO_CELL;
#endif
        if (used)
            visited[(size_t)i * slots + cells++] = here;
    }
    found[i] = cells;
    steps[i] = step;
}
