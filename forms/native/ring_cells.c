/* Bodies of revolution: forces, strain energy and tangent of cells in the half section, eight at a
 * time.
 *
 * The energies are functions of I = |F|^2 and J = det F of the in-plane F and of the hoop stretch s.
 * Each point of a cell has a table: the gradients B (j, a) of the nodes' shape functions, those over
 * the radius H (a), and its weight w. With u the displacements of the nodes
 *
 *     F = 1 + sum of u_a (x) B_a,   s = 1 + sum of H_a u_a,x,
 *
 *     f_a = sum over points of w (P B_a + W_s H_a e_x),   P = 2 W_I F + W_J cof F.
 */

#include "plane_cells.h"

/* Derivatives of a part of the energy: p = 2 W_I, q = W_J, s = W_s; II = 4 W_II, IJ = 2 W_IJ,
 * Is = 2 W_Is, JJ, Js, ss. Only the first three and the energy, or all but the energy, are used. */
struct derivatives {
    vec energy, p, q, s, II, IJ, Is, JJ, Js, ss;
};

/* Adds those of U(J s), with its first two derivatives. */
INLINE void add_volumetric(struct derivatives *w, vec J, vec s, vec first, vec second)
{
    w->q += first * s;
    w->s += first * J;
    w->JJ += second * s * s;
    w->Js += second * J * s + first;
    w->ss += second * J * J;
}

INLINE struct derivatives derive_ring(enum material material, enum part part, const double *c,
                                      vec I, vec J, vec s)
{
    const int d = part != VOLUME, v = part != DISTORTION;
    struct derivatives w = {};
    vec r = 1.0 / (J * s), of_J = r * s, of_s = r * J, whole = J * s;
    if (material == NEO_HOOKEAN) { /* c: G, Lambda */
        vec l = logarithm(whole);
        vec first = ((v ? c[1] * l : all(0.0)) - (d ? c[0] : 0.0)) * r;
        vec second = ((v ? c[1] * (1.0 - l) : all(0.0)) + (d ? c[0] : 0.0)) * r * r;
        add_volumetric(&w, J, s, first, second);
        if (d) {
            w.energy += c[0] * (0.5 * (I + s * s - 3.0) - l);
            w.p += c[0];
            w.s += c[0] * s;
            w.ss += c[0];
        }
        if (v)
            w.energy += 0.5 * c[1] * l * l;
    } else if (material == MOONEY_RIVLIN) { /* c: C10, C01, K */
        if (d) {
            vec y = inverse_cube_root(whole), j = y * y, a = c[0] * j, b = c[1] * j * j;
            vec I1 = I + s * s, I2 = I * s * s + J * J, aI = a * I1, bI = b * I2;
            vec once = (-2.0 / 3.0) * aI - (4.0 / 3.0) * bI;
            vec twice = (10.0 / 9.0) * aI + (28.0 / 9.0) * bI;
            w.energy = c[0] * (j * I1 - 3.0) + c[1] * (j * j * I2 - 3.0);
            w.p = 2.0 * (a + b * s * s);
            w.q = once * of_J + 2.0 * b * J;
            w.s = once * of_s + 2.0 * (a + b * I) * s;
            w.IJ = (-4.0 / 3.0) * (a + 2.0 * b * s * s) * of_J;
            w.Is = (4.0 / 3.0) * (b * s - a * of_s);
            w.JJ = twice * of_J * of_J - (10.0 / 3.0) * b;
            w.Js = ((4.0 / 9.0) * aI + (16.0 / 9.0) * bI) * r -
                   (4.0 / 3.0) * (a + 2.0 * b * I) * s * of_J - (8.0 / 3.0) * b * J * of_s;
            w.ss = twice * of_s * of_s - (2.0 / 3.0) * a - (10.0 / 3.0) * b * I;
        }
        if (v) {
            add_volumetric(&w, J, s, 0.5 * c[2] * (whole - r), 0.5 * c[2] * (1.0 + r * r));
            w.energy += 0.25 * c[2] * (whole * whole - 1.0 - 2.0 * logarithm(whole));
        }
    } else { /* c: G, K */
        vec across = logarithm(s), plane = logarithm(J), l = across + plane;
        double k = (v ? c[1] : 0.0) - (d ? 2.0 / 3.0 * c[0] : 0.0);
        add_volumetric(&w, J, s, k * l * r, k * (1.0 - l) * r * r);
        w.energy = 0.5 * k * l * l;
        if (d) {
            vec value, slope, y = 0.5 * I * of_J, half = 0.5 * c[0] * of_J * of_J;
            squared_arcosh(y - 1.0, &value, &slope);
            vec curvature = curvature_of_squared_arcosh(y - 1.0, slope);
            w.energy += c[0] * (0.5 * (value + plane * plane) + across * across);
            w.p = 0.5 * c[0] * slope * of_J;
            w.q += (c[0] * plane - 0.5 * c[0] * slope * y) * of_J;
            w.s += 2.0 * c[0] * across * of_s;
            w.II = half * curvature;
            w.IJ = -half * (curvature * y + slope);
            w.JJ += c[0] * (1.0 - plane) * of_J * of_J + half * (curvature * y + 2.0 * slope) * y;
            w.ss += 2.0 * c[0] * (1.0 - across) * of_s * of_s;
        }
    }
    return w;
}

