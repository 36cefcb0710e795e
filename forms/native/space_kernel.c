/* Internal forces, strain energy and tangents of bodies in space, eight cells at a time.
 *
 * In parent coordinates xi the deformation gradient is F = g G^-1, with the columns of g and G the
 * derivatives of the current and of the reference position. The energies are functions of
 * J = det F, I1 = |F|^2 and I2 = |cof F|^2 alone. With A = G^-1 G^-T, K = g A, n = cof g and
 * z = n G^T G/det(G)^2 their derivatives by the columns of g are
 *
 *     dJ/dg = n/det G,   dI1/dg = 2 K,   dI2/dg_a = 2 (g_b x z_c - g_c x z_b),  (a, b, c) cyclic,
 *
 * and h = dW/dg = W_J dJ/dg + W_1 dI1/dg + W_2 dI2/dg gives the nodal forces
 * f_a = sum over points of w |det G| h dN_a/dxi. The second derivatives of J and I1 follow at once,
 * that of I2 from I2 = (I1^2 - |b|^2)/2, b = K g^T. No derivative by reference coordinates is
 * needed, and those by parent coordinates are the same numbers in all cells.
 *
 * A cell is stored by the coefficients of 1, xi, eta, ..., xi eta zeta in its nodes' reference
 * positions, the displacements are gathered: strains far below the spacing of the coordinates' own
 * round-off are not lost.
 */

#include "lanes.h"

/* VOLUMETRIC: the volumetric part of HENCKY, at the centre, beside points that remember. */
enum material { NEO_HOOKEAN, MOONEY_RIVLIN, HENCKY, YEOH, VOLUMETRIC };
enum part { WHOLE, DISTORTION, VOLUME };
enum shape { HEXAHEDRON, TETRAHEDRON };

#define TERMS 10 /* of the series for the logarithmic strain */
#define GAUSS 0.57735026918962576451

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

