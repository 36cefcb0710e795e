/* Numbers eight at a time: the vectors that the loops work on, and their functions. */

#include <stdint.h>

#define LANES 8
typedef double vec __attribute__((vector_size(8 * LANES)));
typedef int64_t ivec __attribute__((vector_size(8 * LANES)));
typedef uint64_t uvec __attribute__((vector_size(8 * LANES)));

#define INLINE static inline __attribute__((always_inline))

#define EXPORT /* seen from outside */

/* A point of a loop: the columns G and g (a, i) of the derivatives of the reference and the current
 * position by its coordinates, 1/det G, J = det g/det G, and w |det G|. In the half section of a body
 * of revolution these are the reference position (G null, 1/det G is one), and there is a stretch `hoop`. */
typedef struct {
    const vec *G, *g;
    vec inverse, J, hoop, weight;
} Place;

/* Points that remember of the same cells as a loop's own, `points` of each cell. `moduli` adds those
 * of a point to its second derivatives (a, i, b, j) by g, in rings by the hoop stretch last, of which
 * it has the upper half; it is
 * what costs least where the loop has moduli of its own at that point. `add` adds the matrices of a
 * block's cells: blocks (a, b) of the nodes, where `symmetric` those with a <= b, those of b = 0 first,
 * each (i, j) row by row. The way to the matrix's places takes as long as computing them. */
typedef struct {
    void (*add)(const void *cells, int64_t block, vec *matrix);
    void (*moduli)(const void *cells, int64_t block, int64_t point, const Place *at, vec *out);
    const void *cells;
    int64_t points, symmetric;
} Beside;

INLINE vec all(double x)
{
    return (vec){} + x;
}

INLINE vec choose(ivec mask, vec a, vec b)
{
    return (vec)(((ivec)a & mask) | ((ivec)b & ~mask));
}

INLINE int any(ivec mask)
{
#ifdef __AVX512DQ__
    return __builtin_ia32_cvtq2mask512((long long __attribute__((vector_size(64))))mask) != 0;
#endif
    int64_t found = 0;
    for (int l = 0; l < LANES; ++l)
        found |= mask[l];
    return found != 0;
}

INLINE vec absolute(vec x)
{
    return (vec)((uvec)x & 0x7fffffffffffffffULL);
}

/* The polynomial in s^2 of `logarithm`. */
INLINE vec series_of_logarithm(vec z)
{
    vec r = 1.479819860511658591e-01 * z + 1.531383769920937332e-01;
    r = r * z + 1.818357216161805012e-01;
    r = r * z + 2.222219843214978396e-01;
    r = r * z + 2.857142874366239149e-01;
    r = r * z + 3.999999999940941908e-01;
    r = r * z + 6.666666666666735130e-01;
    return r;
}

/* ln x for finite x > 0, to about one unit in the last place (method and coefficients of
 * FreeBSD's e_log.c: s = f/(2 + f), a polynomial in s^2). */
INLINE vec logarithm(vec x)
{
    const uint64_t low = 0x3fe6a09e667f3bcdULL, bias = 1024ULL << 52;
    uvec k = ((uvec)x - low + bias) >> 52;
    vec m = (vec)((uvec)x - (k << 52) + bias);
    vec n = (vec)(k + 0x4330000000000000ULL) - (4503599627370496.0 + 1024.0);
    vec f = m - 1.0, s = f / (m + 1.0), z = s * s, r = series_of_logarithm(z), h = 0.5 * f * f;
    return n * 6.93147180369123816490e-01 -
           ((h - (s * (h + r * z) + n * 1.90821492927058770002e-10)) - f);
}

/* ln(1 + x) and x - ln(1 + x), both to all digits, for finite x > -1; see `logarithm`. */
INLINE void logarithm_of_sum(vec x, vec *value, vec *rest)
{
    vec s = x / (2.0 + x), z = s * s, h = 0.5 * x * x;
    *rest = h - s * (h + series_of_logarithm(z) * z);
    vec whole = logarithm(1.0 + x);
    ivec near = (ivec)(absolute(x) < 0.25);
    *rest = choose(near, *rest, x - whole);
    *value = choose(near, x - *rest, whole);
}

