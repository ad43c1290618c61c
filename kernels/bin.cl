// Binning: bins are padded to whole chunks of LANES pairs of one cell, the intersector's unit of work.
#include "common.clh"

// Writes each chunk's cell, marks the unused slots of a bin's last chunk, and sets the packing cursor.
kernel void lay_out_bins(const int cells, global const int *cell_count, global const int *chunk_start,
                         global int *chunk_cell, global int *pairs, global int *cursor)
{
    const int cell = get_global_id(0);
    if (cell >= cells)
        return;
    const int first = chunk_start[cell], last = chunk_start[cell + 1];
    cursor[cell] = first * LANES;
    for (int chunk = first; chunk < last; ++chunk)
        chunk_cell[chunk] = cell;
    for (int slot = first * LANES + cell_count[cell]; slot < last * LANES; ++slot)
        pairs[slot] = -1;
}

// Stores recorded encounters at their bin's offset plus their rank.
kernel void scatter_pairs(const int active_count, global const int *active, const int wave,
                          global const int2 *recorded, global const int *recorded_count,
                          global const int *chunk_start, global int *pairs)
{
    const int a = get_global_id(0);
    if (a >= active_count)
        return;
    global const int2 *slots = recorded + (size_t)a * wave;
    for (int k = 0; k < recorded_count[a]; ++k)
        pairs[chunk_start[slots[k].x] * LANES + slots[k].y] = active[a];
}
