// Pluecker coordinates: Davis & Wald's edge test without a tolerance.
//
//   as plucker.cl with e = 0
//
// flops: 71 to accept or reject, +39 and two divisions on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: along edges without contraction; vertices leak.
// Known failures: vertices; grazing rays; contraction.
#define EDGE_TOLERANCE 0.0f
#include "intersect/plucker.cl"
