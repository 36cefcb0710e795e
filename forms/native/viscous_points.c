/* Material points of Maxwell branches at finite strain, several at a time.
 *
 * The equations are in forms/bodies/viscous_points.py. Tensors that are
 * symmetric are computed in their upper half, and m^(-1/3) gives 1/m too.
 */

#include "point_lanes.h"

static const double ROUNDOFF = 1e-14; /* of G/2: less is no stored energy but what rounding leaves of 3 - 3 */

typedef struct {
    int64_t branches;
    const double *modulus, *share, *rest; /* of each: G, t = dt/(tau + dt) and 1 - t */
    const double *ratio;                  /* the smaller of t and 1 - t over the larger */
} Branches;

/* tr (dev A dev A) of A = B K, not negative: A is similar to a symmetric tensor. */
INLINE vec distance(int space, const tensor B, const tensor K)
{
    vec sum;
    if (space) {
        tensor A;
        multiply(1, B, K, A);
        vec one = A[0][0] - A[1][1], two = A[1][1] - A[2][2], three = A[2][2] - A[0][0];
        sum = (1.0 / 3.0) * (one * one + two * two + three * three) +
              2.0 * (A[0][1] * A[1][0] + A[1][2] * A[2][1] + A[2][0] * A[0][2]);
    } else {
        vec one = B[0][0] * K[0][0], two = B[1][1] * K[1][1], three = B[0][1] * K[0][1];
        vec across = 2.0 * (B[2][2] * K[2][2] - three) - (one + two), turn = one - two;
        vec shear = B[0][0] * K[0][1] + B[0][1] * K[1][1];
        sum = 0.5 * turn * turn + (1.0 / 6.0) * across * across +
              2.0 * shear * (B[0][1] * K[0][0] + B[1][1] * K[0][1]);
    }
    return choose((ivec)(sum < 0.0), all(0.0), sum);
}

/* A point: the columns of F, in the plane of its part there, whose J it has, and the stretch across. */
typedef struct {
    const vec *g;
    vec J, hoop;
} Place;

/* What a point has of its deformation alone: F, H = F^-T, C = F^T F and J^(-2/3). */
typedef struct {
    tensor F, H, C;
    vec j;
    ivec good;
} Deformation;

/* The root of the volume's ratio. */
INLINE vec root_of(vec J, ivec *good)
{
    *good = (ivec)(J > 0.0) & is_finite(J);
    return inverse_cube_root_of_ratio(choose(*good, J, all(1.0)));
}

INLINE void deformation(int space, const Place *place, Deformation *at)
{
    const int dim = space ? 3 : 2;
    const vec *g = place->g;
    for (int x = 0; x < dim; ++x)
        for (int i = 0; i < dim; ++i)
            at->F[i][x] = g[dim * x + i];
    if (space) {
        for (int i = 0; i < 3; ++i)
            cross(at->F[(i + 1) % 3], at->F[(i + 2) % 3], at->H[i]);
    } else {
        at->F[2][2] = place->hoop;
        at->H[0][0] = g[3] * place->hoop;
        at->H[0][1] = -g[1] * place->hoop;
        at->H[1][0] = -g[2] * place->hoop;
        at->H[1][1] = g[0] * place->hoop;
        at->H[2][2] = place->J;
    }
    const vec J = space ? place->J : place->J * place->hoop, root = root_of(J, &at->good), scale = 1.0 / J;
    at->j = root * root;
    EACH(space, i, j) at->H[i][j] *= scale; /* not by root^3, which takes longer to come */
    UPPER(space, i, j)
    {
        at->C[i][j] = all(0.0);
        for (int k = 0; k < 3; ++k)
            if (COUPLED(space, k, i))
                at->C[i][j] += at->F[k][i] * at->F[k][j];
    }
    mirror(space, at->C);
}

/* What the branches add up: sum of g N and of g n/3. */
typedef struct {
    tensor N;
    vec pressure;
} Sum;

/* One branch: from C_n to C_k, both as in the state, with what it stores and what it dissipates by
 * the rate at the end, where there is a place for them. */
