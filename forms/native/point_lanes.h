/* What the kernels of material points have in common: components, tensors, and how the loops of
 * point_cells.c call them. */

#include "lanes.h"

/* What a kind of points does with LANES of them: F (p) and the state at the begin (s) to P (p), the
 * state at the end (s) and energies (ENERGIES), of which `end` and `energies` may be null together;
 * or, where `moduli` is not null, to these alone, see MODULI. Then
 * `end` is read where it is not null, what an update has led to, so that it need not be found anew.
 * `good` marks the points that could be evaluated; of the others the state is that of the begin,
 * and the rest is anything. */
typedef void Update(const void *material, const vec *F, const vec *state, vec *P, vec *end, vec *moduli,
                    vec *energies, ivec *good);

enum { ENERGIES = 3 }; /* stored; dissipated in the step; the part of it that is due to its length */
enum section { STRAIN, RING, SPACE };

/* Components (i, J) of P in the plane, and of those in space. */
static const int IN_PLANE[5][2] = {{0, 0}, {0, 1}, {1, 0}, {1, 1}, {2, 2}};
static const int IN_SPACE[9][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 0}, {1, 1},
                                   {1, 2}, {2, 0}, {2, 1}, {2, 2}};
/* Those of symmetric tensors, 4 in the plane, and their numbers. */
static const int PAIRS[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {0, 2}};
static const int NUMBER[3][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}};

/* Moduli of a point, by these components (n): Kirchhoff's stress tau, and c (n, n) row by row, of
 * which kernels that are symmetric give the upper half, in
 *
 *     dP_iJ/dF_kL = (c_ijkl + delta_ik tau_jl) F^-1_Jj F^-1_Ll;
 *
 * in plane strain, where the stretch across does not change, rows and columns of 33 are not read. */
enum { MODULI = 6 + 36 };
INLINE vec *tangent_of(int space, vec *moduli)
{
    return moduli + (space ? 6 : 4);
}

/* Whether the row or column of a component counts. */
INLINE int counts(enum section section, int component)
{
    return section != STRAIN || component != 2;
}

/* -- tensors, of which the plane's have four components in it and one across, coupled by nothing -- */

typedef vec tensor[3][3];
#define COUPLED(space, a, b) ((space) || ((a) == 2) == ((b) == 2))
#define EACH(space, a, b)                                                                          \
    _Pragma("GCC unroll 3") for (int a = 0; a < 3; ++a)                                            \
        _Pragma("GCC unroll 3") for (int b = 0; b < 3; ++b)                                        \
            if (COUPLED(space, a, b))

INLINE void cross(const vec *a, const vec *b, vec *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

INLINE vec dot(const vec *a, const vec *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

INLINE vec trace(const tensor a)
{
    return a[0][0] + a[1][1] + a[2][2];
}

/* c = a b. */
INLINE void multiply(int space, const tensor a, const tensor b, tensor c)
{
    EACH(space, i, j)
    {
        if (!space && i == 2)
            c[i][j] = a[2][2] * b[2][2];
        else if (!space)
            c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j];
        else
            c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
    }
}

/* Upper half of a symmetric tensor, and the lower one from it. */
#define UPPER(space, a, b)                                                                         \
    _Pragma("GCC unroll 3") for (int a = 0; a < 3; ++a)                                            \
        _Pragma("GCC unroll 3") for (int b = a; b < 3; ++b)                                        \
            if (COUPLED(space, a, b))

INLINE void mirror(int space, tensor a)
{
    UPPER(space, i, j) a[j][i] = a[i][j];
}

/* All of a symmetric tensor of whose lower half nothing is known. */
INLINE void whole_of(int space, const tensor upper, tensor a)
{
    UPPER(space, i, j) a[i][j] = a[j][i] = upper[i][j];
}

/* The sum of a_ab b_ab of symmetric tensors, from their upper halves. */
INLINE vec contract(int space, const tensor a, const tensor b)
{
    vec row[2] = {a[0][0] * b[0][0] + a[1][1] * b[1][1], a[0][1] * b[0][1]}; /* side by side */
    if (space) {
        row[0] += a[0][2] * b[0][2] * 2.0;
        row[1] += a[1][2] * b[1][2];
    }
    return row[0] + (a[2][2] * b[2][2] + 2.0 * row[1]);
}

/* b a b^T of a symmetric tensor a. */
INLINE void sandwich(int space, const tensor b, const tensor a, tensor to)
{
    tensor half;
    multiply(space, b, a, half);
    UPPER(space, i, j)
    {
        to[i][j] = all(0.0);
        for (int k = 0; k < 3; ++k)
            if (COUPLED(space, k, i))
                to[i][j] += half[i][k] * b[j][k];
    }
    mirror(space, to);
}

/* Cofactors of a symmetric tensor; returns its determinant. */
INLINE vec cofactors(int space, const tensor a, tensor cof)
{
    if (!space) {
        cof[0][0] = a[1][1] * a[2][2];
        cof[1][1] = a[0][0] * a[2][2];
        cof[0][1] = cof[1][0] = -a[0][1] * a[2][2];
        cof[2][2] = a[0][0] * a[1][1] - a[0][1] * a[0][1];
        return cof[2][2] * a[2][2];
    }
    UPPER(1, i, j)
    {
        const int p = (i + 1) % 3, q = (i + 2) % 3, r = (j + 1) % 3, s = (j + 2) % 3;
        cof[i][j] = a[p][r] * a[q][s] - a[p][s] * a[q][r];
    }
    mirror(1, cof);
    return dot(a[0], cof[0]);
}

/* The tensor of components that stand as in the state. */
INLINE void symmetric_of(int space, const vec *from, tensor a)
{
    for (int k = 0; k < (space ? 6 : 4); ++k)
        a[PAIRS[k][0]][PAIRS[k][1]] = a[PAIRS[k][1]][PAIRS[k][0]] = from[k];
}

/* Adds zero to `sum`, or what is not a number where one of `values` is not finite. */
INLINE void probe(const vec *values, int count, vec *sum)
{
    vec part[4] = {}; /* side by side: each waits for the one before it */
#pragma GCC unroll 8
    for (int k = 0; k < count; ++k)
        part[k % 4] += values[k] - values[k];
    *sum += (part[0] + part[1]) + (part[2] + part[3]);
}

/* A kernel: an update of points, see Update, in a kind of section. */
#define KERNEL(name, section, update)                                                              \
    EXPORT void tribox_##name(const void *material, const vec *F, const vec *state, vec *P,        \
                              vec *end, vec *moduli, vec *energies, ivec *good)                    \
    {                                                                                              \
        update(section, material, F, state, P, end, moduli, energies, good);                       \
    }
