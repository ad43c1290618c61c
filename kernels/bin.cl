// Binning: bins are padded to whole chunks of LANES pairs of one cell, the intersector's unit of work.
#include "common.clh"

// Writes each chunk's cell, marks the unused slots of a bin's last chunk, and sets the packing cursor.
kernel void lay_out_bins(const int cells, global const int *cell_count, global const int *chunk_start,
                         global int *chunk_cell, global Pair *pairs, global int *cursor)
{
    const int cell = get_global_id(0);
    if (cell >= cells)
        return;
    const int first = chunk_start[cell], last = chunk_start[cell + 1];
    cursor[cell] = first * LANES;
    for (int chunk = first; chunk < last; ++chunk)
        chunk_cell[chunk] = cell;
    for (int slot = first * LANES + cell_count[cell]; slot < last * LANES; ++slot)
        pairs[slot] = NO_PAIR;
}

// Counts the recorded encounters of each cell; the count before is the encounter's rank in its bin.
kernel void rank_pairs(const int active_count, const int slots, global const int *recorded,
                       global const int *recorded_count, global int *cell_count, global int *rank)
{
    const int a = get_global_id(0);
    if (a >= active_count)
        return;
    const size_t first = (size_t)a * slots;
    for (int k = 0; k < recorded_count[a]; ++k)
        rank[first + k] = atomic_inc(cell_count + recorded[first + k]);
}

// Stores recorded encounters at their bin's offset plus their rank.
kernel void scatter_pairs(const int active_count, global const int *active, const int slots,
                          global const int *recorded, global const int *recorded_count, global const int *rank,
                          global const int *chunk_start, global const Ray *rays, global const ulong *keys,
                          global Pair *pairs)
{
    const int a = get_global_id(0);
    if (a >= active_count)
        return;
    const size_t first = (size_t)a * slots;
    const Pair pair = pair_of(active[a], rays, keys);
    for (int k = 0; k < recorded_count[a]; ++k)
        pairs[chunk_start[recorded[first + k]] * LANES + rank[first + k]] = pair;
}
