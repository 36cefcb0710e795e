/* Internal forces and strain energy of first-order hexahedra, several at a time, and the moduli of
 * elastic points in space.
 *
 * In parent coordinates xi the deformation gradient is F = g G^-1, with the columns of g and G the
 * derivatives of the current and of the reference position. The energies are functions of
 * J = det F, I1 = |F|^2 and I2 = |cof F|^2 alone. With A = G^-1 G^-T, K = g A, n = cof g and
 * z = n G^T G/det(G)^2 their derivatives by the columns of g are
 *
 *     dJ/dg = n/det G,   dI1/dg = 2 K,   dI2/dg_a = 2 (g_b x z_c - g_c x z_b),  (a, b, c) cyclic,
 *
 * and h = dW/dg = W_J dJ/dg + W_1 dI1/dg + W_2 dI2/dg gives the nodal forces
 * f_a = sum over points of w |det G| h dN_a/dxi. No derivative by reference coordinates is
 * needed, and those by parent coordinates are the same numbers in all cells.
 *
 * A cell is stored by the coefficients of 1, xi, eta, ..., xi eta zeta in its nodes' reference
 * positions, the displacements are gathered: strains far below the spacing of the coordinates' own
 * round-off are not lost.
 */

#include "point_lanes.h"

#include "energies.h"

#define GAUSS 0.57735026918962576451

/* What holds at a point of the weight w. One instance of the loop serves all materials, or compiling
 * takes a minute. */
typedef struct {
    enum material material;
    enum part part;
    const double *c;
    double weight;
} At;

/* What is found there: w |det G| dW/dg by the columns of g; cells with J <= 0 are marked in `bad`. What
 * takes a logarithm or a root of J is not a number there. */
typedef struct {
    vec h[3][3];
    ivec bad;
} Point;

INLINE void normals(const vec g[3][3], vec n[3][3])
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

/* The point of the columns G and g. */
INLINE void at_point(const At *law, const vec G[3][3], const vec g[3][3], Point *out)
{
    const int distorts = law->part != VOLUME, whole = distorts && law->material != NEO_HOOKEAN;
    vec N[3][3], A[3][3], v[3][3][3], I1 = all(0.0), I2 = all(0.0);
    Slopes s = {};
    normals(G, N);
    normals(g, v[0]);
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
        distort(law->material, law->c, J, r, I1, I2, 0, &s);
    }
    if (law->part != DISTORTION)
        dilate(law->material, law->c, J, r, &s);
    if (needs_volume(law->material, law->part)) /* all bits set: not a number */
        s.J = (vec)((ivec)s.J | ~(ivec)(J > 0.0));
    vec weight = law->weight * absolute(D);
    for (vec *value = &s.J; value <= &s.I2; ++value)
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
}

/* w |det G| W of the point of the columns G and g = G + d, from E = (C - I)/2: of small strains too it
 * has the digits that d has. With eps = (G^T d + d^T G + d^T d)/2 the invariants of E are those of
 * A eps. */
