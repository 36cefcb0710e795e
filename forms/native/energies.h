/* Strain energies of isotropic bodies as functions of J = det F, I1 = |F|^2 and I2 = |cof F|^2. */

#include "principal_powers.h"

enum material { NEO_HOOKEAN, MOONEY_RIVLIN, HENCKY, YEOH, OGDEN };
enum part { WHOLE, DISTORTION, VOLUME };

#define TERMS 10 /* of the series for the logarithmic strain */

/* f_n = 1 + 1/3 + ... + 1/(2n - 1) of its terms, nothing beyond them. */
static const double FACTORS[TERMS + 6] = {0.0,
                                          1.0,
                                          4.0 / 3,
                                          23.0 / 15,
                                          176.0 / 105,
                                          563.0 / 315,
                                          6508.0 / 3465,
                                          88069.0 / 45045,
                                          91072.0 / 45045,
                                          1593269.0 / 765765,
                                          31037876.0 / 14549535};

/* Derivatives of the energy by J, I1 and I2. */
typedef struct {
    vec J, I1, I2, JJ, J1, J2, I11, I12, I22;
} Slopes;

/* Of the series S = sum over n of f_n/n tr Z^2n, f_n = 1 + 1/3 + ... + 1/(2n - 1), of
 * |dev ln U|^2 (Hencky in materials.py): derivatives by the isochoric invariants x and y, in the places of I1 and
 * I2. The derivatives of a power sum by the elementary symmetric
 * polynomials e_k are complete ones, dp_n/de_k = -(-1)^k n h_(n-k), and those of h_m are
 * -(-1)^k g_(m-k) with sum g_m s^m = (sum h_m s^m)^2. */
INLINE void squared_logarithm(vec x, vec y, int second, Slopes *s)
{
    vec b = 1.0 / (x + y + 2.0), q = (x + y - 6.0) * b, t = (y - x) * b, o = t * t;
    vec e1 = 2.0 * q + o, e2 = q * q + 2.0 * o, A[4] = {}, B[7] = {};
    vec h = all(1.0), h1 = all(0.0), h2 = h1, g = h, g1 = h1, g2 = h1; /* and those before them */
#pragma GCC unroll 1
    for (int m = 0; m < TERMS; ++m) {
        for (int k = 1; k <= 3; ++k)
            A[k] += FACTORS[m + k] * h;
        vec next = e1 * h - e2 * h1 + o * h2;
        h2 = h1, h1 = h, h = next;
        if (second) {
            for (int k = 2; k <= 6; ++k)
                B[k] += FACTORS[m + k] * g;
            next = h + e1 * g - e2 * g1 + o * g2;
            g2 = g1, g1 = g, g = next;
        }
    }
    vec by_q = 2.0 * (A[1] - q * A[2]), by_o = A[1] - 2.0 * A[2] + A[3], by_t = 2.0 * t * by_o;
    vec q1 = 8.0 * b * b, t1 = -t * b;
    vec sum = by_q * q1 + by_t * t1, difference = by_t * b; /* by x + y and by y - x */
    s->I1 = sum - difference;
    s->I2 = sum + difference;
    if (!second)
        return;
    vec qq = 4.0 * (B[2] - q * (2.0 * B[3] - q * B[4])) - 2.0 * A[2];
    vec qt = 4.0 * t * (B[2] - 2.0 * B[3] + B[4] - q * (B[3] - 2.0 * B[4] + B[5]));
    vec tt = 2.0 * by_o + 4.0 * o * (B[2] - 4.0 * B[3] + 6.0 * B[4] - 4.0 * B[5] + B[6]);
    vec ss = qq * q1 * q1 + 2.0 * qt * q1 * t1 + tt * t1 * t1 -
             2.0 * b * (q1 * by_q + t1 * by_t);
    vec sd = (qt * q1 + tt * t1 - by_t * b) * b, dd = tt * b * b;
    s->I11 = ss - 2.0 * sd + dd;
    s->I12 = ss - dd;
    s->I22 = ss + 2.0 * sd + dd;
}

/* From derivatives by the isochoric invariants I1 J^(-2/3) and I2 J^(-4/3) to those by J, I1, I2;
 * `a` is J^(-2/3), `r` is 1/J. */
INLINE void from_isochoric(vec x, vec y, vec a, vec r, int second, Slopes *s)
{
    vec c = (-2.0 / 3.0) * r, first = x * s->I1, other = 2.0 * y * s->I2;
    s->J = c * (first + other);
    if (second) {
        vec x1 = x * s->I11 + 2.0 * y * s->I12, x2 = x * s->I12 + 2.0 * y * s->I22;
        s->JJ = c * c * (first + 2.0 * other + x * x1 + 2.0 * y * x2) - s->J * r;
        s->J1 = c * a * (s->I1 + x1);
        s->J2 = c * a * a * (2.0 * s->I2 + x2);
        s->I11 *= a * a;
        s->I12 *= a * a * a;
        s->I22 *= a * a * a * a;
    }
    s->I1 *= a;
    s->I2 *= a * a;
}

