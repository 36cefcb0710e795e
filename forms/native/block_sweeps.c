/* Symmetric sweeps of Gauss-Seidel over blocks of two or three unknowns, and interpolations from a
 * coarser level, in single precision.
 *
 * A preconditioner may round: half the bytes are read from memory, which is what a sweep takes its
 * time with. With the blocks D of the diagonal, L below and U above them, and r = b - A x, a sweep
 *
 *     (D + L) y = r,   d = y - D^-1 U d,   x + w d
 *
 * leaves r - w A d = (1 - w) D y + L (y - w d): half a product. From an x that is not zero the first
 * half takes D y = b - D x - U x - L (x + y), so that r need not be made. Smooth displacements are
 * larger by far than what they differ by from node to node, and the forces of them smaller by far
 * than single blocks times them. So the sum S of a row's blocks is kept in double precision, and
 *
 *     (A x)_i = S_i x_i + sum_j A_ij (x_j - x_i)
 *
 * with differences that are taken in double precision, too. L and U lie apart, U from its
 * last row to its first, so that memory is read without gaps. Blocks lie by columns: a column
 * times a number is one operation on four lanes, of which a block uses its own; arrays of blocks
 * have room for the others.
 */

#include <stdint.h>
#include <string.h>

typedef float lanes __attribute__((vector_size(16)));
typedef double wide __attribute__((vector_size(32)));
typedef float eight __attribute__((vector_size(32)));

enum { LANES = 4, LARGEST = 9, WIDTH = 8 };
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

/* The same of what x (n, LANES) is beyond `here`, and, of L, of y (n, LANES).
 *
 * U, without y, is read from its end to its beginning, and so within each row: else every row would
 * wait for memory (half the time of a sweep). */
