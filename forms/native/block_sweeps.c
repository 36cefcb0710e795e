/* Symmetric sweeps of Gauss-Seidel over blocks of two or three unknowns, in single precision.
 *
 * A preconditioner may round: half the bytes are read from memory, which is what a sweep takes its
 * time with. With the blocks D of the diagonal, L below and U above them, and r = b - A x, a sweep
 *
 *     (D + L) y = r,   d = y - D^-1 U d,   x + w d
 *
 * leaves r - w A d = (1 - w) D y + L (y - w d): half a product. From an x that is not zero the first
 * half takes D y = b - D x - U x - L (x + y), so that r need not be made. L and U lie apart, U from
 * its last row to its first, so that memory is read without gaps. Blocks lie by columns: a column
 * times a number is one operation on four lanes, of which a block uses its own; arrays of blocks
 * have room for the others.
 */

#include <stdint.h>
#include <string.h>

typedef float lanes __attribute__((vector_size(16)));
typedef double wide __attribute__((vector_size(32)));

enum { LANES = 4, LARGEST = 9 };
#define INLINE static inline __attribute__((always_inline))

INLINE lanes load(const float *from)
{
    lanes out;
    memcpy(&out, from, sizeof out);
    return out;
}

INLINE lanes of(int size, const double *from)
{
    lanes out = {(float)from[0], (float)from[1], size > 2 ? (float)from[2] : 0.0f, 0.0f};
    return out;
}

INLINE lanes times(int size, const float *block, lanes x)
{
    lanes out = load(block) * x[0];
    for (int c = 1; c < size; ++c)
        out += load(block + size * c) * x[c];
    return out;
}

/* Part of a matrix: rows' ends, columns, blocks. */
typedef struct {
    const int32_t *ends, *columns;
    const float *blocks;
} part;

/* A row of a part, times what x (n, LANES) has at its columns. */
INLINE lanes row_times(int size, part a, int64_t row, const float *x)
{
    lanes sums[3] = {{0}, {0}, {0}};
    for (int64_t k = a.ends[row]; k < a.ends[row + 1]; ++k)
        for (int c = 0; c < size; ++c)
            sums[c] += load(a.blocks + size * size * k + size * c) * x[LANES * (int64_t)a.columns[k] + c];
    return sums[0] + sums[1] + sums[2];
}

/* Inverse of a block by columns. */
static void invert(int size, const double *a, float *out)
{
    if (size == 2) {
        double determinant = a[0] * a[3] - a[1] * a[2];
        double inverse[] = {a[3], -a[1], -a[2], a[0]};
        for (int e = 0; e < 4; ++e)
            out[e] = (float)(inverse[e] / determinant);
        return;
    }
    double cofactors[LARGEST], determinant = 0.0;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) {
            int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            cofactors[3 * r + c] = a[r1 + 3 * c1] * a[r2 + 3 * c2] - a[r1 + 3 * c2] * a[r2 + 3 * c1];
        }
    for (int c = 0; c < 3; ++c)
        determinant += a[3 * c] * cofactors[c];
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            out[r + 3 * c] = (float)(cofactors[3 * c + r] / determinant);
}

/* The parts of a matrix in single precision.
 *
 * size: of blocks; n: rows of them; start (n + 1), column, values: blocks by rows, columns
 * ascending, each by columns. Made: ends (2, n + 1), columns and parts of L and then of U, the
 * diagonal's blocks (n) and their inverse (n). Returns the first row without a block there, or -1.
 */
int64_t tribox_split_blocks(
    int64_t size, int64_t n, const int32_t *start, const int32_t *column, const double *values,
    int32_t *ends, int32_t *columns, float *parts, float *diagonal, float *inverse)
{
    const int64_t entries = size * size;
    int32_t made = 0;
    for (int upper = 0; upper < 2; ++upper) {
        ends[upper * (n + 1)] = made;
        for (int64_t row = 0; row < n; ++row) {
            int64_t i = upper ? n - 1 - row : row;
            int whole = 0;
            for (int32_t k = start[i]; k < start[i + 1]; ++k) {
                const double *block = values + entries * k;
                float *into = parts + entries * made;
                if (column[k] == i) {
                    whole = 1;
                    invert((int)size, block, inverse + entries * i);
                    into = diagonal + entries * i;
                } else if ((column[k] > i) == upper) {
                    columns[made++] = column[k];
                } else {
                    continue;
                }
                for (int e = 0; e < entries; ++e)
                    into[e] = (float)block[e];
            }
            if (!whole)
                return i;
            ends[upper * (n + 1) + row + 1] = made;
        }
    }
    return -1;
}

