/* One symmetric sweep of Gauss-Seidel over blocks of three unknowns, in single precision.
 *
 * A preconditioner may round: half the bytes are read from memory, which is what a sweep takes its
 * time with. From zero, with L and U below and above the blocks D of the diagonal,
 *
 *     (D + L) y = b,   x = y - D^-1 U x,
 *
 * which is (D + U) x = b - L y. L and U lie apart, U from its last row to its first, so that memory
 * is read without gaps. Blocks lie by columns: a column times a number is one operation on four
 * lanes, the last of which is not used; arrays of blocks have room for it.
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

/* The parts of a matrix in single precision.
 *
 * n: nodes; start (n + 1), column, values: blocks by rows, columns ascending, each by columns.
 * Made: ends (2, n + 1), columns and parts of L and then of U, inverse (n) of the diagonal's blocks.
 * Returns the first row without a block there, or -1.
 */
int64_t tribox_split_blocks(
    int64_t n, const int32_t *start, const int32_t *column, const double *values,
    int32_t *ends, int32_t *columns, float *parts, float *inverse)
{
    int32_t made = 0;
    for (int upper = 0; upper < 2; ++upper) {
        ends[upper * (n + 1)] = made;
        for (int64_t row = 0; row < n; ++row) {
            int64_t i = upper ? n - 1 - row : row;
            int whole = 0;
            for (int32_t k = start[i]; k < start[i + 1]; ++k) {
                const double *block = values + BLOCK * (int64_t)k;
                if (column[k] == i) {
                    whole = 1;
                    invert(block, inverse + BLOCK * i);
                } else if ((column[k] > i) == upper) {
                    columns[made] = column[k];
                    for (int e = 0; e < BLOCK; ++e)
                        parts[BLOCK * (int64_t)made + e] = (float)block[e];
                    ++made;
                }
            }
            if (!whole)
                return i;
            ends[upper * (n + 1) + row + 1] = made;
        }
    }
    return -1;
}

/* x (n, 3) from b (n, 3); y (n, 4) is overwritten. */
void tribox_sweep(
    int64_t n, const int32_t *ends, const int32_t *columns, const float *parts,
    const float *inverse, const double *b, double *x, float *y)
{
    for (int64_t i = 0; i < n; ++i) {
        lanes right = {(float)b[B * i], (float)b[B * i + 1], (float)b[B * i + 2], 0.0f};
        right -= summed(parts, columns, ends[i], ends[i + 1], y);
        lanes found = times(inverse + BLOCK * i, right);
        memcpy(y + 4 * i, &found, sizeof found);
    }
    ends += n + 1;
    for (int64_t row = 0; row < n; ++row) {
        int64_t i = n - 1 - row;
        lanes above = summed(parts, columns, ends[row], ends[row + 1], y);
        lanes found = load(y + 4 * i) - times(inverse + BLOCK * i, above);
        memcpy(y + 4 * i, &found, sizeof found);
        for (int c = 0; c < B; ++c)
            x[B * i + c] = found[c];
    }
}
