/* What the loops over material points have in common: components, and how points are stored. */

#include "lanes.h"

/* Components (i, J) of the plane's P and of those in space. */
static const int PLANE[5][2] = {{0, 0}, {0, 1}, {1, 0}, {1, 1}, {2, 2}};
static const int SPACE[9][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 0}, {1, 1},
                                {1, 2}, {2, 0}, {2, 1}, {2, 2}};
/* Those of symmetric tensors that are remembered, 4 in the plane. */
static const int PAIRS[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {0, 2}};

/* Columns of rows `first` to `first + LANES`, the last row again beyond the end. */
INLINE void load(const double *from, int64_t first, int64_t n, int count, vec *to)
{
#pragma GCC unroll 1
    for (int l = 0; l < LANES; ++l) {
        const double *row = from + count * (first + l < n ? first + l : n - 1);
        for (int k = 0; k < count; ++k)
            ((double *)(to + k))[l] = row[k];
    }
}

/* The other way round, NaN where `good` is not set. */
INLINE void store(const vec *from, ivec good, int64_t first, int64_t n, int count, double *to)
{
    const int lanes = n - first < LANES ? (int)(n - first) : LANES;
#pragma GCC unroll 1
    for (int l = 0; l < lanes; ++l)
        for (int k = 0; k < count; ++k)
            to[count * (first + l) + k] =
                ((const int64_t *)&good)[l] ? ((const double *)(from + k))[l] : __builtin_nan("");
}

/* Adds zero to `sum`, or what is not a number where one of `values` is not finite. */
INLINE void probe(const vec *values, int count, vec *sum)
{
#pragma GCC unroll 1
    for (int k = 0; k < count; ++k)
        *sum += values[k] - values[k];
}