INLINE vec dot(const vec *a, const vec *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

INLINE void cross(const vec *a, const vec *b, vec *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* Of the series S = sum over n of f_n/n tr Z^2n, f_n = 1 + 1/3 + ... + 1/(2n - 1), that materials.py
 * takes for |dev ln U|^2: derivatives by the isochoric invariants x and y, in the places of I1 and
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
    return material == HENCKY || material == VOLUMETRIC || part != VOLUME;
}

/* Adds the volumetric part of an energy. */
INLINE void dilate(enum material material, const double *c, vec J, vec r, Slopes *s)
{
    if (material == MOONEY_RIVLIN || material == YEOH) {
        const double K = material == YEOH ? c[3] : c[2];
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
    const int simo_taylor = material == MOONEY_RIVLIN || material == YEOH;
    vec l = 0.5 * logarithm_from_one(JJ), w = all(0.0);
    if (part != DISTORTION)
        w = simo_taylor ? 0.25 * c[material == YEOH ? 3 : 2] * (JJ - 2.0 * l) : 0.5 * c[1] * l * l;
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

/* What holds at a point: w, what is added to dW/dJ of the volumetric part in moduli, what is wanted.
 * One instance of the loop serves all materials and cells, or compiling takes a minute. */
typedef struct {
    enum material material;
    enum part part;
    const double *c;
    double weight;
    vec excess;
} Law;

/* What is found there: w |det G| dW/dg and w |det G| d^2W/dg^2, by the columns of g one after
 * another; cells with J <= 0 are marked in `bad`. What takes a logarithm or a root of J is not a
 * number there. */
typedef struct {
    vec h[3][3], moduli[9][9], inverse, J, weight; /* 1/det G, and the weight w |det G| */
    ivec bad;
} Point;

INLINE void cofactors(const vec g[3][3], vec n[3][3])
{
    for (int a = 0; a < 3; ++a)
        cross(g[(a + 1) % 3], g[(a + 2) % 3], n[a]);
}

/* dI2/dg, and I2; `scale` is 1/det(G)^2. */
INLINE vec second_invariant(const vec G[3][3], const vec g[3][3], const vec n[3][3], vec scale,
                            vec by[3][3])
{
    vec z[3][3] = {}, I2 = all(0.0), one[3], other[3];
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
            vec metric = dot(G[a], G[b]) * scale;
            for (int i = 0; i < 3; ++i)
                z[a][i] += metric * n[b][i];
        }
    for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        I2 += dot(n[a], z[a]);
        cross(g[b], z[c], one);
        cross(g[c], z[b], other);
        for (int i = 0; i < 3; ++i)
            by[a][i] = 2.0 * (one[i] - other[i]);
    }
    return I2;
}

/* Products W_kl v_k v_l of the derivatives v of J, I1 and I2. Part of I2's second derivative is of
 * the form of the one of I1 alone. */
INLINE void products(const Slopes *s, int whole, const vec *J, const vec *I1, const vec *I2,
                     vec moduli[9][9])
{
#pragma GCC unroll 1
    for (int p = 0; p < 9; ++p) {
        vec by_J = s->JJ * J[p], by_I1, by_I2;
        if (!whole) {
            for (int q = 0; q < 9; ++q)
                moduli[p][q] = by_J * J[q];
            continue;
        }
        by_J += s->J1 * I1[p] + s->J2 * I2[p];
        by_I1 = s->J1 * J[p] + (s->I11 + s->I2) * I1[p] + s->I12 * I2[p];
        by_I2 = s->J2 * J[p] + s->I12 * I1[p] + s->I22 * I2[p];
        for (int q = 0; q < 9; ++q)
            moduli[p][q] = by_J * J[q] + by_I1 * I1[q] + by_I2 * I2[q];
    }
}

/* Adds W_k times the second derivatives; those of J are e_abc e_ijk g_c,k/det G. K: dI1/dg. */
INLINE void curvatures(const Slopes *s, int distorts, int whole, vec slope, vec I1,
                       const vec A[3][3], const vec g[3][3], const vec K[3][3], vec moduli[9][9])
{
#pragma GCC unroll 1
    for (int a = 0; a < 3; ++a) {
        const int b = a == 2 ? 0 : a + 1, c = 3 - a - b;
        for (int i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            vec value = slope * g[c][k];
            moduli[3 * a + i][3 * b + j] += value;
            moduli[3 * b + j][3 * a + i] += value;
            moduli[3 * a + j][3 * b + i] -= value;
            moduli[3 * b + i][3 * a + j] -= value;
        }
    }
    if (!distorts)
        return;
    vec twice[3][3];
    for (int i = 0; i < 3 && whole; ++i)
        for (int j = 0; j < 3; ++j)
            twice[i][j] = s->I2 * (K[0][i] * g[0][j] + K[1][i] * g[1][j] + K[2][i] * g[2][j]);
#pragma GCC unroll 1
    for (int ab = 0; ab < 9; ++ab) {
        const int a = ab / 3, b = ab % 3;
        vec same = 2.0 * s->I1 * A[a][b];
        if (whole) {
            same += s->I2 * (2.0 * I1 * A[a][b] - 0.5 * dot(K[a], K[b]));
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    moduli[3 * a + i][3 * b + j] -=
                        0.5 * s->I2 * K[b][i] * K[a][j] + twice[i][j] * A[a][b];
        }
        for (int i = 0; i < 3; ++i)
            moduli[3 * a + i][3 * b + i] += same;
    }
}

/* The point of the columns G and g. */
INLINE void at_point(const Law *law, const vec G[3][3], const vec g[3][3], int second, Point *out)
{
    const int distorts = law->part != VOLUME, whole = distorts && law->material != NEO_HOOKEAN;
    vec N[3][3], A[3][3], v[3][3][3], I1 = all(0.0), I2 = all(0.0);
    Slopes s = {};
    cofactors(G, N);
    cofactors(g, v[0]);
    vec D = dot(G[0], N[0]), d = dot(g[0], v[0][0]);
    vec inverse = 1.0 / (D * d), of_D = d * inverse, J = d * of_D, r = D * D * inverse;
    out->bad |= ~(ivec)(J > 0.0);
    if (distorts) {
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                A[a][b] = dot(N[a], N[b]) * (of_D * of_D);
        for (int a = 0; a < 3; ++a) {
            for (int i = 0; i < 3; ++i)
                v[1][a][i] = 2.0 * (A[a][0] * g[0][i] + A[a][1] * g[1][i] + A[a][2] * g[2][i]);
            I1 += 0.5 * dot(v[1][a], g[a]);
        }
        if (whole)
            I2 = second_invariant(G, g, v[0], of_D * of_D, v[2]);
        distort(law->material, law->c, J, r, I1, I2, second, &s);
    }
    if (law->part != DISTORTION)
        dilate(law->material, law->c, J, r, &s);
    if (needs_volume(law->material, law->part)) {
        s.J = (vec)((ivec)s.J | ~(ivec)(J > 0.0)); /* all bits set: not a number */
        s.JJ = (vec)((ivec)s.JJ | ~(ivec)(J > 0.0));
    }
    vec weight = law->weight * absolute(D);
    out->inverse = of_D;
    out->J = J;
    out->weight = weight;
    for (vec *value = &s.J; value <= &s.I22; ++value)
        *value *= weight;
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i) {
            v[0][a][i] *= of_D;
            out->h[a][i] = s.J * v[0][a][i];
            if (distorts)
                out->h[a][i] += s.I1 * v[1][a][i];
            if (whole)
                out->h[a][i] += s.I2 * v[2][a][i];
        }
    if (second) {
        products(&s, whole, v[0][0], v[1][0], v[2][0], out->moduli);
        vec slope = distorts ? s.J : s.J + law->excess * weight;
        curvatures(&s, distorts, whole, slope * of_D, I1, A, g, v[1], out->moduli);
    }
}