/* The distortional part of an energy; `r` is 1/J. */
INLINE void distort(enum material material, const double *c, vec J, vec r, vec I1, vec I2,
                    int second, Slopes *s)
{
    if (material == NEO_HOOKEAN) { /* c: G, Lambda */
        s->I1 = all(0.5 * c[0]);
        s->J = -c[0] * r;
        s->JJ = c[0] * r * r;
        return;
    }
    vec root = inverse_cube_root(J), a = root * root, x = a * I1, y = a * a * I2;
    if (material == MOONEY_RIVLIN) { /* c: C10, C01, K */
        s->I1 = all(c[0]);
        s->I2 = all(c[1]);
    } else if (material == YEOH) { /* c: C10, C20, C30, K */
        vec z = x - 3.0;
        s->I1 = c[0] + z * (2.0 * c[1] + z * (3.0 * c[2]));
        s->I11 = 2.0 * c[1] + z * (6.0 * c[2]);
    } else if (material == OGDEN) { /* c: K, number of terms, and of each mu and alpha */
        Jet sum = power_sum((int)c[1], c + 2, x - 3.0, y - 3.0);
        s->I1 = sum.x, s->I2 = sum.y;
        s->I11 = sum.xx, s->I12 = sum.xy, s->I22 = sum.yy;
    } else { /* c: G, K */
        squared_logarithm(x, y, second, s);
        for (vec *value = &s->I1; value <= &s->I22; ++value)
            *value *= c[0];
    }
    from_isochoric(x, y, a, r, second, s);
}

/* Whether the stress of a part of the energy takes a logarithm or a root of J. */
INLINE int needs_volume(enum material material, enum part part)
{
    if (material == NEO_HOOKEAN)
        return part != DISTORTION;
    return material == HENCKY || part != VOLUME;
}

/* K of Simo and Taylor's volumetric energy. */
INLINE double bulk_modulus(enum material material, const double *c)
{
    return material == YEOH ? c[3] : material == OGDEN ? c[0] : c[2];
}

/* Adds the volumetric part of an energy. */
INLINE void dilate(enum material material, const double *c, vec J, vec r, Slopes *s)
{
    if (material == MOONEY_RIVLIN || material == YEOH || material == OGDEN) {
        const double K = bulk_modulus(material, c);
        s->J += 0.5 * K * (J - r);
        s->JJ += 0.5 * K * (1.0 + r * r);
        return;
    }
    vec l = logarithm(J);
    s->J += c[1] * l * r;
    s->JJ += c[1] * (1.0 - l) * r * r;
}

/* ln(1 + x) and e^x - 1 for x near 0 too (Kahan's quotients). */
INLINE vec logarithm_from_one(vec x)
{
    vec w = 1.0 + x;
    ivec same = (ivec)(w == 1.0);
    return choose(same, x, x * logarithm(w) / choose(same, all(1.0), w - 1.0));
}

INLINE vec exponential_from_one(vec x)
{
    vec w = exponential(x);
    ivec same = (ivec)(w == 1.0);
    return choose(same, x, x * (w - 1.0) / choose(same, all(1.0), logarithm(w)));
}

/* The energy from I1 - 3, I2 - 3 and J^2 - 1. */
INLINE vec stored(enum material material, enum part part, const double *c, vec I1, vec I2, vec JJ)
{
    const int simo_taylor = material == MOONEY_RIVLIN || material == YEOH || material == OGDEN;
    vec l = 0.5 * logarithm_from_one(JJ), w = all(0.0);
    if (part != DISTORTION)
        w = simo_taylor ? 0.25 * bulk_modulus(material, c) * (JJ - 2.0 * l) : 0.5 * c[1] * l * l;
    if (part == VOLUME)
        return w;
    if (material == NEO_HOOKEAN)
        return w + c[0] * (0.5 * I1 - l);
    vec a = exponential_from_one((-2.0 / 3.0) * l); /* J^(-2/3) - 1; its square is J^(-4/3) */
    vec x = I1 + a * (I1 + 3.0), y = I2 + a * (a + 2.0) * (I2 + 3.0);
    if (material == MOONEY_RIVLIN)
        return w + c[0] * x + c[1] * y;
    if (material == YEOH)
        return w + x * (c[0] + x * (c[1] + x * c[2]));
    if (material == OGDEN)
        return w + power_sum((int)c[1], c + 2, x, y).value;
    vec b = 1.0 / (x + y + 8.0), q = (x + y) * b, t = (y - x) * b, o = t * t;
    vec e1 = 2.0 * q + o, e2 = q * q + 2.0 * o;
    vec p = e1, p1 = all(3.0), p2 = all(0.0), sum = p; /* p_1, p_0, p_-1 and so on */
#pragma GCC unroll 1
    for (int n = 2; n <= TERMS; ++n) {
        vec next = e1 * p - e2 * (n > 2 ? p1 : all(2.0)) + o * p2;
        p2 = p1, p1 = p, p = next;
        sum += FACTORS[n] / n * p;
    }
    return w + c[0] * sum;
}

/* What the points of a body obey. */
typedef struct {
    int64_t material, part;
    const double *c;
} Law;

/* Derivatives of a part of an energy. */
INLINE void slopes(enum material material, enum part part, const double *c, vec J, vec I1, vec I2,
                   int second, Slopes *s)
{
    const vec r = 1.0 / J;
    if (part != VOLUME)
        distort(material, c, J, r, I1, I2, second, s);
    if (part != DISTORTION)
        dilate(material, c, J, r, s);
}
