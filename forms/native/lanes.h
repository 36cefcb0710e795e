/* Numbers several at a time: the vectors that the loops work on, and their functions. */

#include <stdint.h>

/* As many as a register of the processor has: of wider ones the compiler keeps nothing in registers. */
#if defined(__AVX512F__)
#define LANES 8
#define BY_LANE(of, s) of(0, s), of(1, s), of(2, s), of(3, s), of(4, s), of(5, s), of(6, s), of(7, s)
#elif defined(__AVX__)
#define LANES 4
#define BY_LANE(of, s) of(0, s), of(1, s), of(2, s), of(3, s)
#else
#define LANES 2
#define BY_LANE(of, s) of(0, s), of(1, s)
#endif
typedef double vec __attribute__((vector_size(8 * LANES)));
typedef int64_t ivec __attribute__((vector_size(8 * LANES)));
typedef uint64_t uvec __attribute__((vector_size(8 * LANES)));
typedef double two __attribute__((vector_size(16), aligned(8), may_alias)); /* that are next to each other */

#define INLINE static inline __attribute__((always_inline))

#define EXPORT /* seen from outside */

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
#if defined(__AVX512DQ__)
    return __builtin_ia32_cvtq2mask512((long long __attribute__((vector_size(64))))mask) != 0;
#elif defined(__AVX__) && LANES == 4
    return __builtin_ia32_movmskpd256((vec)mask) != 0;
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

/* arcosh(1 + x)^2 and its derivative; a series below x = 0.02, where the function itself is
 * analytic but its formula is not. */
INLINE void squared_arcosh(vec x, vec *value, vec *slope)
{
    const double c[] = {2.0, -1.0 / 3, 4.0 / 45, -1.0 / 35, 16.0 / 1575, -8.0 / 2079};
    vec v = all(c[5]), d = all(6.0 * c[5]);
    for (int i = 4; i >= 0; --i) {
        v = v * x + c[i];
        d = d * x + (i + 1) * c[i];
    }
    *value = v * x;
    *slope = d;
    ivec large = (ivec)(x > 0.02);
    if (any(large)) {
        vec safe = choose(large, x, all(0.02)), root = safe * (safe + 2.0);
        for (int l = 0; l < LANES; ++l)
            root[l] = __builtin_sqrt(root[l]);
        vec a = logarithm(1.0 + safe + root);
        *value = choose(large, a * a, *value);
        *slope = choose(large, 2.0 * a / root, *slope);
    }
}

/* Second derivative of arcosh(1 + x)^2, given its slope; series and limit as above. */
INLINE vec curvature_of_squared_arcosh(vec x, vec slope)
{
    /* (-1)^(n - 1) 2^(n + 1) (n - 1)/(n C(2n, n)), n = 2 to 9 */
    const double c[] = {-2.0 / 3,         8.0 / 15,          -12.0 / 35,       64.0 / 315,
                        -80.0 / 693,      64.0 / 1001,       -224.0 / 6435,    2048.0 / 109395};
    vec v = all(c[7]);
    for (int i = 6; i >= 0; --i)
        v = v * x + c[i];
    ivec large = (ivec)(x > 0.02);
    if (any(large)) {
        vec safe = choose(large, x, all(0.02));
        v = choose(large, (2.0 - slope * (1.0 + safe)) / (safe * (safe + 2.0)), v);
    }
    return v;
}

/* Whether numbers are finite. */
INLINE ivec is_finite(vec x)
{
    return (ivec)(x - x == 0.0);
}

/* Rows for columns: in turn pairs of lanes, of pairs and so on change places with those of the row s on. */
#define FIRST(l, s) ((l) & (s) ? LANES + (l) - (s) : (l))
#define SECOND(l, s) ((l) & (s) ? LANES + (l) : (l) + (s))
#define EXCHANGE(s)                                                                                \
    for (int i = 0; i < LANES; ++i)                                                                \
        if (!(i & (s))) {                                                                          \
            vec first = a[i], second = a[i + (s)];                                                 \
            a[i] = __builtin_shuffle(first, second, (ivec){BY_LANE(FIRST, s)});                    \
            a[i + (s)] = __builtin_shuffle(first, second, (ivec){BY_LANE(SECOND, s)});             \
        }
INLINE void transpose(vec *a)
{
    EXCHANGE(1)
#if LANES > 2
    EXCHANGE(2)
#endif
#if LANES > 4
    EXCHANGE(4)
#endif
}

/* Adds the matrices of a block's cells, blocks (a, b) one after the other, those of b = 0 first and
 * only those with a <= b of a symmetric one, each (i, j) row by row, to `values`: the row (a, i) and the
 * columns of b of a cell from start (a, i, b) on. Returns the starts of the next block. */
INLINE const int32_t *insert(int dim, int nodes, int symmetric, int lanes, const int32_t *start,
                             const uint8_t *take, const vec *block, double *values)
{
    const int size = dim * nodes, padded = (size + LANES - 1) / LANES;
    vec row[padded * LANES], cell[LANES][size][padded];
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a)
#pragma GCC unroll 1
        for (int i = 0; i < dim; ++i) {
            for (int b = 0; b < nodes; ++b) {
                const int turned = symmetric && a > b;
                const int at = !symmetric ? b * nodes + a : turned ? a * (a + 1) / 2 + b : b * (b + 1) / 2 + a;
                const vec *from = block + dim * dim * at + (turned ? i : dim * i);
                for (int j = 0; j < dim; ++j)
                    row[dim * b + j] = from[turned ? dim * j : j];
            }
            for (int k = 0; k < padded; ++k) {
                transpose(row + LANES * k);
                for (int l = 0; l < LANES; ++l)
                    cell[l][dim * a + i][k] = row[LANES * k + l];
            }
        }
#pragma GCC unroll 1
    for (int l = 0; l < lanes; ++l)
#pragma GCC unroll 1
        for (int k = 0; k < size && (!take || take[l]); ++k, start += nodes) {
            const double *from = (const double *)cell[l][k];
            for (int b = 0; b < nodes; ++b) {
                double *to = values + start[b];
                *(two *)to += *(const two *)(from + dim * b);
                if (dim == 3)
                    to[2] += from[dim * b + 2];
            }
        }
    return start;
}
