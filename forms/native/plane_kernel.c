/* Internal forces and strain energy of first-order cells in plane strain, several at a time.
 *
 * In parent coordinates xi the deformation gradient is F = g G^-1, with the columns of g and G the
 * derivatives of the current and of the reference position. The energies are functions of
 * I = |F|^2 and J = det F alone. With p = 2 dW/dI and q = dW/dJ the first Piola stress is P = p F + q cof F. As
 * cof F cof G = cof g, the nodal forces are
 *
 *     f_a = sum over points of w (p g A + q cof g) dN_a/dxi,   A = det G G^-1 G^-T,
 *
 * which takes one division per point, and one logarithm where the energy has one.
 *
 * Nodes stand in DOLFINx's order, whichever way that goes round the cell. A cell is stored by the
 * differences of its nodes' reference positions, the displacements are gathered: strains far below the
 * spacing of the coordinates' own round-off are not lost.
 */

#include "lanes.h"

enum material { NEO_HOOKEAN, MOONEY_RIVLIN, HENCKY };
enum part { WHOLE, DISTORTION, VOLUME };

/* Whether the stress of a part of the energy takes a logarithm or a root of J. */
INLINE int needs_volume(enum material material, enum part part)
{
    return material == NEO_HOOKEAN     ? part != DISTORTION
           : material == MOONEY_RIVLIN ? part != VOLUME
                                       : 1;
}

/* p = 2 dW/dI and q = dW/dJ of a part of the energy, with I = |F|^2 in the plane; `r` is 1/J. */
INLINE void derive(enum material material, enum part part, const double *c, vec I, vec J, vec r,
                   vec *p, vec *q)
{
    const int d = part != VOLUME, v = part != DISTORTION;
    if (material == NEO_HOOKEAN) { /* c: G, Lambda */
        *p = all(d ? c[0] : 0.0);
        *q = ((v ? c[1] * logarithm(J) : all(0.0)) - (d ? c[0] : 0.0)) * r;
    } else if (material == MOONEY_RIVLIN) { /* c: C10, C01, K */
        *p = *q = all(0.0);
        if (d) {
            vec y = inverse_cube_root(J), j = y * y, a = c[0] * j, b = c[1] * j * j;
            vec I1 = I + 1.0, I2 = I + J * J;
            *p = 2.0 * (a + b);
            *q = 2.0 * b * J - (2.0 / 3.0) * r * (a * I1 + 2.0 * b * I2);
        }
        if (v)
            *q += 0.5 * c[2] * (J - r);
    } else { /* c: G, K */
        double k = (d ? c[0] / 3.0 : 0.0) + (v ? c[1] : 0.0);
        *p = all(0.0);
        *q = k * logarithm(J);
        if (d) {
            vec value, slope, y = 0.5 * I * r;
            squared_arcosh(y - 1.0, &value, &slope);
            *p = (0.5 * c[0]) * slope * r;
            *q -= (0.5 * c[0]) * slope * y;
        }
        *q *= r;
    }
}

/* The weight of a point whose G has the determinant D: of cells that go round clockwise D, cof g and
 * A are of the other sign, the energy's density and its derivatives by F are not. */
INLINE vec weighted(double weight, vec D)
{
    return (vec)((uvec)all(weight) | ((uvec)D & 1ULL << 63));
}

/* Differences of a nodal vector over four nodes: along xi, along eta, and the mixed one. */
INLINE void differences(const double *u, const int32_t *node, vec e[3][2])
{
    double at[4][2][LANES];
    for (int a = 0; a < 4; ++a)
        for (int l = 0; l < LANES; ++l)
            for (int i = 0; i < 2; ++i)
                at[a][i][l] = u[2 * (int64_t)node[a * LANES + l] + i];
    for (int i = 0; i < 2; ++i) {
        vec v[4];
        for (int a = 0; a < 4; ++a)
            __builtin_memcpy(&v[a], at[a][i], sizeof(vec));
        e[0][i] = v[1] - v[0];
        e[1][i] = v[2] - v[0];
        e[2][i] = (v[3] - v[2]) - e[0][i];
    }
}