/* w |det G| W of the point of the columns G and g = G + d, from E = (C - I)/2: of small strains too it
 * has the digits that d has. With eps = (G^T d + d^T G + d^T d)/2 the invariants of E are those of
 * A eps. */
INLINE vec energy_at(const Law *law, const vec G[3][3], const vec d[3][3], ivec *bad)
{
    vec N[3][3], n[3], g[3][3], eps[3][3], E[3][3];
    cofactors(G, N);
    vec D = dot(G[0], N[0]), scale = 1.0 / (D * D);
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i)
            g[a][i] = G[a][i] + d[a][i];
    cross(g[1], g[2], n);
    *bad |= ~(ivec)(dot(g[0], n) * D > 0.0);
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b)
            eps[a][b] = 0.5 * (dot(G[a], d[b]) + dot(d[a], G[b]) + dot(d[a], d[b]));
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b)
            E[a][b] = scale * (dot(N[a], N[0]) * eps[0][b] + dot(N[a], N[1]) * eps[1][b] +
                               dot(N[a], N[2]) * eps[2][b]);
    cross(E[1], E[2], n);
    vec first = E[0][0] + E[1][1] + E[2][2], third = dot(E[0], n);
    vec second = E[0][0] * E[1][1] - E[0][1] * E[1][0] + E[1][1] * E[2][2] - E[1][2] * E[2][1] +
                 E[2][2] * E[0][0] - E[2][0] * E[0][2];
    return law->weight * absolute(D) *
           stored(law->material, law->part, law->c, 2.0 * first, 4.0 * (first + second),
                  2.0 * first + 4.0 * second + 8.0 * third);
}

/* Sums and differences of eight values over the first, second and third bit of their number. */
INLINE void butterflies(vec v[8])
{
    for (int step = 1; step < 8; step *= 2)
        for (int a = 0; a < 8; ++a)
            if (!(a & step)) {
                vec low = v[a], high = v[a + step];
                v[a] = high + low;
                v[a + step] = high - low;
            }
}