INLINE void sweep(
    int size, int64_t n, part lower, part upper, const float *diagonal, const float *inverse,
    const double *b, double *x, double *left, float share, int from_zero, float *work)
{
    const int64_t entries = size * size;
    float *y = work, *d = work + LANES * n, *sum = from_zero ? y : work + 2 * LANES * n;
    for (int64_t i = 0; i < n && !from_zero; ++i) {
        lanes start = of(size, x + size * i);
        memcpy(sum + LANES * i, &start, sizeof start);
    }
    for (int64_t i = 0; i < n; ++i) {
        lanes right = of(size, b + size * i) - row_times(size, lower, i, sum);
        lanes start = {0};
        if (!from_zero) {
            start = load(sum + LANES * i);
            right -= row_times(size, upper, n - 1 - i, sum);
            right -= times(size, diagonal + entries * i, start);
        }
        lanes found = times(size, inverse + entries * i, right);
        memcpy(y + LANES * i, &found, sizeof found);
        found += start;
        memcpy(sum + LANES * i, &found, sizeof found);
    }
    for (int64_t row = 0; row < n; ++row) {
        int64_t i = n - 1 - row;
        lanes above = row_times(size, upper, row, d), half = load(y + LANES * i);
        lanes found = half - times(size, inverse + entries * i, above);
        memcpy(d + LANES * i, &found, sizeof found);
        found *= share;
        half -= found;
        memcpy(y + LANES * i, &half, sizeof half);
        for (int c = 0; c < size; ++c)
            x[size * i + c] = (from_zero ? 0.0 : x[size * i + c]) + found[c];
    }
    for (int64_t i = 0; i < n && left; ++i) {
        lanes rest = row_times(size, lower, i, y);
        if (share != 1.0f) {
            lanes half = load(y + LANES * i) + share * load(d + LANES * i);
            rest += (1.0f - share) * times(size, diagonal + entries * i, half);
        }
        for (int c = 0; c < size; ++c)
            left[size * i + c] = rest[c];
    }
}

/* Sweeps x (n, size) with the right-hand side b (n, size), from zero or from what x is.
 *
 * share: w. left (n, size): what the sweep leaves of b; may be missing. work (3, n, LANES) is
 * overwritten.
 */
void tribox_sweep(
    int64_t size, int64_t n, const int32_t *ends, const int32_t *columns, const float *parts,
    const float *diagonal, const float *inverse, const double *b, double *x, double *left,
    double share, int64_t from_zero, float *work)
{
    part lower = {ends, columns, parts}, upper = {ends + n + 1, columns, parts};
    float w = (float)share;
    if (size == 2)
        sweep(2, n, lower, upper, diagonal, inverse, b, x, left, w, (int)from_zero, work);
    else
        sweep(3, n, lower, upper, diagonal, inverse, b, x, left, w, (int)from_zero, work);
}

INLINE void multiply(
    int size, int64_t n, const int32_t *start, const int32_t *column, const double *values,
    const double *x, double *y)
{
    const int64_t entries = size * size, last = start[n] - 1;
    double end[LARGEST + LANES] = {0};  /* the last block, with room for the lanes it does not use */
    if (last >= 0)
        memcpy(end, values + entries * last, entries * sizeof *end);
    for (int64_t i = 0; i < n; ++i) {
        wide sums[3] = {{0}, {0}, {0}};
        for (int64_t k = start[i]; k < start[i + 1]; ++k) {
            const double *block = k < last ? values + entries * k : end;
            for (int c = 0; c < size; ++c) {
                wide part;
                memcpy(&part, block + size * c, sizeof part);
                sums[c] += part * x[size * (int64_t)column[k] + c];
            }
        }
        sums[0] += sums[1] + sums[2];
        for (int c = 0; c < size; ++c)
            y[size * i + c] = sums[0][c];
    }
}

/* y (n, size), a matrix in blocks, as above, times x. */
void tribox_multiply(
    int64_t size, int64_t n, const int32_t *start, const int32_t *column, const double *values,
    const double *x, double *y)
{
    if (size == 2)
        multiply(2, n, start, column, values, x, y);
    else
        multiply(3, n, start, column, values, x, y);
}