INLINE void branch(int space, double G, double t, double s, double ratio, const Deformation *at,
                   const vec *from, vec *to, vec *energies, Sum *sum)
{
    tensor old, M, K;
    vec share = t * at->j;
    symmetric_of(space, from, old);
    UPPER(space, i, j) M[i][j] = s * old[i][j] + share * at->C[i][j];
    mirror(space, M);
    vec m = cofactors(space, M, K), root = inverse_cube_root_of_ratio(m), square = root * root, part = square * at->j;
    vec along[3], apart = all(0.0);
    UPPER(space, i, j)
    {
        if (i == j)
            along[i] = K[i][i] * at->C[i][i];
        else
            apart += 2.0 * (K[i][j] * at->C[i][j]);
    }
    /* a third of K:C, exactly K where both are isotropic */
    vec mean = along[0] + (1.0 / 3.0) * ((along[1] - along[0]) + (along[2] - along[0]) + apart);
    vec g = G * part; /* of K as m^(-2/3), so that N = K/m is not needed */
    UPPER(space, i, j) sum->N[i][j] += g * K[i][j];
    sum->pressure += g * mean;
    if (energies) {
        const int late = t < 0.5;
        for (int k = 0; k < (space ? 6 : 4); ++k)
            to[k] = root * M[PAIRS[k][0]][PAIRS[k][1]];
        vec excess = 3.0 * (part * mean - 1.0), by = late ? part : square;
        energies[0] = 0.5 * G * choose((ivec)(excess < ROUNDOFF), all(0.0), excess);
        energies[1] = (0.5 * ratio * G) * (by * by) * distance(space, late ? at->C : old, K);
    }
}

/* Adds what a branch gives to S, Z, p and c of viscous_points.py, and its dyads to the upper half of c. */
INLINE void add_branch(enum section section, double G, double t, double s, vec J2, vec j, const tensor H,
                       const vec *from, tensor S_sum, tensor Z, vec *p_sum, vec *both, vec *c)
{
    const int space = section == SPACE, n = space ? 6 : 4;
    tensor C, half, W, S;
    symmetric_of(space, from, C);
    multiply(space, H, C, half);
    UPPER(space, i, k)
    {
        vec sum = all(0.0);
#pragma GCC unroll 9
        for (int l = 0; l < 3; ++l)
            if (COUPLED(space, k, l))
                sum += half[i][l] * H[k][l];
        W[i][k] = s * sum;
    }
#pragma GCC unroll 9
    for (int i = 0; i < 3; ++i)
        W[i][i] += t * j;
    mirror(space, W);
    vec m = J2 * cofactors(space, W, S), root = inverse_cube_root_of_ratio(m);
    vec size = (G * j) * J2 * (root * root), e = (t / G) * root, p, r = all(0.0);
    UPPER(space, i, k) S[i][k] *= size;
    mirror(space, S);
    p = trace(S);
    *p_sum += p;
    const vec twice = (2.0 / 3.0) * e, first = (-1.0 / 3.0) * twice * p;
    UPPER(space, i, k)
    {
        vec square = all(0.0);
#pragma GCC unroll 9
        for (int l = 0; l < 3; ++l)
            if (COUPLED(space, k, l) && COUPLED(space, i, l))
                square += S[i][l] * S[l][k];
        if (i == k)
            r += square;
        Z[i][k] += first * S[i][k] + twice * square;
        S_sum[i][k] += S[i][k];
    }
    *both += e * ((2.0 / 27.0) * p * p - (2.0 / 9.0) * r);
#pragma GCC unroll 9
    for (int a = 0; a < n; ++a) {
        const int i = PAIRS[a][0], k = PAIRS[a][1];
        if (!counts(section, a))
            continue;
        const vec by = twice * S[i][k];
#pragma GCC unroll 9
        for (int b = a; b < n; ++b) {
            const int l = PAIRS[b][0], o = PAIRS[b][1];
            if (!counts(section, b))
                continue;
            vec sum = by * S[l][o];
            if (COUPLED(space, i, l) && COUPLED(space, k, o))
                sum -= e * (S[i][l] * S[k][o]);
            if (COUPLED(space, i, o) && COUPLED(space, k, l))
                sum -= e * (S[i][o] * S[k][l]);
            c[n * a + b] += sum;
        }
    }
}

