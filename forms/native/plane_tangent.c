/* Tangents of plane-strain bodies, eight cells at a time, added where they lie in a sparse matrix.
 *
 * The energy w D W(I, J) of a point, with I = (g A : g)/D, J = det g/D, D = det G and
 * A = D G^-1 G^-T, has the second derivatives by the columns of g
 *
 *     H = w (p A (x) 1 + q d(cof g)/dg
 *            + (4 W_II gA (x) gA + 2 W_IJ (gA (x) cof g + cof g (x) gA) + W_JJ cof g (x) cof g)/D),
 *
 * p = 2 W_I and q = W_J. They are summed up over the points as derivatives by the differences of
 * the nodes' positions, of which g is linear in xi, and carried over to the nodes once per cell.
 */

#include "plane_cells.h"

/* Second derivatives of a part of the energy: 4 W_II, 2 W_IJ and W_JJ. */
INLINE void derive_twice(enum material material, enum part part, const double *c, vec I, vec J,
                         vec r, vec *II, vec *IJ, vec *JJ)
{
    const int d = part != VOLUME, v = part != DISTORTION;
    *II = *IJ = *JJ = all(0.0);
    if (material == NEO_HOOKEAN) { /* c: G, Lambda */
        if (d)
            *JJ += c[0];
        if (v)
            *JJ += c[1] * (1.0 - logarithm(J));
        *JJ *= r * r;
    } else if (material == MOONEY_RIVLIN) { /* c: C10, C01, K */
        if (d) {
            vec y = inverse_cube_root(J), j = y * y, a = c[0] * j, b = c[1] * j * j;
            vec I1 = I + 1.0, I2 = I + J * J;
            *IJ = (-4.0 / 3.0) * r * (a + 2.0 * b);
            *JJ = r * r * ((10.0 / 9.0) * a * I1 + (28.0 / 9.0) * b * I2) - (10.0 / 3.0) * b;
        }
        if (v)
            *JJ += 0.5 * c[2] * (1.0 + r * r);
    } else { /* c: G, K */
        double k = (d ? c[0] / 3.0 : 0.0) + (v ? c[1] : 0.0);
        *JJ = k * (1.0 - logarithm(J));
        if (d) {
            vec value, slope, y = 0.5 * I * r, half = 0.5 * c[0] * r * r;
            squared_arcosh(y - 1.0, &value, &slope);
            vec curvature = curvature_of_squared_arcosh(y - 1.0, slope);
            *II = half * curvature;
            *IJ = -half * (curvature * y + slope);
            *JJ += 0.5 * c[0] * (curvature * y + 2.0 * slope) * y;
        }
        *JJ *= r * r;
    }
}

/* H (alpha, i, beta, j) of a point, upper half; `excess` is added to the pressure q. Not a number where
 * J <= 0 and the stress takes a logarithm or a root of it. Of `beside`, where there is one, the moduli
 * of a `point` of its own join these. */