INLINE vec energy_at(const At *law, const vec G[3][3], const vec d[3][3], ivec *bad)
{
    vec N[3][3], n[3], g[3][3], eps[3][3], E[3][3];
    normals(G, N);
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
INLINE void coefficients(const double *u, const int32_t *node, vec e[8][3])
{
    double at[8][3][LANES];
    for (int a = 0; a < 8; ++a)
        for (int l = 0; l < LANES; ++l)
            for (int i = 0; i < 3; ++i)
                at[a][i][l] = u[3 * (int64_t)node[a * LANES + l] + i];
    for (int i = 0; i < 3; ++i) {
        vec v[8];
        for (int a = 0; a < 8; ++a)
            __builtin_memcpy(&v[a], at[a][i], sizeof(vec));
        for (int a = 1; a < 8; ++a) /* how far the cell has moved rounds nothing */
            v[a] -= v[0];
        v[0] = all(0.0);
        butterflies(v);
        for (int m = 1; m < 8; ++m)
            e[m][i] = 0.125 * v[m];
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
INLINE double place_of(int point, double *x)
{
    const double distance = point < 8 ? GAUSS : 0.0;
    for (int i = 0; i < 3; ++i)
        x[i] = point >> i & 1 ? distance : -distance;
    return point < 8 ? 1.0 : 8.0;
}

INLINE void scatter(const int32_t *node, int lanes, vec force[8][3], double *f)
{
    for (int i = 0; i < 3; ++i) {
        vec v[8];
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
        for (int a = 0; a < 8; ++a)
            force[a][i] = v[a];
    }
    for (int a = 0; a < 8; ++a)
        for (int l = 0; l < lanes; ++l)
            for (int i = 0; i < 3; ++i)
                f[3 * (int64_t)node[a * LANES + l] + i] += force[a][i][l];
}

/* What a call works on. `node` (blocks, a, LANES), `edge` (blocks, 7, 3, LANES) the coefficients of
 * the reference positions; the last block repeats its last cell where there are fewer than LANES,
 * and counts `lanes_of_last`. Null where not wanted: `forces`, which are added to, `total`, the energy. */
typedef struct {
    const double *c, *edge, *u;
    int64_t blocks, lanes_of_last;
    const int32_t *node;
    double *forces, *total;
} Work;

/* All cells of one body; returns whether one is turned inside out. */
INLINE int over_cells(enum material material, int reduced, int energy, const Work *work)
{
    const int32_t *node = work->node;
    const double *edge = work->edge;
    double sum = 0.0;
    Point at = {};
    for (int64_t n = 0; n < work->blocks; ++n, node += 8 * LANES, edge += 21 * LANES) {
        const int lanes = n + 1 < work->blocks ? LANES : (int)work->lanes_of_last;
        vec E[8][3], e[8][3], force[8][3] = {}, total = all(0.0);
        At law = {material, WHOLE, work->c};
        coefficients(work->u, node, e);
        __builtin_memcpy(E[1], edge, 21 * sizeof(vec));
        for (int m = 1; m < 8 && !energy; ++m)
            for (int i = 0; i < 3; ++i)
                e[m][i] += E[m][i];
#pragma GCC unroll 1
        for (int point = 0; point < 8 + reduced; ++point) {
            vec G[3][3], g[3][3];
            double x[3];
            law.part = !reduced ? WHOLE : point < 8 ? DISTORTION : VOLUME;
            law.weight = place_of(point, x);
            columns(E, x, G);
            columns(e, x, g);
            if (energy) {
                total += energy_at(&law, G, g, &at.bad); /* g without G */
            } else {
                at_point(&law, G, g, &at);
                collect(at.h, x, force);
            }
        }
        if (!energy)
            scatter(node, lanes, force, work->forces);
        for (int l = 0; energy && l < lanes; ++l)
            sum += total[l];
    }
    if (energy)
        *work->total = sum;
    return any(at.bad);
}

/* Forces, which are added to `result`, and energy, which is put there; kind: 1 with the volumetric part
 * at the centre. */
#define CELLS                                                                                      \
    int material, int kind, const double *c, int64_t blocks, int lanes_of_last,                    \
        const int32_t *node, const double *edge, const double *u
#define WORK                                                                                       \
    .c = c, .blocks = blocks, .lanes_of_last = lanes_of_last, .node = node, .edge = edge, .u = u
#define LOOP(energy)                                                                               \
    return over_cells(material, kind == 1, energy, &work)

EXPORT int tribox_space_forces(CELLS, double *result)
{
    const Work work = {WORK, .forces = result};
    LOOP(0);
}

EXPORT int tribox_space_energy(CELLS, double *result)
{
    const Work work = {WORK, .total = result};
    LOOP(1);
}

/* -- Material points by themselves, see Update of point_lanes.h ------------------------------------ */

/* Moduli, see MODULI of point_lanes.h: with b = F F^T and B = I1 b - b^2 the derivatives of J, I1 and I2 by
 * a change of place are J 1, 2 b and 2 B; returns where J > 0. */
INLINE ivec by_place(const Law *law, const vec *F, vec *moduli)
{
    const int distorts = law->part != VOLUME, whole = distorts && law->material != NEO_HOOKEAN;
    vec n[3][3], b[6], B[6], *c = tangent_of(1, moduli), I1, I2 = all(0.0);
    Slopes s = {};
#pragma GCC unroll 9
    for (int i = 0; i < (whole ? 3 : 1); ++i)
        cross(F + 3 * ((i + 1) % 3), F + 3 * ((i + 2) % 3), n[i]);
    const vec J = dot(F, n[0]);
#pragma GCC unroll 9
    for (int k = 0; k < 6; ++k)
        b[k] = dot(F + 3 * PAIRS[k][0], F + 3 * PAIRS[k][1]);
    I1 = b[0] + b[1] + b[2];
#pragma GCC unroll 9
    for (int i = 0; i < 3 && whole; ++i)
        I2 += dot(n[i], n[i]);
    slopes(law->material, law->part, law->c, J, I1, I2, 1, &s);
    if (needs_volume(law->material, law->part)) { /* all bits set: not a number */
        s.J = (vec)((ivec)s.J | ~(ivec)(J > 0.0));
        s.JJ = (vec)((ivec)s.JJ | ~(ivec)(J > 0.0));
    }
    const vec by_J = J * s.J, JJ = J * (J * s.JJ) + by_J;
#pragma GCC unroll 9
    for (int k = 0; k < 6; ++k) {
        moduli[k] = k < 3 ? by_J : all(0.0);
        if (distorts)
            moduli[k] += 2.0 * s.I1 * b[k];
#pragma GCC unroll 9
        for (int l = k; l < 6; ++l)
            c[6 * k + l] = l < 3 ? JJ : all(0.0);
        c[7 * k] -= k < 3 ? 2.0 * by_J : by_J;
    }
    if (!whole)
        return (ivec)(J > 0.0);
#pragma GCC unroll 9
    for (int k = 0; k < 6; ++k) {
        const int i = PAIRS[k][0], j = PAIRS[k][1];
        B[k] = I1 * b[k];
#pragma GCC unroll 9
        for (int m = 0; m < 3; ++m)
            B[k] -= b[NUMBER[i][m]] * b[NUMBER[m][j]];
        moduli[k] += 2.0 * s.I2 * B[k];
    }
    const vec J1 = 2.0 * J * s.J1, J2 = 2.0 * J * s.J2, two = 2.0 * s.I2;
#pragma GCC unroll 9
    for (int k = 0; k < 6; ++k) {
        const int i = PAIRS[k][0], j = PAIRS[k][1];
        vec one = k < 3 ? J1 : all(0.0), other = k < 3 ? J2 : all(0.0);
        vec along = J1 * b[k] + J2 * B[k];
        one += 4.0 * ((s.I11 + s.I2) * b[k] + s.I12 * B[k]);
        other += 4.0 * (s.I12 * b[k] + s.I22 * B[k]);
#pragma GCC unroll 9
        for (int l = k; l < 6; ++l) {
            const int m = PAIRS[l][0], o = PAIRS[l][1];
            vec sum = one * b[l] + other * B[l];
            if (l < 3)
                sum += along;
            sum -= two * (b[NUMBER[i][m]] * b[NUMBER[j][o]] + b[NUMBER[i][o]] * b[NUMBER[j][m]]);
            c[6 * k + l] += sum;
        }
    }
    return (ivec)(J > 0.0);
}

INLINE void update(enum section section, const Law *law, const vec *F, const vec *state, vec *P,
                   vec *end, vec *moduli, vec *energies, ivec *good)
{
    const At at = {law->material, law->part, law->c, 1.0};
    vec G[3][3], g[3][3], d[3][3];
    Point found = {};
    if (moduli) {
        *good = by_place(law, F, moduli);
        return;
    }
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i) {
            G[a][i] = all(a == i);
            g[a][i] = F[3 * i + a];
            d[a][i] = g[a][i] - (double)(a == i);
        }
    at_point(&at, G, g, &found);
    if (energies) {
        energies[0] = energy_at(&at, G, d, &found.bad);
        energies[1] = energies[2] = all(0.0);
    }
    *good = ~found.bad;
    for (int p = 0; p < 9; ++p)
        P[p] = found.h[p % 3][p / 3];
}

KERNEL(elastic_space, SPACE, update)