/* The columns of G or g at (xi, eta) from the differences. */
INLINE void columns(const vec e[3][2], double xi, double eta, vec g[2][2])
{
    for (int i = 0; i < 2; ++i) {
        g[0][i] = e[0][i] + eta * e[2][i];
        g[1][i] = e[1][i] + xi * e[2][i];
    }
}

/* One LOOP for each material and kind of cell: 0 quadrilaterals, 1 quadrilaterals with the volumetric
 * part at the centre, 2 triangles. */
#define LOOPS                                                                                      \
    switch (3 * material + kind) {                                                                 \
    case 0: LOOP(NEO_HOOKEAN, 0, 0);                                                               \
    case 1: LOOP(NEO_HOOKEAN, 0, 1);                                                               \
    case 2: LOOP(NEO_HOOKEAN, 1, 0);                                                               \
    case 3: LOOP(MOONEY_RIVLIN, 0, 0);                                                             \
    case 4: LOOP(MOONEY_RIVLIN, 0, 1);                                                             \
    case 5: LOOP(MOONEY_RIVLIN, 1, 0);                                                             \
    case 6: LOOP(HENCKY, 0, 0);                                                                    \
    case 7: LOOP(HENCKY, 0, 1);                                                                    \
    default: LOOP(HENCKY, 1, 0);                                                                   \
    }

/* A part of the energy, from the columns of G and of the displacement's derivatives d.
 *
 * With H = d G^-1, x = J - 1 = tr H + det H, a = I - 2 J = (H11 - H22)^2 + (H12 + H21)^2 and the cube
 * root k of J the energies are sums of squares, which keep all digits however small the strain:
 *
 *     (I - 2)/2 - ln J = a/2 + (x - ln J),     J^2 - 1 - 2 ln J = x^2 + 2 (x - ln J),
 *     (I + 1)/k^2 - 3 = (a + (k - 1)^2 (2 k + 1))/k^2,
 *     (I + J^2)/k^4 - 3 = a/k^4 + (k - 1)^2 (k + 2)/k. */
INLINE vec stored(enum material material, enum part part, const double *c, const vec G[2][2],
                  const vec d[2][2])
{
    const int shape = part != VOLUME, volume = part != DISTORTION;
    vec inverse = 1.0 / (G[0][0] * G[1][1] - G[0][1] * G[1][0]), H[2][2], w = all(0.0), rest, l;
    for (int i = 0; i < 2; ++i) {
        H[i][0] = (d[0][i] * G[1][1] - d[1][i] * G[0][1]) * inverse;
        H[i][1] = (d[1][i] * G[0][0] - d[0][i] * G[1][0]) * inverse;
    }
    vec x = H[0][0] + H[1][1] + (H[0][0] * H[1][1] - H[0][1] * H[1][0]), J = 1.0 + x;
    vec unequal = H[0][0] - H[1][1], sheared = H[0][1] + H[1][0];
    vec a = unequal * unequal + sheared * sheared;
    logarithm_of_sum(x, &l, &rest);
    if (material == NEO_HOOKEAN) {
        if (shape)
            w += c[0] * (0.5 * a + rest);
        if (volume)
            w += 0.5 * c[1] * l * l;
    } else if (material == MOONEY_RIVLIN) {
        if (shape) {
            vec y = inverse_cube_root(J), k = 1.0 / y, j = y * y, e = x / (k * k + k + 1.0);
            w += c[0] * j * (a + e * e * (2.0 * k + 1.0));
            w += c[1] * (j * j * a + e * e * (k + 2.0) * y);
        }
        if (volume)
            w += 0.25 * c[2] * (x * x + 2.0 * rest);
    } else {
        w += ((shape ? c[0] / 6.0 : 0.0) + (volume ? 0.5 * c[1] : 0.0)) * l * l;
        if (shape) {
            vec value, slope;
            squared_arcosh(0.5 * a / J, &value, &slope);
            w += 0.5 * c[0] * value;
        }
    }
    return w;
}