/* One point of a block's cells. */
struct point {
    vec F[2][2], cof[2][2], J, s, I;
    ivec inverted;
};

INLINE struct point at_point(int nodes, const vec *table, const vec u[4][2])
{
    struct point at = {{{all(1.0), all(0.0)}, {all(0.0), all(1.0)}}};
    at.s = all(1.0);
    for (int a = 0; a < nodes; ++a) {
        for (int i = 0; i < 2; ++i)
            for (int j = 0; j < 2; ++j)
                at.F[i][j] += u[a][i] * table[j * nodes + a];
        at.s += u[a][0] * table[2 * nodes + a];
    }
    at.cof[0][0] = at.F[1][1], at.cof[0][1] = -at.F[1][0];
    at.cof[1][0] = -at.F[0][1], at.cof[1][1] = at.F[0][0];
    at.J = at.F[0][0] * at.F[1][1] - at.F[0][1] * at.F[1][0];
    at.I = at.F[0][0] * at.F[0][0] + at.F[0][1] * at.F[0][1] + at.F[1][0] * at.F[1][0] +
           at.F[1][1] * at.F[1][1];
    at.inverted = ~((ivec)(at.J > 0.0) & (ivec)(at.s > 0.0));
    return at;
}

INLINE void add_forces(int nodes, const vec *table, const struct point *at,
                       const struct derivatives *w, vec force[4][2])
{
    const vec weight = table[3 * nodes];
    for (int i = 0; i < 2; ++i) {
        vec first = (w->p * at->F[i][0] + w->q * at->cof[i][0]) * weight;
        vec second = (w->p * at->F[i][1] + w->q * at->cof[i][1]) * weight;
        for (int a = 0; a < nodes; ++a)
            force[a][i] += first * table[a] + second * table[nodes + a];
    }
    for (int a = 0; a < nodes; ++a)
        force[a][0] += w->s * weight * table[2 * nodes + a];
}

/* Adds w (d^2 W) of a point, (i, j, k, l) of F and the hoop stretch, carried over to the nodes; and
 * those that a `point` beside has of its own. */
INLINE void add_matrix(int nodes, const vec *table, const struct point *at, const struct derivatives *w,
                       const Beside *beside, int64_t block, int64_t point, vec matrix[4][2][4][2])
{
    const vec weight = table[3 * nodes];
    vec M[2][2][2][2], S[2][2], ss = w->ss * weight, more[5][5];
    if (beside) {
        const vec g[4] = {at->F[0][0], at->F[1][0], at->F[0][1], at->F[1][1]};
        const Place here = {0, g, all(1.0), at->J, at->s, weight};
        __builtin_memset(more, 0, sizeof more);
        beside->moduli(beside->cells, block, point, &here, more[0]);
        ss += more[4][4];
    }
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) {
            vec by_F = w->II * at->F[i][j] + w->IJ * at->cof[i][j];
            vec by_cof = w->IJ * at->F[i][j] + w->JJ * at->cof[i][j];
            S[i][j] = (w->Is * at->F[i][j] + w->Js * at->cof[i][j]) * weight;
            for (int k = 0; k < 2; ++k)
                for (int l = 0; l < 2; ++l) {
                    vec m = by_F * at->F[k][l] + by_cof * at->cof[k][l];
                    if (i == k && j == l)
                        m += w->p;
                    if (i != k && j != l)
                        m = i == j ? m + w->q : m - w->q;
                    M[i][j][k][l] = m * weight;
                    if (beside && 2 * j + i <= 2 * l + k)
                        M[i][j][k][l] += more[2 * j + i][2 * l + k];
                    else if (beside)
                        M[i][j][k][l] += more[2 * l + k][2 * j + i];
                }
            if (beside)
                S[i][j] += more[2 * j + i][4];
        }
    for (int b = 0; b < nodes; ++b)
        for (int k = 0; k < 2; ++k) {
            vec t[2][2], hoop = all(0.0);
            for (int i = 0; i < 2; ++i)
                for (int j = 0; j < 2; ++j)
                    t[i][j] = M[i][j][k][0] * table[b] + M[i][j][k][1] * table[nodes + b];
            hoop = S[k][0] * table[b] + S[k][1] * table[nodes + b];
            if (k == 0) {
                for (int i = 0; i < 2; ++i)
                    for (int j = 0; j < 2; ++j)
                        t[i][j] += S[i][j] * table[2 * nodes + b];
                hoop += ss * table[2 * nodes + b];
            }
            for (int a = 0; a < nodes; ++a) {
                for (int i = 0; i < 2; ++i)
                    matrix[a][i][b][k] += t[i][0] * table[a] + t[i][1] * table[nodes + a];
                matrix[a][0][b][k] += hoop * table[2 * nodes + a];
            }
        }
}