/* e^x to about one unit in the last place for |x| < 700: x = n ln 2 + r, Taylor's series in r. */
INLINE vec exponential(vec x)
{
    const double shift = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to a whole number */
    vec n = (x * 1.44269504088896338700e+00 + shift) - shift;
    vec r = (x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
    const double c[] = {1.0 / 479001600, 1.0 / 39916800, 1.0 / 3628800, 1.0 / 362880, 1.0 / 40320,
                        1.0 / 5040,      1.0 / 720,      1.0 / 120,     1.0 / 24,     1.0 / 6,
                        1.0 / 2};
    vec y = all(1.0 / 6227020800);
    for (int i = 0; i < 11; ++i)
        y = y * r + c[i];
    y = (y * r + 1.0) * r + 1.0;
    uvec bits = (uvec)(n + shift) << 52;
    return (vec)((uvec)y + bits);
}

/* x^(-1/3) for x > 0: a start from the exponent, e = 1 - x y^3 within .16, then
 * y <- y (1 - e)^(-1/3) by its series, twice. */
INLINE vec inverse_cube_root(vec x)
{
    const uint64_t two52 = 0x4330000000000000ULL;
    vec high = (vec)(((uvec)x >> 20) | two52) - 4503599627370496.0;
    vec start = (1023.0 * 4.0 / 3.0 - 0.045) * 4294967296.0 - high * (1.0 / 3.0);
    vec y = (vec)(((uvec)(start + 4503599627370496.0) - two52) << 20);
    vec e = 1.0 - (x * y) * (y * y);
    vec ee = e * e, far = (14.0 / 81 + e * (35.0 / 243)) + ee * (91.0 / 729);
    y += (y * e) * ((1.0 / 3 + e * (2.0 / 9)) + ee * far);
    e = 1.0 - (x * y) * (y * y); /* within 2e-6 */
    return y + (y * e) * (1.0 / 3 + e * (2.0 / 9)); /* exactly 1 for x = 1 */
}

/* The same where x is usually near 1: there from three terms of the series in x - 1, e within 1.3e-4. */
INLINE vec inverse_cube_root_of_ratio(vec x)
{
    vec d = x - 1.0;
    if (__builtin_expect(any(~(ivec)(absolute(d) < 0.125)), 0))
        return inverse_cube_root(x);
    vec y = 1.0 - d * (1.0 / 3 - d * (2.0 / 9 - d * (14.0 / 81)));
    vec e = 1.0 - (x * y) * (y * y);
    return y + (y * e) * (1.0 / 3 + e * (2.0 / 9 + e * (14.0 / 81)));
}

INLINE vec square_root(vec x)
{
    for (int l = 0; l < LANES; ++l)
        x[l] = __builtin_sqrt(x[l]);
    return x;
}

/* Whether numbers are finite. */
INLINE ivec is_finite(vec x)
{
    return (ivec)(x - x == 0.0);
}

/* Adds the matrices of a block's cells, in blocks (a, b) as those of Beside, to `values`: the row (a, i)
 * and the columns of b of a cell from start (a, i, b) on. Returns the starts of the next block. */
INLINE const int32_t *insert(int dim, int nodes, int symmetric, int lanes, const int32_t *start,
                             const vec *block, double *values)
{
#pragma GCC unroll 1
    for (int l = 0; l < lanes; ++l)
#pragma GCC unroll 1
        for (int a = 0; a < nodes; ++a)
            for (int i = 0; i < dim; ++i)
#pragma GCC unroll 1
                for (int b = 0; b < nodes; ++b) {
                    const int turned = symmetric && a > b;
                    const int at = symmetric ? (turned ? a * (a + 1) / 2 + b : b * (b + 1) / 2 + a)
                                             : b * nodes + a;
                    const double *from = (const double *)(block + dim * dim * at) + l;
                    double *to = values + *start++;
                    for (int j = 0; j < dim; ++j)
                        to[j] += from[LANES * (turned ? dim * j + i : dim * i + j)];
                }
    return start;
}