/* A point of a cell: from the columns of G and g to h = p g A + q cof g (columns), times the weight;
 * the energy is added to `energy`, if that is not null, from the columns of g - G. Cells with J <= 0
 * are marked in `bad`, and `h` is no number there if the stress takes a logarithm or a root of J. */
INLINE void at_point(enum material material, enum part part, const double *c, double full,
                     const vec G[2][2], const vec g[2][2], const vec moved[2][2], vec h[2][2],
                     vec *energy, ivec *bad)
{
    vec D = G[0][0] * G[1][1] - G[0][1] * G[1][0];
    vec d = g[0][0] * g[1][1] - g[0][1] * g[1][0];
    vec inverse = 1.0 / (D * d), of_D = d * inverse, J = d * of_D, r = D * D * inverse;
    vec p, q, I = all(0.0), gA[2][2], weight = weighted(full, D);
    if (part != VOLUME) {
        vec A11 = (G[1][0] * G[1][0] + G[1][1] * G[1][1]) * of_D;
        vec A22 = (G[0][0] * G[0][0] + G[0][1] * G[0][1]) * of_D;
        vec A12 = -(G[0][0] * G[1][0] + G[0][1] * G[1][1]) * of_D;
        for (int i = 0; i < 2; ++i) {
            gA[0][i] = g[0][i] * A11 + g[1][i] * A12;
            gA[1][i] = g[0][i] * A12 + g[1][i] * A22;
            I += gA[0][i] * g[0][i] + gA[1][i] * g[1][i];
        }
        I *= of_D;
    }
    ivec inverted = ~(ivec)(J > 0.0);
    *bad |= inverted;
    derive(material, part, c, I, J, r, &p, &q);
    q *= weight;
    if (needs_volume(material, part))
        q = (vec)((ivec)q | inverted); /* all bits set: not a number */
    h[0][0] = q * g[1][1];
    h[0][1] = -q * g[1][0];
    h[1][0] = -q * g[0][1];
    h[1][1] = q * g[0][0];
    if (part != VOLUME) {
        p *= weight;
        for (int i = 0; i < 2; ++i) {
            h[0][i] += p * gA[0][i];
            h[1][i] += p * gA[1][i];
        }
    }
    if (energy)
        *energy += weight * D * stored(material, part, c, G, moved);
}

INLINE void scatter(const int32_t *node, int nodes, int lanes, vec force[][2], double *f)
{
    for (int a = 0; a < nodes; ++a)
        for (int l = 0; l < lanes; ++l)
            for (int i = 0; i < 2; ++i)
                f[2 * (int64_t)node[a * LANES + l] + i] += force[a][i][l];
}

INLINE void quadrilateral(enum material material, int reduced, const double *c, const vec E[3][2],
                          const vec e[3][2], const vec move[3][2], vec force[4][2], vec *energy,
                          ivec *bad)
{
    const double low = 0.21132486540518713, gauss[2] = {low, 1.0 - low};
    vec along[2] = {}, along_eta[2] = {}, up[2] = {}, up_xi[2] = {}, G[2][2], g[2][2], d[2][2], h[2][2];
    for (int point = 0; point < 4; ++point) {
        double xi = gauss[point & 1], eta = gauss[point >> 1];
        columns(E, xi, eta, G);
        columns(e, xi, eta, g);
        columns(move, xi, eta, d);
        at_point(material, reduced ? DISTORTION : WHOLE, c, 0.25, G, g, d, h, energy, bad);
        for (int i = 0; i < 2; ++i) {
            along[i] += h[0][i];
            along_eta[i] += eta * h[0][i];
            up[i] += h[1][i];
            up_xi[i] += xi * h[1][i];
        }
    }
    if (reduced) {
        columns(E, 0.5, 0.5, G);
        columns(e, 0.5, 0.5, g);
        columns(move, 0.5, 0.5, d);
        at_point(material, VOLUME, c, 1.0, G, g, d, h, energy, bad);
        for (int i = 0; i < 2; ++i) {
            along[i] += h[0][i];
            along_eta[i] += 0.5 * h[0][i];
            up[i] += h[1][i];
            up_xi[i] += 0.5 * h[1][i];
        }
    }
    for (int i = 0; i < 2; ++i) {
        force[0][i] = (along_eta[i] - along[i]) + (up_xi[i] - up[i]);
        force[1][i] = (along[i] - along_eta[i]) - up_xi[i];
        force[2][i] = (up[i] - up_xi[i]) - along_eta[i];
        force[3][i] = along_eta[i] + up_xi[i];
    }
}

