// Moller & Trumbore 1997 as in their listing, which takes a determinant below 1e-6 for a parallel ray.
//
//   |e1 . (d x e2)| < 1e-6 is a miss; otherwise as moller_trumbore.cl
//
// flops: 45 to accept or reject, +9 and one division on a hit.
// Bytes a triangle: 36, nothing precomputed.
// Watertight: no.
// Known failures: those of moller_trumbore.cl; the determinant goes with the square of a triangle's size, so that a
// triangle smaller than about 1e-3 of the scene's unit is never hit.
#define LEAST_DETERMINANT 1e-6f
#include "intersect/moller_trumbore.cl"
