// Binning: bins are padded to whole chunks of LANES pairs of one cell, the intersector's unit of work.
#include "common.clh"

inline int chunks_of(int count) { return (count + LANES - 1) / LANES; }

// Lays out a bin from its first chunk on: writes each chunk's cell and sets the packing cursor. Returns the next bin's
// first chunk.
inline int lay_out_bin(int cell, int count, int first, global int *chunk_cell, global int *cursor)
{
    const int last = first + chunks_of(count);
    cursor[cell] = first * LANES;
    for (int chunk = first; chunk < last; ++chunk)
        chunk_cell[chunk] = cell;
    return last;
}

// Lays out all bins, whose first chunks are known.
kernel void lay_out_bins(const int cells, global const int *cell_count, global const int *chunk_start,
                         global int *chunk_cell, global int *cursor)
{
    const int cell = get_global_id(0);
    if (cell >= cells)
        return;
    lay_out_bin(cell, cell_count[cell], chunk_start[cell], chunk_cell, cursor);
}

// On CPUs, where a work-item streams through a block of cells: the chunks of each block.
kernel void count_chunks(const int cells, const int block, global const int *cell_count, global int *block_chunks)
{
    const size_t first = get_global_id(0) * (size_t)block;
    if (first >= (size_t)cells)
        return;
    const int end = (int)min(first + block, (size_t)cells);
    int chunks = 0;
    for (int cell = (int)first; cell < end; ++cell)
        chunks += chunks_of(cell_count[cell]);
    block_chunks[first / block] = chunks;
}

// ... and the first chunk of each bin and one beyond the last, with the bins laid out.
kernel void lay_out_blocks(const int cells, const int block, global const int *cell_count,
                           global const int *block_chunks, global int *chunk_start, global int *chunk_cell,
                           global int *cursor)
{
    const size_t first = get_global_id(0) * (size_t)block;
    if (first >= (size_t)cells)
        return;
    const int end = (int)min(first + block, (size_t)cells);
    int chunk = 0;
    for (size_t b = 0; b < first / block; ++b)
        chunk += block_chunks[b];
    for (int cell = (int)first; cell < end; ++cell) {
        chunk_start[cell] = chunk;
        chunk = lay_out_bin(cell, cell_count[cell], chunk, chunk_cell, cursor);
    }
    if (end == cells)
        chunk_start[cells] = chunk;
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