INLINE void second_derivatives(enum material material, enum part part, const double *c,
                               double full, const vec G[2][2], const vec g[2][2], vec excess,
                               const Beside *beside, int64_t block, int64_t point, vec H[2][2][2][2])
{
    vec D = G[0][0] * G[1][1] - G[0][1] * G[1][0];
    vec d = g[0][0] * g[1][1] - g[0][1] * g[1][0];
    vec inverse = 1.0 / (D * d), of_D = d * inverse, J = d * of_D, r = D * D * inverse;
    const vec cof[2][2] = {{g[1][1], -g[1][0]}, {-g[0][1], g[0][0]}};
    vec p, q, II, IJ, JJ, I = all(0.0), gA[2][2], A[2][2], weight = weighted(full, D);
    if (part != VOLUME) {
        A[0][0] = (G[1][0] * G[1][0] + G[1][1] * G[1][1]) * of_D;
        A[1][1] = (G[0][0] * G[0][0] + G[0][1] * G[0][1]) * of_D;
        A[0][1] = A[1][0] = -(G[0][0] * G[1][0] + G[0][1] * G[1][1]) * of_D;
        for (int i = 0; i < 2; ++i)
            for (int k = 0; k < 2; ++k) {
                gA[k][i] = g[0][i] * A[0][k] + g[1][i] * A[1][k];
                I += gA[k][i] * g[k][i];
            }
        I *= of_D;
    }
    derive(material, part, c, I, J, r, &p, &q);
    derive_twice(material, part, c, I, J, r, &II, &IJ, &JJ);
    if (needs_volume(material, part))
        JJ = (vec)((ivec)JJ | ~(ivec)(J > 0.0)); /* all bits set: not a number */
    of_D *= weight;
    II *= of_D, IJ *= of_D, JJ *= of_D;
    p *= weight;
    q = (q + excess) * weight;
    for (int k = 0; k < 4; ++k) {
        const int x = k >> 1, i = k & 1;
        vec by_gA = IJ * cof[x][i], by_cof = JJ * cof[x][i];
        if (part != VOLUME) {
            by_gA += II * gA[x][i];
            by_cof += IJ * gA[x][i];
        }
        for (int l = k; l < 4; ++l) {
            const int y = l >> 1, j = l & 1;
            vec h = by_cof * cof[y][j];
            if (part != VOLUME)
                h += by_gA * gA[y][j];
            if (part != VOLUME && i == j)
                h += p * A[x][y];
            if (x != y && i != j)
                h = i < j ? h + q : h - q;
            H[x][i][y][j] = h;
        }
    }
    if (beside) {
        const Place here = {G[0], g[0], inverse * d, J, all(1.0), weight * D};
        beside->moduli(beside->cells, block, point, &here, &H[0][0][0][0]);
    }
}

/* Adds H of a point at (xi, eta) to the derivatives by the differences along xi, along eta and the
 * mixed one: K (3, i, 3, j), its upper half. */
INLINE void add_point(double xi, double eta, vec H[2][2][2][2], vec K[3][2][3][2])
{
    for (int x = 0; x < 2; ++x) /* only the upper half is there */
        H[x][1][x][0] = H[x][0][x][1];
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) {
            vec first = eta * H[0][i][0][j] + xi * H[0][i][1][j];
            vec second = eta * H[0][j][1][i] + xi * H[1][i][1][j];
            K[0][i][0][j] += H[0][i][0][j];
            K[0][i][1][j] += H[0][i][1][j];
            K[1][i][1][j] += H[1][i][1][j];
            K[0][i][2][j] += first;
            K[1][i][2][j] += second;
            K[2][i][2][j] += eta * first + xi * second;
        }
}

/* Rows, or columns, of the nodes from those of the differences. */
INLINE void to_nodes(vec along, vec up, vec mixed, vec at[4])
{
    at[0] = (mixed - along) - up;
    at[1] = along - mixed;
    at[2] = up - mixed;
    at[3] = mixed;
}

INLINE void quadrilateral(enum material material, int reduced, const double *c, const vec E[3][2],
                          const vec e[3][2], vec excess, const Beside *beside, int64_t block,
                          vec matrix[4][2][4][2])
{
    const double low = 0.21132486540518713, gauss[2] = {low, 1.0 - low};
    vec K[3][2][3][2] = {}, rows[4][2][3][2], G[2][2], g[2][2], H[2][2][2][2];
    for (int point = material == VOLUMETRIC ? 4 : 0; point < 4; ++point) {
        double xi = gauss[point & 1], eta = gauss[point >> 1];
        columns(E, xi, eta, G);
        columns(e, xi, eta, g);
        /* the last coordinate of the points beside runs first */
        second_derivatives(material, reduced ? DISTORTION : WHOLE, c, 0.25, G, g, all(0.0), beside, block,
                           (point & 1) << 1 | point >> 1, H);
        add_point(xi, eta, H, K);
    }
    if (reduced) {
        columns(E, 0.5, 0.5, G);
        columns(e, 0.5, 0.5, g);
        second_derivatives(material, VOLUME, c, 1.0, G, g, excess, 0, 0, 0, H);
        add_point(0.5, 0.5, H, K);
    }
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j)
            for (int n = 0; n < 3; ++n) {
                vec column[3], at[4];
                for (int m = 0; m < 3; ++m)
                    column[m] = m <= n ? K[m][i][n][j] : K[n][j][m][i];
                to_nodes(column[0], column[1], column[2], at);
                for (int a = 0; a < 4; ++a)
                    rows[a][i][n][j] = at[a];
            }
    for (int a = 0; a < 4; ++a)
        for (int i = 0; i < 2; ++i)
            for (int j = 0; j < 2; ++j) {
                vec at[4];
                to_nodes(rows[a][i][0][j], rows[a][i][1][j], rows[a][i][2][j], at);
                for (int b = 0; b < 4; ++b)
                    matrix[a][i][b][j] = at[b];
            }
}

