// Sorting pairs by cell, for arrange=sort: least-significant-digit radix sort, DIGIT_BITS of the cell a pass. A
// work-group of one work-item, so one core of a CPU, takes one block of the input: it counts the digits of its block,
// and, after a prefix sum over all digits and blocks, moves its pairs in order, which keeps each pass stable.
#include "common.clh"

#ifndef DIGIT_BITS
#error "DIGIT_BITS not defined: bits of a cell sorted by in one pass"
#endif
#define DIGITS (1 << DIGIT_BITS)

// A pair while it is sorted: its cell above the index of its ray.
inline ulong sortable(int cell, int ray) { return ((ulong)(uint)cell << 32) | (uint)ray; }
inline int cell_of(ulong pair) { return (int)(pair >> 32); }
inline int ray_of(ulong pair) { return (int)(uint)pair; }
inline int digit_of(int cell, int shift) { return (cell >> shift) & (DIGITS - 1); }

// The part of `count` things that block `block` of `blocks` takes.
inline int block_start(int count, int blocks, int block) { return (int)((long)count * block / blocks); }

inline void clear_digits(local int *digits)
{
    for (int d = 0; d < DIGITS; ++d)
        digits[d] = 0;
}

// `table` holds a block's numbers at every `stride`-th place: for each digit, its blocks side by side.
inline void load_digits(local int *digits, global const int *table, int stride)
{
    for (int d = 0; d < DIGITS; ++d)
        digits[d] = table[(size_t)d * stride];
}
inline void store_digits(local const int *digits, global int *table, int stride)
{
    for (int d = 0; d < DIGITS; ++d)
        table[(size_t)d * stride] = digits[d];
}

// Prefix sum of a table, which is short, by one work-item; its last place takes the sum of all.
kernel void sum_counts(const int count, global int *table)
{
    int sum = 0;
    for (int i = 0; i < count; ++i) {
        const int here = table[i];
        table[i] = sum;
        sum += here;
    }
}

// The first pass reads what the walk recorded. `first_block`: of this segment, among `stride` blocks of all segments.
#define RECORDED                                                                                            \
    const int active_count, global const int *active, const int slots, global const int *recorded,          \
        global const int *recorded_count, const int blocks, const int first_block, const int stride

kernel void count_recorded(RECORDED, global int *table)
{
    local int digits[DIGITS];
    const int block = get_global_id(0), end = block_start(active_count, blocks, block + 1);
    clear_digits(digits);
    for (int a = block_start(active_count, blocks, block); a < end; ++a)
        for (int k = 0; k < recorded_count[a]; ++k)
            digits[digit_of(recorded[(size_t)a * slots + k], 0)]++;
    store_digits(digits, table + first_block + block, stride);
}

kernel void move_recorded(RECORDED, global const int *table, global ulong *sorted)
{
    local int digits[DIGITS];
    const int block = get_global_id(0), end = block_start(active_count, blocks, block + 1);
    load_digits(digits, table + first_block + block, stride);
    for (int a = block_start(active_count, blocks, block); a < end; ++a) {
        const int ray = active[a];
        for (int k = 0; k < recorded_count[a]; ++k) {
            const int cell = recorded[(size_t)a * slots + k];
            sorted[digits[digit_of(cell, 0)]++] = sortable(cell, ray);
        }
    }
}

// Later passes read the pairs of the pass before.
kernel void count_digits(const int count, const int shift, const int blocks, global const ulong *pairs,
                         global int *table)
{
    local int digits[DIGITS];
    const int block = get_global_id(0), end = block_start(count, blocks, block + 1);
    clear_digits(digits);
    for (int i = block_start(count, blocks, block); i < end; ++i)
        digits[digit_of(cell_of(pairs[i]), shift)]++;
    store_digits(digits, table + block, blocks);
}

kernel void move_digits(const int count, const int shift, const int blocks, global const ulong *pairs,
                        global const int *table, global ulong *sorted)
{
    local int digits[DIGITS];
    const int block = get_global_id(0), end = block_start(count, blocks, block + 1);
    load_digits(digits, table + block, blocks);
    for (int i = block_start(count, blocks, block); i < end; ++i) {
        const ulong pair = pairs[i];
        sorted[digits[digit_of(cell_of(pair), shift)]++] = pair;
    }
}

// On other devices: the recorded pairs side by side, for a library's sort. `base` + `first`: each ray's first place.
kernel void gather_recorded(const int active_count, global const int *active, const int slots,
                            global const int *recorded, global const int *recorded_count, global const int *first,
                            const int base, global ulong *pairs)
{
    const int a = get_global_id(0);
    if (a >= active_count)
        return;
    for (int k = 0; k < recorded_count[a]; ++k)
        pairs[base + first[a] + k] = sortable(recorded[(size_t)a * slots + k], active[a]);
}

// Where a cell's pairs begin, and how many there are: `cell_count` is zero before.
kernel void find_bins(const int count, global const ulong *sorted, global int *cell_first, global int *cell_count)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int cell = cell_of(sorted[i]);
    if (i == 0 || cell_of(sorted[i - 1]) != cell) {
        cell_first[cell] = i;
        atomic_sub(cell_count + cell, i);
    }
    if (i == count - 1 || cell_of(sorted[i + 1]) != cell)
        atomic_add(cell_count + cell, i + 1);
}

// Copies sorted pairs to their bins, which are whole chunks.
kernel void fill_bins(const int count, global const ulong *sorted, global const int *cell_first,
                      global const int *chunk_start, global const Ray *rays, global const ulong *keys,
                      global Pair *pairs)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int cell = cell_of(sorted[i]);
    pairs[chunk_start[cell] * LANES + i - cell_first[cell]] = pair_of(ray_of(sorted[i]), rays, keys);
}