INLINE void triangle(enum material material, const double *c, const vec E[3][2], const vec e[3][2],
                     const vec move[3][2], vec force[4][2], vec *energy, ivec *bad)
{
    vec h[2][2];
    at_point(material, WHOLE, c, 0.5, E, e, move, h, energy, bad);
    for (int i = 0; i < 2; ++i) {
        force[0][i] = -h[0][i] - h[1][i];
        force[1][i] = h[0][i];
        force[2][i] = h[1][i];
    }
}

/* All cells of one body. `node` (blocks, 4, LANES), `edge` (blocks, 3, 2, LANES); the last block
 * repeats its last cell where there are fewer than LANES, and counts `lanes_of_last`. Forces are
 * added to `f`, the energy is returned in `total` unless that is null. Returns whether a cell is
 * turned inside out. */
INLINE int over_cells(enum material material, int triangles, int reduced, const double *c,
                      int64_t blocks, int lanes_of_last, const int32_t *node, const double *edge,
                      const double *u, double *f, double *total)
{
    ivec bad = {};
    double sum = 0.0;
    for (int64_t b = 0; b < blocks; ++b, node += 4 * LANES, edge += 6 * LANES) {
        const int lanes = b + 1 < blocks ? LANES : lanes_of_last;
        vec E[3][2], e[3][2], move[3][2], force[4][2], energy = {};
        differences(u, node, move);
        __builtin_memcpy(E, edge, sizeof E);
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 2; ++i)
                e[k][i] = E[k][i] + move[k][i];
        if (triangles)
            triangle(material, c, E, e, move, force, total ? &energy : 0, &bad);
        else
            quadrilateral(material, reduced, c, E, e, move, force, total ? &energy : 0, &bad);
        if (f && lanes == LANES)
            scatter(node, triangles ? 3 : 4, LANES, force, f);
        else if (f)
            scatter(node, triangles ? 3 : 4, lanes, force, f);
        if (total)
            for (int l = 0; l < lanes; ++l)
                sum += energy[l];
    }
    if (total)
        *total = sum;
    return any(bad);
}

/* One instance of the loop for each material and kind of cell, with and without energy. */
#define LOOP(material, triangles, reduced)                                                         \
    return over_cells(material, triangles, reduced, c, blocks, lanes_of_last, node, edge, u,       \
                      FORCE, TOTAL)

/* Adds the forces to `result`; kind: 0 quadrilaterals, 1 quadrilaterals with the volumetric part at
 * the centre, 2 triangles. */
EXPORT int tribox_plane_forces(int material, int kind, const double *c, int64_t blocks,
                               int lanes_of_last, const int32_t *node, const double *edge,
                               const double *u, double *result)
{
#define FORCE result
#define TOTAL 0
    LOOPS
#undef FORCE
#undef TOTAL
}

/* Puts the strain energy into `result`. */
EXPORT int tribox_plane_energy(int material, int kind, const double *c, int64_t blocks,
                               int lanes_of_last, const int32_t *node, const double *edge,
                               const double *u, double *result)
{
#define FORCE 0
#define TOTAL result
    LOOPS
}