/* Coefficients of a nodal vector: e[m] that of the product of xi (bit 1 of m), eta (2), zeta (4). */
INLINE void coefficients(enum shape shape, const double *u, const int32_t *node, vec e[8][3])
{
    const int nodes = shape == HEXAHEDRON ? 8 : 4;
    double at[8][3][LANES];
    for (int a = 0; a < nodes; ++a)
        for (int l = 0; l < LANES; ++l)
            for (int i = 0; i < 3; ++i)
                at[a][i][l] = u[3 * (int64_t)node[a * LANES + l] + i];
    for (int i = 0; i < 3; ++i) {
        vec v[8];
        for (int a = 0; a < nodes; ++a)
            __builtin_memcpy(&v[a], at[a][i], sizeof(vec));
        for (int a = 1; a < nodes; ++a) /* how far the cell has moved rounds nothing */
            v[a] -= v[0];
        v[0] = all(0.0);
        if (shape == HEXAHEDRON) {
            butterflies(v);
            for (int m = 1; m < 8; ++m)
                e[m][i] = 0.125 * v[m];
        } else {
            for (int m = 1; m < 8; ++m)
                e[m][i] = all(0.0);
            for (int a = 0; a < 3; ++a)
                e[1 << a][i] = v[a + 1];
        }
    }
}

/* The columns of G or g at a point x = (xi, eta, zeta). */
INLINE void columns(const vec e[8][3], const double *x, vec g[3][3])
{
    for (int i = 0; i < 3; ++i) {
        g[0][i] = e[1][i] + x[1] * e[3][i] + x[2] * (e[5][i] + x[1] * e[7][i]);
        g[1][i] = e[2][i] + x[0] * e[3][i] + x[2] * (e[6][i] + x[0] * e[7][i]);
        g[2][i] = e[4][i] + x[0] * e[5][i] + x[1] * (e[6][i] + x[0] * e[7][i]);
    }
}

/* Adds what h at a point does on the coefficients. */
INLINE void collect(const vec h[3][3], const double *x, vec force[8][3])
{
    for (int i = 0; i < 3; ++i) {
        force[1][i] += h[0][i];
        force[2][i] += h[1][i];
        force[4][i] += h[2][i];
        force[3][i] += x[1] * h[0][i] + x[0] * h[1][i];
        force[5][i] += x[2] * h[0][i] + x[0] * h[2][i];
        force[6][i] += x[2] * h[1][i] + x[1] * h[2][i];
        force[7][i] += x[1] * x[2] * h[0][i] + x[0] * x[2] * h[1][i] + x[0] * x[1] * h[2][i];
    }
}

/* The point of a number: its coordinates and its weight. */
INLINE double place_of(enum shape shape, int point, double *x)
{
    const double distance = shape == HEXAHEDRON && point < 8 ? GAUSS : 0.0;
    for (int i = 0; i < 3; ++i)
        x[i] = point >> i & 1 ? distance : -distance;
    return shape == TETRAHEDRON ? 1.0 / 6.0 : point < 8 ? 1.0 : 8.0;
}

/* The number of a point where the last coordinate runs first. */
INLINE int reversed(enum shape shape, int point)
{
    return shape == HEXAHEDRON ? (point & 1) << 2 | (point & 2) | point >> 2 : point;
}

INLINE void scatter(enum shape shape, const int32_t *node, int lanes, vec force[8][3], double *f)
{
    const int nodes = shape == HEXAHEDRON ? 8 : 4;
    for (int i = 0; i < 3; ++i) {
        vec v[8];
        if (shape == HEXAHEDRON) {
            for (int m = 0; m < 8; ++m)
                v[m] = m ? 0.125 * force[m][i] : all(0.0);
            /* The transpose of sums and differences: bit by bit the difference of low and high. */
            for (int step = 1; step < 8; step *= 2)
                for (int a = 0; a < 8; ++a)
                    if (!(a & step)) {
                        vec low = v[a], high = v[a + step];
                        v[a] = low - high;
                        v[a + step] = low + high;
                    }
        } else {
            v[0] = -(force[1][i] + force[2][i] + force[4][i]);
            for (int a = 0; a < 3; ++a)
                v[a + 1] = force[1 << a][i];
        }
        for (int a = 0; a < nodes; ++a)
            force[a][i] = v[a];
    }
    for (int a = 0; a < nodes; ++a)
        for (int l = 0; l < lanes; ++l)
            for (int i = 0; i < 3; ++i)
                f[3 * (int64_t)node[a * LANES + l] + i] += force[a][i][l];
}

