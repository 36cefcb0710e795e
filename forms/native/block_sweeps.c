/* One symmetric sweep of Gauss-Seidel over blocks of three unknowns, in single precision.
 *
 * A preconditioner may round: half the bytes are read from memory, which is what a sweep takes its
 * time with. From zero, with L and U below and above the blocks D of the diagonal,
 *
 *     (D + L) y = b,   x = y - D^-1 U x,
 *
 * which is (D + U) x = b - L y. Blocks lie by columns, so that a column times a number is one
 * operation on four lanes, the last of which is not used; arrays of blocks have room for it.
 */

#include <stdint.h>
#include <string.h>

typedef float lanes __attribute__((vector_size(16)));

enum { B = 3, BLOCK = B * B };

static inline lanes load(const float *from)
{
    lanes out;
    memcpy(&out, from, sizeof out);
    return out;
}

static inline lanes times(const float *block, lanes x)
{
    return load(block) * x[0] + load(block + B) * x[1] + load(block + 2 * B) * x[2];
}

/* Sum of the blocks from start to end, times what x (n, 4) has at their columns. */
static inline lanes summed(
    const float *blocks, const int32_t *column, int64_t start, int64_t end, const float *x)
{
    lanes sums[B] = {{0}, {0}, {0}};
    for (int64_t k = start; k < end; ++k)
        for (int c = 0; c < B; ++c)
            sums[c] += load(blocks + BLOCK * k + B * c) * x[4 * column[k] + c];
    return sums[0] + sums[1] + sums[2];
}

/* Inverse of a block by columns. */
static void invert(const double *a, float *out)
{
    double cofactors[BLOCK], determinant = 0.0;
    for (int r = 0; r < B; ++r)
        for (int c = 0; c < B; ++c) {
            int r1 = (r + 1) % B, r2 = (r + 2) % B, c1 = (c + 1) % B, c2 = (c + 2) % B;
            cofactors[B * r + c] = a[r1 + B * c1] * a[r2 + B * c2] - a[r1 + B * c2] * a[r2 + B * c1];
        }
    for (int c = 0; c < B; ++c)
        determinant += a[B * c] * cofactors[c];
    for (int r = 0; r < B; ++r)
        for (int c = 0; c < B; ++c)
            out[r + B * c] = (float)(cofactors[B * c + r] / determinant);
}

/* Blocks in single precision.
 *
 * n: nodes; start (n + 1), column, values: blocks of a matrix by rows, columns ascending, each by
 * columns. diagonal (n): which block of a row is that; inverse (n): of these blocks. Returns the
 * first row without one, or -1.
 */
int64_t tribox_round_blocks(
    int64_t n, const int32_t *start, const int32_t *column, const double *values,
    int32_t *diagonal, float *blocks, float *inverse)
{
    for (int64_t k = 0; k < BLOCK * (int64_t)start[n]; ++k)
        blocks[k] = (float)values[k];
    for (int64_t i = 0; i < n; ++i) {
        int32_t k = start[i];
        while (k < start[i + 1] && column[k] < i)
            ++k;
        if (k == start[i + 1] || column[k] > i)
            return i;
        diagonal[i] = k;
        invert(values + BLOCK * (int64_t)k, inverse + BLOCK * i);
    }
    return -1;
}

/* x (n, 3) from b (n, 3); y (n, 4) is overwritten. */
void tribox_sweep(
    int64_t n, const int32_t *start, const int32_t *column, const int32_t *diagonal,
    const float *blocks, const float *inverse, const double *b, double *x, float *y)
{
    for (int64_t i = 0; i < n; ++i) {
        lanes right = {(float)b[B * i], (float)b[B * i + 1], (float)b[B * i + 2], 0.0f};
        right -= summed(blocks, column, start[i], diagonal[i], y);
        lanes found = times(inverse + BLOCK * i, right);
        memcpy(y + 4 * i, &found, sizeof found);
    }
    for (int64_t i = n; i-- > 0;) {
        lanes above = summed(blocks, column, diagonal[i] + 1, start[i + 1], y);
        lanes found = load(y + 4 * i) - times(inverse + BLOCK * i, above);
        memcpy(y + 4 * i, &found, sizeof found);
        for (int c = 0; c < B; ++c)
            x[B * i + c] = found[c];
    }
}
