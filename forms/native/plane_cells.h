/* What the loops over plane-strain cells have in common: energies, and how cells are stored.
 *
 * In parent coordinates xi the deformation gradient is F = g G^-1, with the columns of g and G the
 * derivatives of the current and of the reference position. The energies are functions of
 * I = |F|^2 and J = det F alone.
 *
 * Nodes stand in DOLFINx's order, whichever way that goes round the cell.
 *
 * A cell is stored by the differences of its nodes' reference positions, the displacements are
 * gathered: strains far below the spacing of the coordinates' own round-off are not lost.
 */

#include "lanes.h"

/* VOLUMETRIC: the volumetric part of HENCKY, at the centre, beside points that remember. */
enum material { NEO_HOOKEAN, MOONEY_RIVLIN, HENCKY, VOLUMETRIC };
enum part { WHOLE, DISTORTION, VOLUME };

/* Whether the stress of a part of the energy takes a logarithm or a root of J. */
INLINE int needs_volume(enum material material, enum part part)
{
    return material == NEO_HOOKEAN     ? part != DISTORTION
           : material == MOONEY_RIVLIN ? part != VOLUME
                                       : 1;
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

/* Adds blocks (a, b) as those of Beside. */
INLINE void add_blocks(int nodes, int symmetric, vec (*block)[2][2], vec matrix[4][2][4][2])
{
    for (int b = 0; b < nodes; ++b)
        for (int a = 0; a < (symmetric ? b + 1 : nodes); ++a, ++block)
            for (int i = 0; i < 2; ++i)
                for (int j = 0; j < 2; ++j) {
                    vec value = (*block)[i][j];
                    matrix[a][i][b][j] += value;
                    if (symmetric && a < b)
                        matrix[b][j][a][i] += value;
                }
}

/* Adds the matrices of points that remember, if there are any. */
static __attribute__((noinline)) void add_beside(const Beside *beside, int64_t block, int nodes,
                                                 vec matrix[4][2][4][2])
{
    vec part[16][2][2];
    __builtin_memset(part, 0, (beside->symmetric ? 10 : 16) * sizeof part[0]);
    beside->add(beside->cells, block, &part[0][0][0]);
    if (beside->symmetric && nodes == 4) /* each with loops of its own */
        add_blocks(4, 1, part, matrix);
    else if (nodes == 4)
        add_blocks(4, 0, part, matrix);
    else
        add_blocks(3, (int)beside->symmetric, part, matrix);
}

/* Adds the matrices of a block's cells to `values`: those of the row (a, i) and the node b of a
 * cell from start (a, i, b) on. Returns the starts of the next block. */
INLINE const int32_t *scatter_matrix(const int32_t *start, int nodes, int lanes,
                                     vec matrix[4][2][4][2], double *values)
{
    for (int l = 0; l < lanes; ++l)
        for (int a = 0; a < nodes; ++a)
            for (int i = 0; i < 2; ++i)
                for (int b = 0; b < nodes; ++b) {
                    double *at = values + *start++;
                    at[0] += matrix[a][i][b][0][l];
                    at[1] += matrix[a][i][b][1][l];
                }
    return start;
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
    case 8: LOOP(HENCKY, 1, 0);                                                                    \
    default: LOOP(VOLUMETRIC, 0, 1);                                                               \
    }