/* Displacements of the nodes of a block's cells. */
INLINE void gather(const double *u, const int32_t *node, int nodes, vec at[4][2])
{
    for (int a = 0; a < nodes; ++a)
        for (int l = 0; l < LANES; ++l)
            for (int i = 0; i < 2; ++i)
                at[a][i][l] = u[2 * (int64_t)node[a * LANES + l] + i];
}

enum { CORNERS = 4 }; /* in the table of nodes, also of triangles */

/* All cells of one body. `node` (blocks, 4, LANES), `table` (blocks, points, 3 nodes + 1, LANES); the
 * points of quadrilaterals are four, and the centre for the volumetric part if `reduced`, those of
 * triangles three. Forces are added to `f`, the energy is returned in `total` and the tangent added
 * to `values`, each unless it is null. Returns whether a cell is turned inside out. */
INLINE int over_cells(enum material material, int triangles, int reduced, const double *c,
                      int64_t blocks, int lanes_of_last, const int32_t *node, const double *table,
                      const double *u, double *f, double *total, const double *excess,
                      const Beside *beside, const int32_t *start, double *values)
{
    const int nodes = triangles ? 3 : 4, full = nodes, size = 3 * nodes + 1;
    const int shared = values && beside && material != VOLUMETRIC && beside->points == full;
    ivec bad = {};
    double sum = 0.0;
    for (int64_t b = 0; b < blocks; ++b, node += CORNERS * LANES) {
        const int lanes = b + 1 < blocks ? LANES : lanes_of_last;
        vec at[4][2], force[4][2] = {}, matrix[4][2][4][2] = {}, energy = {};
        gather(u, node, nodes, at);
        for (int point = 0; point < full + reduced; ++point, table += size * LANES) {
            const enum part part = !reduced ? WHOLE : point < full ? DISTORTION : VOLUME;
            if (material == VOLUMETRIC && part != VOLUME)
                continue;
            vec tabled[13];
            __builtin_memcpy(tabled, table, size * sizeof(vec));
            struct point here = at_point(nodes, tabled, at);
            struct derivatives w = derive_ring(material, part, c, here.I, here.J, here.s);
            bad |= here.inverted;
            if (excess && part == VOLUME) {
                vec more = all(0.0);
                for (int l = 0; l < lanes; ++l)
                    more[l] = excess[b * LANES + l];
                w.q += more * here.s;
                w.Js += more;
            }
            if (needs_volume(material, part)) { /* all bits set: not a number */
                w.q = (vec)((ivec)w.q | here.inverted);
                w.JJ = (vec)((ivec)w.JJ | here.inverted);
            }
            if (f)
                add_forces(nodes, tabled, &here, &w, force);
            if (values)
                add_matrix(nodes, tabled, &here, &w, shared && part != VOLUME ? beside : 0, b, point, matrix);
            if (total)
                energy += tabled[3 * nodes] * w.energy;
        }
        for (int l = 0; f && l < lanes; ++l)
            for (int a = 0; a < nodes; ++a)
                for (int i = 0; i < 2; ++i)
                    f[2 * (int64_t)node[a * LANES + l] + i] += force[a][i][l];
        for (int l = 0; total && l < lanes; ++l)
            sum += energy[l];
        if (values && beside && !shared)
            add_beside(beside, b, nodes, matrix);
        if (values)
            start = scatter_matrix(start, nodes, lanes, matrix, values);
    }
    if (total)
        *total = sum;
    return any(bad);
}

/* One instance of the loop for each material and kind of cell: 0 quadrilaterals, 1 quadrilaterals
 * with the volumetric part at the centre, 2 triangles. */
#define LOOP(material, triangles, reduced)                                                         \
    return over_cells(material, triangles, reduced, c, blocks, lanes_of_last, node, table, u,      \
                      FORCE, TOTAL, EXCESS, BESIDE, START, VALUES)
#define CELLS                                                                                      \
    int material, int kind, const double *c, int64_t blocks, int lanes_of_last,                    \
        const int32_t *node, const double *table, const double *u

/* Adds the forces to `result`. */
EXPORT int tribox_ring_forces(CELLS, double *result)
{
#define FORCE result
#define TOTAL 0
#define EXCESS 0
#define BESIDE 0
#define START 0
#define VALUES 0
    LOOPS
#undef FORCE
#undef TOTAL
}

/* Puts the strain energy into `result`. */
EXPORT int tribox_ring_energy(CELLS, double *result)
{
#define FORCE 0
#define TOTAL result
    LOOPS
#undef TOTAL
#undef EXCESS
#undef BESIDE
#undef START
#undef VALUES
}

/* Adds the tangent to `values`. */
EXPORT int tribox_ring_tangent(CELLS, const double *excess, const Beside *beside,
                               const int32_t *start, double *values)
{
#define TOTAL 0
#define EXCESS excess
#define BESIDE beside
#define START start
#define VALUES values
    LOOPS
}