/* Moduli, see MODULI of point_lanes.h; returns which points can be evaluated. */
INLINE ivec by_place(enum section section, const Branches *w, const Deformation *at, vec J, const vec *state,
                     vec *moduli)
{
    const int space = section == SPACE, n = space ? 6 : 4;
    vec *c = tangent_of(space, moduli), p = all(0.0), both = p, ok = p;
    tensor S, Z;
    EACH(space, i, k) S[i][k] = Z[i][k] = all(0.0);
#pragma GCC unroll 36
    for (int k = 0; k < n * n; ++k)
        c[k] = all(0.0);
#pragma GCC unroll 1
    for (int b = 0; b < w->branches; ++b)
        add_branch(section, w->modulus[b], w->share[b], w->rest[b], J * J, at->j, at->H, state + n * b, S, Z, &p,
                   &both, c);
    both += (2.0 / 9.0) * p;
#pragma GCC unroll 9
    for (int a = 0; a < n; ++a) {
        const int i = PAIRS[a][0], k = PAIRS[a][1];
        moduli[a] = a < 3 ? S[i][k] - (1.0 / 3.0) * p : S[i][k];
        ok += moduli[a] - moduli[a];
        Z[i][k] -= (2.0 / 3.0) * S[i][k];
        c[(n + 1) * a] += (a < 3 ? 2.0 / 3.0 : 1.0 / 3.0) * p;
    }
#pragma GCC unroll 9
    for (int a = 0; a < 3; ++a)
#pragma GCC unroll 9
        for (int b = a; b < n; ++b)
            c[n * a + b] += b < 3 ? Z[a][a] + Z[b][b] + both : Z[PAIRS[b][0]][PAIRS[b][1]];
    return at->good & is_finite(ok);
}

/* See Update of point_lanes.h; the state is the C of all branches, what each has dissipated, and
 * what each stores. */
INLINE void update(enum section section, const Branches *w, const vec *F, const vec *state, vec *P,
                   vec *end, vec *moduli, vec *energies, ivec *good)
{
    const int space = section == SPACE, count = space ? 9 : 5, size = space ? 6 : 4, dim = space ? 3 : 2;
    const int branches = (int)w->branches, lost = size * branches, kept = lost + branches;
    const int width = kept + branches;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    Sum sum;
    Deformation at;
    tensor FN;
    vec ok = all(0.0), g[9];
    for (int p = 0; p < dim * dim; ++p)
        g[dim * (p % dim) + p / dim] = F[p];
    Place here = {g, space ? all(0.0) : g[0] * g[3] - g[1] * g[2], F[4]};
    if (space) {
        vec normal[3];
        cross(g + 3, g + 6, normal);
        here.J = dot(g, normal);
    }
    deformation(space, &here, &at);
    if (moduli) {
        *good = by_place(section, w, &at, space ? here.J : here.J * here.hoop, state, moduli);
        return;
    }
    EACH(space, i, j) sum.N[i][j] = all(0.0);
    sum.pressure = all(0.0);
    for (int k = 0; energies && k < ENERGIES; ++k)
        energies[k] = all(0.0);
#pragma GCC unroll 1
    for (int b = 0; b < branches; ++b) {
        const double ratio = w->ratio[b];
        const int late = w->share[b] < 0.5;
        vec energy[2];
        branch(space, w->modulus[b], w->share[b], w->rest[b], ratio, &at, state + size * b,
               end ? end + size * b : 0, energies ? energy : 0, &sum);
        if (!energies)
            continue;
        vec by = late ? 0.5 * ratio * energy[1] : all(1.0);
        vec fallen = square_root(by * state[kept + b]) - square_root(by * energy[0]);
        if (!late)
            fallen *= choose((ivec)(fallen > 0.0), fallen, all(0.0));
        energy[1] += fallen;
        energy[1] = choose((ivec)(energy[1] < 0.0), all(0.0), energy[1]);
        end[lost + b] = state[lost + b] + energy[1];
        end[kept + b] = energy[0];
        energies[0] += energy[0];
        energies[1] += energy[1];
        ok += end[lost + b] - end[lost + b];
    }
    mirror(space, sum.N);
    multiply(space, at.F, sum.N, FN);
    for (int p = 0; p < count; ++p) {
        const int i = place[p][0], J = place[p][1];
        P[p] = FN[i][J] - sum.pressure * at.H[i][J];
    }
    for (int p = 0; p < count; ++p)
        ok += P[p] - P[p];
    if (energies) /* with these and P all of a branch is finite */
        ok += energies[0] - energies[0];
    *good = at.good & is_finite(ok);
    const int spoiled = energies && any(~*good);
    for (int k = 0; spoiled && k < width; ++k)
        end[k] = choose(*good, end[k], state[k]);
}

KERNEL(viscous_strain, STRAIN, update)
KERNEL(viscous_ring, RING, update)
KERNEL(viscous_space, SPACE, update)