/* Derivatives of the nodes' functions by parent coordinates at a point. */
INLINE void gradients(enum shape shape, const double *x, double dN[8][3])
{
    for (int a = 0; a < (shape == HEXAHEDRON ? 8 : 4); ++a)
        for (int i = 0; i < 3; ++i) {
            if (shape == TETRAHEDRON) {
                dN[a][i] = a == 0 ? -1.0 : a == i + 1;
                continue;
            }
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            dN[a][i] = 0.125 * (a >> i & 1 ? 1.0 : -1.0) * (1.0 + (a >> j & 1 ? x[j] : -x[j])) *
                       (1.0 + (a >> k & 1 ? x[k] : -x[k]));
        }
}

/* An entry of moduli, of which only the upper half is there. */
INLINE const vec *of(const vec moduli[9][9], int p, int q)
{
    return p <= q ? &moduli[p][q] : &moduli[q][p];
}

/* Adds a point's part to the upper blocks (a <= b) of the cell's matrix. */
INLINE void stiffen(int nodes, const vec moduli[9][9], const double dN[8][3], vec (*block)[3][3])
{
#pragma GCC unroll 1
    for (int b = 0; b < nodes; ++b) {
        vec M[3][3][3];
        for (int p = 0; p < 9; ++p)
            for (int j = 0; j < 3; ++j)
                M[p / 3][p % 3][j] = *of(moduli, p, j) * dN[b][0] + *of(moduli, p, 3 + j) * dN[b][1] +
                                     *of(moduli, p, 6 + j) * dN[b][2];
#pragma GCC unroll 1
        for (int a = 0; a <= b; ++a, ++block)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    (*block)[i][j] +=
                        M[0][i][j] * dN[a][0] + M[1][i][j] * dN[a][1] + M[2][i][j] * dN[a][2];
    }
}

/* What a call works on. `node` (blocks, a, LANES), `edge` (blocks, 7, 3, LANES) the coefficients of
 * the reference positions; the last block repeats its last cell where there are fewer than LANES,
 * and counts `lanes_of_last`. Null where not wanted: `forces` and `values`, which are added to,
 * `total`, the energy; `excess` (cells), what is added to dW/dJ of the volumetric part in
 * tangents; `beside`, what more is added to these. `start` (cells, a, i, b): in `values`, the first of the three entries of a cell's matrix
 * in the row of (a, i) and the columns of b. */
typedef struct {
    const double *c, *edge, *u, *excess;
    int64_t blocks, lanes_of_last;
    const int32_t *node, *start;
    double *forces, *total, *values;
    const Beside *beside;
} Work;

/* The same with the matrices of points beside, which are not symmetric. */
static __attribute__((noinline)) const int32_t *
insert_with(const Beside *beside, int64_t n, int nodes, int lanes, const int32_t *start,
            vec (*block)[3][3], double *values)
{
    vec whole[64][3][3];
    for (int b = 0; b < nodes; ++b)
        for (int a = 0; a < nodes; ++a)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    whole[b * nodes + a][i][j] =
                        a <= b ? block[b * (b + 1) / 2 + a][i][j] : block[a * (a + 1) / 2 + b][j][i];
    beside->add(beside->cells, n, &whole[0][0][0]);
    return insert(3, nodes, 0, lanes, start, &whole[0][0][0], values);
}