INLINE lanes row_differences(
    int size, part a, int64_t row, const double *x, wide here, const float *y)
{
    lanes sums[3] = {{0}, {0}, {0}};
    const int64_t first = a.ends[row], end = a.ends[row + 1];
    for (int64_t l = first; l < end; ++l) {
        const int64_t k = y ? l : first + end - 1 - l, at = LANES * (int64_t)a.columns[k];
        wide there;
        memcpy(&there, x + at, sizeof there);
        lanes beyond = __builtin_convertvector(there - here, lanes);
        if (y)
            beyond += load(y + at);
        for (int c = 0; c < size; ++c)
            sums[c] += load(a.blocks + size * size * k + size * c) * beyond[c];
    }
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

/* The next of the blocks (rows, width) in rows with ascending columns, from `at` (rows) on, which
 * moves on; -1: there is none. `block` gets it by columns. */
INLINE int64_t next_block(
    int rows, int width, int32_t *at, const int32_t *ends, const int32_t *column,
    const double *values, double *block)
{
    int32_t least = INT32_MAX;
    int whole = 1;
    for (int r = 0; r < rows; ++r)
        if (at[r] < ends[r] && column[at[r]] < least)
            least = column[at[r]];
    if (least == INT32_MAX)
        return -1;
    const int32_t next = least / width, first = width * next, last = first + width - 1;
    for (int r = 0; r < rows; ++r)
        whole &= at[r] + width <= ends[r] && column[at[r]] == first && column[at[r] + width - 1] == last;
    for (int r = 0; r < rows && whole; ++r, at[r - 1] += width)
        for (int c = 0; c < width; ++c)
            block[r + rows * c] = values[at[r] + c];
    if (whole)
        return next;
    memset(block, 0, rows * width * sizeof *block);
    for (int r = 0; r < rows; ++r)
        for (; at[r] < ends[r] && column[at[r]] <= last; ++at[r])
            block[r + rows * (column[at[r]] - first)] = values[at[r]];
    return next;
}

/* Number of blocks (rows, width) of a matrix with n rows of them.
 *
 * start (rows n + 1), column: ends of the rows, columns ascending. */
int64_t tribox_count_blocks(
    int64_t rows, int64_t width, int64_t n, const int32_t *start, const int32_t *column)
{
    int64_t count = 0;
    for (int64_t i = 0; i < n; ++i) {
        const int32_t *ends = start + rows * i + 1;
        int32_t at[3] = {0};
        memcpy(at, start + rows * i, rows * sizeof *at);
        for (;; ++count) {
            int32_t least = INT32_MAX;
            for (int r = 0; r < rows; ++r)
                if (at[r] < ends[r] && column[at[r]] < least)
                    least = column[at[r]];
            if (least == INT32_MAX)
                break;
            const int32_t last = (int32_t)width * (least / (int32_t)width) + (int32_t)width - 1;
            for (int r = 0; r < rows; ++r)
                while (at[r] < ends[r] && column[at[r]] <= last)
                    ++at[r];
        }
    }
    return count;
}

/* The parts of a matrix in single precision.
 *
 * size: of blocks; n: rows of them; count: blocks beside the diagonal; start (size n + 1), column,
 * values: by rows, columns ascending. Made: ends (2, n + 1), columns and parts of L and then of U
 * (whose rows and columns descend), the diagonal's blocks (n) and their inverse (n), the sums of a
 * row's blocks (n) in double precision. Returns the first row without a block on the diagonal, or -1.
 */
INLINE int64_t split(
    int size, int64_t n, int64_t count, const int32_t *start, const int32_t *column,
    const double *values, int32_t *ends, int32_t *columns, float *parts, float *diagonal,
    float *inverse, double *sums)
{
    const int64_t entries = size * size;
    int32_t below = 0, above = (int32_t)count;
    int32_t *lower = ends, *upper = ends + n + 1;
    lower[0] = 0;
    upper[n] = above;
    for (int64_t i = 0; i < n; ++i) {
        double block[LARGEST], sum[LARGEST] = {0};
        int32_t at[3];
        int64_t next;
        int whole = 0;
        memcpy(at, start + size * i, size * sizeof *at);
        while ((next = next_block(size, size, at, start + size * i + 1, column, values, block)) >= 0) {
            float *into = diagonal + entries * i;
            if (next == i) {
                whole = 1;
                invert(size, block, inverse + entries * i);
            } else if (below == above) {
                return i;  /* there is room for all unless a row has no block on the diagonal */
            } else {
                int32_t place = next < i ? below++ : --above;
                columns[place] = (int32_t)next;
                into = parts + entries * place;
            }
            for (int e = 0; e < entries; ++e) {
                sum[e] += block[e];
                into[e] = (float)block[e];
            }
        }
        if (!whole)
            return i;
        memcpy(sums + entries * i, sum, entries * sizeof *sum);
        lower[i + 1] = below;
        upper[n - 1 - i] = above;
    }
    return -1;
}

int64_t tribox_split_blocks(
    int64_t size, int64_t n, int64_t count, const int32_t *start, const int32_t *column,
    const double *values, int32_t *ends, int32_t *columns, float *parts, float *diagonal,
    float *inverse, double *sums)
{
    return size == 2
        ? split(2, n, count, start, column, values, ends, columns, parts, diagonal, inverse, sums)
        : split(3, n, count, start, column, values, ends, columns, parts, diagonal, inverse, sums);
}

INLINE void sweep(
    int size, int64_t n, part lower, part upper, const float *diagonal, const float *inverse,
    const double *sums, const double *b, double *x, double *left, float share, int from_zero,
    float *work, double *start)
{
    const int64_t entries = size * size;
    float *y = work, *d = work + LANES * n;
    for (int64_t i = 0; i < n && !from_zero; ++i)
        for (int c = 0; c < size; ++c)
            start[LANES * i + c] = x[size * i + c];
    for (int64_t i = 0; i < n; ++i) {
        lanes right;
        if (from_zero) {
            right = of(size, b + size * i) - row_times(size, lower, i, y);
        } else {
            double known[LANES] = {0};
            wide here;
            memcpy(&here, start + LANES * i, sizeof here);
            for (int r = 0; r < size; ++r) {
                known[r] = b[size * i + r];
                for (int c = 0; c < size; ++c)
                    known[r] -= sums[entries * i + size * c + r] * here[c];
            }
            right = of(size, known) - row_differences(size, lower, i, start, here, y);
            right -= row_differences(size, upper, n - 1 - i, start, here, NULL);
        }
        lanes found = times(size, inverse + entries * i, right);
        memcpy(y + LANES * i, &found, sizeof found);
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
    for (int64_t i = 0; i < n; ++i) {
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
 * share: w. left (n, size): what the sweep leaves of b. work (2, n, LANES) and start (n, LANES) are
 * overwritten; what start has beyond `size` is zero.
 */
void tribox_sweep(
    int64_t size, int64_t n, const int32_t *ends, const int32_t *columns, const float *parts,
    const float *diagonal, const float *inverse, const double *sums, const double *b, double *x,
    double *left, double share, int64_t from_zero, float *work, double *start)
{
    part lower = {ends, columns, parts}, upper = {ends + n + 1, columns, parts};
    float w = (float)share;
    if (size == 2)
        sweep(2, n, lower, upper, diagonal, inverse, sums, b, x, left, w, (int)from_zero, work, start);
    else
        sweep(3, n, lower, upper, diagonal, inverse, sums, b, x, left, w, (int)from_zero, work, start);
}

/* Blocks (size, width) of an interpolation, by rows, in single precision.
 *
 * start (size n + 1), column, values: as above. Made: ends (n + 1), columns (blocks), parts (blocks).
 */
void tribox_take_blocks(
    int64_t size, int64_t width, int64_t n, const int32_t *start, const int32_t *column,
    const double *values, int32_t *ends, int32_t *columns, float *parts)
{
    int32_t made = 0;
    ends[0] = 0;
    for (int64_t i = 0; i < n; ++i) {
        const int32_t *rows = start + size * i;
        int32_t at[3] = {0};
        int64_t next;
        double block[3 * WIDTH];
        memcpy(at, rows, size * sizeof *at);
        while ((next = next_block((int)size, (int)width, at, rows + 1, column, values, block)) >= 0) {
            float *into = parts + size * width * (int64_t)made;
            for (int r = 0; r < size; ++r)
                for (int c = 0; c < width; ++c)
                    into[width * r + c] = (float)block[r + size * c];
            columns[made++] = (int32_t)next;
        }
        ends[i + 1] = made;
    }
}

INLINE eight load_eight(const float *from)
{
    eight out;
    memcpy(&out, from, sizeof out);
    return out;
}

/* y (n, size) + P x with P in blocks (size, width), x (m, WIDTH), zero beyond `width`. */
INLINE void interpolate(
    int size, int width, int64_t n, const int32_t *ends, const int32_t *columns, const float *parts,
    const float *x, double *y)
{
    for (int64_t i = 0; i < n; ++i) {
        eight sums[3] = {{0}, {0}, {0}};
        for (int64_t k = ends[i]; k < ends[i + 1]; ++k) {
            eight from = load_eight(x + WIDTH * (int64_t)columns[k]);
            for (int r = 0; r < size; ++r)
                sums[r] += load_eight(parts + width * (size * k + r)) * from;
        }
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < width; ++c)
                y[size * i + r] += sums[r][c];
    }
}

/* Add P^T y to x. What x gets beyond `width` is nothing. */
INLINE void restrict_to(
    int size, int width, int64_t n, const int32_t *ends, const int32_t *columns, const float *parts,
    const double *y, float *x)
{
    for (int64_t i = 0; i < n; ++i) {
        for (int64_t k = ends[i]; k < ends[i + 1]; ++k) {
            float *at = x + WIDTH * (int64_t)columns[k];
            eight into = load_eight(at);
            for (int r = 0; r < size; ++r)
                into += load_eight(parts + width * (size * k + r)) * (float)y[size * i + r];
            memcpy(at, &into, sizeof into);
        }
    }
}

/* An interpolation times a vector of the coarser level, added to one of the finer level y (n, size);
 * or its transpose times that, added to x (m, WIDTH). Arrays of blocks have room for WIDTH more. */
void tribox_interpolate(
    int64_t size, int64_t width, int64_t n, const int32_t *ends, const int32_t *columns,
    const float *parts, float *x, double *y, int64_t transposed)
{
    if (transposed && size == 3 && width == 6)
        restrict_to(3, 6, n, ends, columns, parts, y, x);
    else if (transposed)
        restrict_to((int)size, (int)width, n, ends, columns, parts, y, x);
    else if (size == 3 && width == 6)
        interpolate(3, 6, n, ends, columns, parts, x, y);
    else
        interpolate((int)size, (int)width, n, ends, columns, parts, x, y);
}