INLINE void triangle(enum material material, const double *c, const vec E[3][2], const vec e[3][2],
                     vec matrix[4][2][4][2])
{
    vec H[2][2][2][2];
    second_derivatives(material, WHOLE, c, 0.5, E, e, all(0.0), 0, 0, 0, H);
    for (int k = 0; k < 4; ++k)
        for (int l = 0; l < k; ++l)
            H[k >> 1][k & 1][l >> 1][l & 1] = H[l >> 1][l & 1][k >> 1][k & 1];
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) {
            vec first = H[0][i][0][j] + H[1][i][0][j], second = H[0][i][1][j] + H[1][i][1][j];
            matrix[0][i][0][j] = first + second;
            matrix[0][i][1][j] = -first;
            matrix[0][i][2][j] = -second;
            for (int x = 0; x < 2; ++x) {
                matrix[x + 1][i][0][j] = -(H[x][i][0][j] + H[x][i][1][j]);
                matrix[x + 1][i][1][j] = H[x][i][0][j];
                matrix[x + 1][i][2][j] = H[x][i][1][j];
            }
        }
}

/* All cells of one body; `node` and `edge` as in plane_kernel.c, `excess` (cells) is added to the
 * volumetric pressures unless it is null, and so are the matrices of `beside`; `start` (cells, a, i,
 * b). */
INLINE void over_cells(enum material material, int triangles, int reduced, const double *c,
                       int64_t blocks, int lanes_of_last, const int32_t *node, const double *edge,
                       const double *u, const double *excess, const Beside *beside,
                       const int32_t *start, double *values)
{
    const int nodes = triangles ? 3 : 4;
    const int shared = beside && !triangles && material != VOLUMETRIC && beside->points == 4;
    for (int64_t b = 0; b < blocks; ++b, node += 4 * LANES, edge += 6 * LANES) {
        const int lanes = b + 1 < blocks ? LANES : lanes_of_last;
        vec E[3][2], e[3][2], matrix[4][2][4][2], more = all(0.0);
        differences(u, node, e);
        __builtin_memcpy(E, edge, sizeof E);
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 2; ++i)
                e[k][i] += E[k][i];
        for (int l = 0; excess && l < lanes; ++l)
            more[l] = excess[b * LANES + l];
        if (triangles)
            triangle(material, c, E, e, matrix);
        else
            quadrilateral(material, reduced, c, E, e, more, shared ? beside : 0, b, matrix);
        if (beside && !shared)
            add_beside(beside, b, nodes, matrix);
        start = scatter_matrix(start, nodes, lanes, matrix, values);
    }
}

/* Adds the tangent to `values`; material and kind as in plane_kernel.c. */
EXPORT int tribox_plane_tangent(int material, int kind, const double *c, int64_t blocks,
                                int lanes_of_last, const int32_t *node, const double *edge,
                                const double *u, const double *excess, const Beside *beside,
                                const int32_t *start, double *values)
{
#define LOOP(material, triangles, reduced)                                                         \
    over_cells(material, triangles, reduced, c, blocks, lanes_of_last, node, edge, u, excess,      \
               beside, start, values)
    switch (3 * material + kind) {
    case 0: LOOP(NEO_HOOKEAN, 0, 0); break;
    case 1: LOOP(NEO_HOOKEAN, 0, 1); break;
    case 2: LOOP(NEO_HOOKEAN, 1, 0); break;
    case 3: LOOP(MOONEY_RIVLIN, 0, 0); break;
    case 4: LOOP(MOONEY_RIVLIN, 0, 1); break;
    case 5: LOOP(MOONEY_RIVLIN, 1, 0); break;
    case 6: LOOP(HENCKY, 0, 0); break;
    case 7: LOOP(HENCKY, 0, 1); break;
    case 8: LOOP(HENCKY, 1, 0); break;
    default: LOOP(VOLUMETRIC, 0, 1);
    }
    return 0;
}
