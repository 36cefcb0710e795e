/* Internal forces and strain energy of plane-strain bodies, eight cells at a time.
 *
 * In parent coordinates xi the deformation gradient is F = g G^-1, with the columns of g and G the
 * derivatives of the current and of the reference position. The energies are functions of
 * I = |F|^2 and J = det F alone, so that the first Piola stress is P = p F + q cof F with
 * p = 2 dW/dI and q = dW/dJ. As cof F cof G = cof g, the nodal forces are
 *
 *     f_a = sum over points of w (p g A + q cof g) dN_a/dxi,   A = det G G^-1 G^-T,
 *
 * which takes one division per point, and one logarithm where the energy has one.
 *
 * A cell is stored by the differences of its nodes' reference positions, the displacements are
 * gathered: strains far below the spacing of the coordinates' own round-off are not lost.
 */

#include "lanes.h"

enum material { NEO_HOOKEAN, MOONEY_RIVLIN, HENCKY };
enum part { WHOLE, DISTORTION, VOLUME };

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

/* p = 2 dW/dI, q = dW/dJ and W of a part of the energy, with I = |F|^2 in the plane; `r` is 1/J. */
INLINE void derive(enum material material, enum part part, const double *c, vec I, vec J, vec r,
                   vec *p, vec *q, vec *w)
{
    const int d = part != VOLUME, v = part != DISTORTION;
    if (material == NEO_HOOKEAN) { /* c: G, Lambda */
        vec l = v || w ? logarithm(J) : all(0.0);
        *p = all(d ? c[0] : 0.0);
        *q = ((v ? c[1] * l : all(0.0)) - (d ? c[0] : 0.0)) * r;
        if (w)
            *w = (d ? c[0] * (0.5 * (I - 2.0) - l) : all(0.0)) + (v ? 0.5 * c[1] * l * l : all(0.0));
    } else if (material == MOONEY_RIVLIN) { /* c: C10, C01, K */
        *p = *q = all(0.0);
        if (w)
            *w = all(0.0);
        if (d) {
            vec y = inverse_cube_root(J), j = y * y, a = c[0] * j, b = c[1] * j * j;
            vec I1 = I + 1.0, I2 = I + J * J;
            *p = 2.0 * (a + b);
            *q = 2.0 * b * J - (2.0 / 3.0) * r * (a * I1 + 2.0 * b * I2);
            if (w)
                *w = a * I1 - 3.0 * c[0] + b * I2 - 3.0 * c[1];
        }
        if (v) {
            *q += 0.5 * c[2] * (J - r);
            if (w)
                *w += 0.25 * c[2] * (J * J - 1.0 - 2.0 * logarithm(J));
        }
    } else { /* c: G, K */
        vec l = logarithm(J);
        double k = (d ? c[0] / 3.0 : 0.0) + (v ? c[1] : 0.0);
        *p = all(0.0);
        *q = k * l;
        if (w)
            *w = 0.5 * k * l * l;
        if (d) {
            vec value, slope, y = 0.5 * I * r;
            squared_arcosh(y - 1.0, &value, &slope);
            *p = (0.5 * c[0]) * slope * r;
            *q -= (0.5 * c[0]) * slope * y;
            if (w)
                *w += (0.5 * c[0]) * value;
        }
        *q *= r;
    }
}

/* A point of a cell: from the columns of G and g to h = p g A + q cof g (columns), times the weight;
 * the energy is added to `energy`. Cells with J <= 0 are marked in `bad`. */
INLINE void at_point(enum material material, enum part part, const double *c, double weight,
                     const vec G[2][2], const vec g[2][2], vec h[2][2], vec *energy, ivec *bad)
{
    vec D = G[0][0] * G[1][1] - G[0][1] * G[1][0];
    vec d = g[0][0] * g[1][1] - g[0][1] * g[1][0];
    vec inverse = 1.0 / (D * d), of_D = d * inverse, J = d * of_D, r = D * D * inverse;
    vec p, q, w = all(0.0), I = all(0.0), gA[2][2];
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
    *bad |= ~(ivec)(J > 0.0);
    derive(material, part, c, I, J, r, &p, &q, energy ? &w : 0);
    q *= weight;
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
        *energy += weight * D * w;
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

INLINE void scatter(const int32_t *node, int nodes, int lanes, vec force[][2], double *f)
{
    for (int a = 0; a < nodes; ++a)
        for (int l = 0; l < lanes; ++l)
            for (int i = 0; i < 2; ++i)
                f[2 * (int64_t)node[a * LANES + l] + i] += force[a][i][l];
}

/* The columns of G or g at (xi, eta) from the differences. */
INLINE void columns(const vec e[3][2], double xi, double eta, vec g[2][2])
{
    for (int i = 0; i < 2; ++i) {
        g[0][i] = e[0][i] + eta * e[2][i];
        g[1][i] = e[1][i] + xi * e[2][i];
    }
}

INLINE void quadrilateral(enum material material, int reduced, const double *c, const vec E[3][2],
                          const vec e[3][2], vec force[4][2], vec *energy, ivec *bad)
{
    const double low = 0.21132486540518713, gauss[2] = {low, 1.0 - low};
    vec along[2] = {}, along_eta[2] = {}, up[2] = {}, up_xi[2] = {}, G[2][2], g[2][2], h[2][2];
    for (int point = 0; point < 4; ++point) {
        double xi = gauss[point & 1], eta = gauss[point >> 1];
        columns(E, xi, eta, G);
        columns(e, xi, eta, g);
        at_point(material, reduced ? DISTORTION : WHOLE, c, 0.25, G, g, h, energy, bad);
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
        at_point(material, VOLUME, c, 1.0, G, g, h, energy, bad);
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
                     vec force[4][2], vec *energy, ivec *bad)
{
    vec h[2][2];
    at_point(material, WHOLE, c, 0.5, E, e, h, energy, bad);
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
        vec E[3][2], e[3][2], force[4][2], energy = {};
        differences(u, node, e);
        __builtin_memcpy(E, edge, sizeof E);
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 2; ++i)
                e[k][i] += E[k][i];
        if (triangles)
            triangle(material, c, E, e, force, total ? &energy : 0, &bad);
        else
            quadrilateral(material, reduced, c, E, e, force, total ? &energy : 0, &bad);
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
