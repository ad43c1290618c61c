// From references in any order to cells: counting sort by cell, then ascending triangles in each.
#include "common.clh"

kernel void fill_cells(const uint entries, global const uint *entry_cell, global const int *entry_primitive,
                       global int *cursor, global int *references)
{
    const uint i = get_global_id(0);
    if (i < entries)
        references[atomic_inc(cursor + entry_cell[i])] = entry_primitive[i];
}

inline void sift_down(global int *heap, int root, int count)
{
    const int value = heap[root];
    for (int child = 2 * root + 1; child < count; child = 2 * root + 1) {
        if (child + 1 < count && heap[child + 1] > heap[child])
            child++;
        if (heap[child] <= value)
            break;
        heap[root] = heap[child];
        root = child;
    }
    heap[root] = value;
}

// Ascending order in each cell (heap sort): the grid's bytes do not depend on the order of the atomics, and
// among equal t the first triangle tested is the lowest.
kernel void sort_cells(const int cells, global const int *cell_start, global int *references)
{
    const int cell = get_global_id(0);
    if (cell >= cells)
        return;
    global int *heap = references + cell_start[cell];
    const int count = cell_start[cell + 1] - cell_start[cell];
    for (int root = count / 2 - 1; root >= 0; --root)
        sift_down(heap, root, count);
    for (int last = count - 1; last > 0; --last) {
        const int largest = heap[0];
        heap[0] = heap[last];
        heap[last] = largest;
        sift_down(heap, 0, last);
    }
}