/* All cells of one body; returns whether one is turned inside out. */
INLINE int over_cells(enum material material, enum shape shape, int reduced, int energy,
                      int second, const Work *work)
{
    const int nodes = shape == HEXAHEDRON ? 8 : 4, points = shape == HEXAHEDRON ? 8 + reduced : 1;
    const int32_t *node = work->node, *start = work->start;
    const double *edge = work->edge;
    double sum = 0.0;
    Point at = {};
    const Beside *shared = second && material != VOLUMETRIC ? work->beside : 0;
    if (shared && shared->points != (shape == HEXAHEDRON ? 8 : 1))
        shared = 0;
    for (int64_t n = 0; n < work->blocks; ++n, node += nodes * LANES, edge += 21 * LANES) {
        const int lanes = n + 1 < work->blocks ? LANES : (int)work->lanes_of_last;
        vec E[8][3], e[8][3], force[8][3] = {}, block[36][3][3], total = all(0.0);
        Law law = {material, WHOLE, work->c};
        coefficients(shape, work->u, node, e);
        __builtin_memcpy(E[1], edge, 21 * sizeof(vec));
        for (int m = 1; m < 8 && !energy; ++m)
            for (int i = 0; i < 3; ++i)
                e[m][i] += E[m][i];
        if (second)
            __builtin_memset(block, 0, sizeof block);
        for (int l = 0; second && work->excess && l < lanes; ++l)
            law.excess[l] = work->excess[n * LANES + l];
#pragma GCC unroll 1
        for (int point = 0; point < points; ++point) {
            vec G[3][3], g[3][3];
            double x[3], dN[8][3];
            law.part = !reduced ? WHOLE : point < 8 ? DISTORTION : VOLUME;
            if (material == VOLUMETRIC && law.part != VOLUME)
                continue;
            law.weight = place_of(shape, point, x);
            columns(E, x, G);
            columns(e, x, g);
            if (energy) {
                total += energy_at(&law, G, g, &at.bad); /* g without G */
                continue;
            }
            at_point(&law, G, g, second, &at);
            if (second) {
                if (shared && law.part != VOLUME) {
                    const Place here = {G[0], g[0], at.inverse, at.J, all(1.0), at.weight};
                    shared->moduli(shared->cells, n, reversed(shape, point), &here, at.moduli[0]);
                }
                gradients(shape, x, dN);
                stiffen(nodes, at.moduli, dN, block);
            } else {
                collect(at.h, x, force);
            }
        }
        if (second) {
            const Beside *more = shared ? 0 : work->beside;
            if (more && more->symmetric)
                more->add(more->cells, n, &block[0][0][0]);
            if (more && !more->symmetric)
                start = insert_with(more, n, nodes, lanes, start, block, work->values);
            else
                start = insert(3, nodes, 1, lanes, start, &block[0][0][0], work->values);
        } else if (energy) {
            for (int l = 0; l < lanes; ++l)
                sum += total[l];
        } else {
            scatter(shape, node, lanes, force, work->forces);
        }
    }
    if (energy)
        *work->total = sum;
    return any(at.bad);
}

/* Forces, which are added to `result`, energy, which is put there, and tangent; kind: 0 hexahedra,
 * 1 hexahedra with the volumetric part at the centre, 2 tetrahedra. */
#define CELLS                                                                                      \
    int material, int kind, const double *c, int64_t blocks, int lanes_of_last,                    \
        const int32_t *node, const double *edge, const double *u
#define WORK                                                                                       \
    .c = c, .blocks = blocks, .lanes_of_last = lanes_of_last, .node = node, .edge = edge, .u = u
#define LOOP(energy, second)                                                                       \
    return over_cells(material, kind == 2 ? TETRAHEDRON : HEXAHEDRON, kind == 1, energy, second,   \
                      &work)

EXPORT int tribox_space_forces(CELLS, double *result)
{
    const Work work = {WORK, .forces = result};
    LOOP(0, 0);
}

EXPORT int tribox_space_energy(CELLS, double *result)
{
    const Work work = {WORK, .total = result};
    LOOP(1, 0);
}

EXPORT int tribox_space_tangent(CELLS, const double *excess, const Beside *beside,
                                const int32_t *start, double *values)
{
    const Work work = {WORK, .excess = excess, .beside = beside, .start = start, .values = values};
    LOOP(0, 1);
}
