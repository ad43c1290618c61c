// List compaction on CPUs: a work-item streams through a block of the list.
#include "common.clh"

// The unfinished rays of each block, in order, from the block's own place on. `block_kept`: their number.
kernel void keep_in_blocks(const int count, const int block, global const int *active, global const ulong *positions,
                           global const ulong *keys, global const float *t_exit, global int *kept,
                           global int *block_kept)
{
    const size_t first = get_global_id(0) * (size_t)block;
    if (first >= (size_t)count)
        return;
    const int end = (int)min(first + block, (size_t)count);
    int next = (int)first;
    for (int a = (int)first; a < end; ++a) {
        const int i = active[a];
        // Stored in any case, so that there is no branch to foresee; the place belongs to the block.
        kept[next] = i;
        next += !ray_finished(positions[i], keys[i], t_exit[i]);
    }
    block_kept[first / block] = next - (int)first;
}

// Moves what the blocks have kept together: one work-item. The last place of `block_kept` takes the sum.
kernel void join_blocks(const int blocks, const int block, global int *kept, global int *block_kept)
{
    if (get_global_id(0) > 0)
        return;
    int total = 0;
    for (int b = 0; b < blocks; ++b) {
        for (int k = 0; k < block_kept[b]; ++k)
            kept[total + k] = kept[(size_t)b * block + k];
        total += block_kept[b];
    }
    block_kept[blocks] = total;
}
