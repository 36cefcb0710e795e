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

/* What a point has of its deformation alone: F, its cofactors J F^-T, C = F^T F, J and J^(-2/3). */
typedef struct {
    tensor F, H, C;
    vec J, j;
    ivec good;
} Deformation;

INLINE void deformation(int space, const vec *F, Deformation *at)
{
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    for (int p = 0; p < (space ? 9 : 5); ++p)
        at->F[place[p][0]][place[p][1]] = F[p];
    if (space) {
        for (int i = 0; i < 3; ++i)
            cross(at->F[(i + 1) % 3], at->F[(i + 2) % 3], at->H[i]);
        at->J = dot(at->F[0], at->H[0]);
    } else {
        at->H[0][0] = F[3] * F[4];
        at->H[0][1] = -F[2] * F[4];
        at->H[1][0] = -F[1] * F[4];
        at->H[1][1] = F[0] * F[4];
        at->H[2][2] = F[0] * F[3] - F[1] * F[2];
        at->J = at->H[2][2] * F[4];
    }
    at->good = (ivec)(at->J > 0.0) & is_finite(at->J);
    const vec root = inverse_cube_root_of_ratio(choose(at->good, at->J, all(1.0)));
    at->j = root * root;
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

/* A branch at the end: M, m N and m^(-1/3). */
typedef struct {
    tensor M, K;
    vec root;
} Moved;

INLINE void move(int space, double t, double s, const Deformation *at, const vec *from, Moved *b)
{
    tensor old;
    vec share = t * at->j;
    symmetric_of(space, from, old);
    UPPER(space, i, j) b->M[i][j] = s * old[i][j] + share * at->C[i][j];
    mirror(space, b->M);
    b->root = inverse_cube_root_of_ratio(cofactors(space, b->M, b->K));
}

/* One branch: from C_n to C_k, both as in the state, with what it stores and what it dissipates by
 * the rate at the end, where there is a place for them. */
INLINE void branch(int space, double G, double t, double ratio, const Deformation *at, const Moved *b,
                   const vec *from, vec *to, vec *energies, Sum *sum)
{
    const vec(*K)[3] = b->K, root = b->root, square = root * root, part = square * at->j;
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
            to[k] = root * b->M[PAIRS[k][0]][PAIRS[k][1]];
        vec excess = 3.0 * (part * mean - 1.0), by = late ? part : square;
        energies[0] = 0.5 * G * choose((ivec)(excess < ROUNDOFF), all(0.0), excess);
        tensor old;
        symmetric_of(space, from, old);
        energies[1] = (0.5 * ratio * G) * (by * by) * distance(space, late ? at->C : old, K);
    }
}

/* Adds what a branch gives to S, Z, p and c of viscous_points.py, and its dyads to the upper half of c. In
 * the plane S^2 there is x S - y 1, x = tr S and y = det S of that part, and the dyads of S_ik S_jl are those
 * of S_ij S_kl but for y. */
INLINE void add_branch(enum section section, double G, double t, const Deformation *at, const Moved *b,
                       tensor S_sum, tensor Z, vec *p_sum, vec *both, vec *c)
{
    const int space = section == SPACE, n = space ? 6 : 4;
    const vec size = G * at->j * b->root * b->root, e = (t / G) * b->root;
    tensor S;
    sandwich(space, at->F, b->K, S);
    EACH(space, i, k) S[i][k] *= size;
    const vec p = trace(S);
    const vec twice = (2.0 / 3.0) * e, first = (-1.0 / 3.0) * twice * p;
    const vec x = S[0][0] + S[1][1], y = S[0][0] * S[1][1] - S[0][1] * S[0][1];
    vec r = x * x - 2.0 * y + S[2][2] * S[2][2];
    *p_sum += p;
    if (space)
        r = all(0.0);
    UPPER(space, i, k)
    {
        vec square = all(0.0);
#pragma GCC unroll 9
        for (int l = 0; space && l < 3; ++l)
            square += S[i][l] * S[l][k];
        if (space && i == k)
            r += square;
        if (space)
            Z[i][k] += first * S[i][k] + twice * square;
        else
            Z[i][k] += (first + twice * (i == 2 ? S[2][2] : x)) * S[i][k] - (i == k && i < 2 ? twice * y : all(0.0));
        S_sum[i][k] += S[i][k];
    }
    *both += e * ((2.0 / 27.0) * p * p - (2.0 / 9.0) * r);
    if (!space) {
        c[1] += 2.0 * e * y;
        c[n * 3 + 3] -= e * y;
    }
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
            if (space)
                sum -= e * (S[i][l] * S[k][o] + S[i][o] * S[k][l]);
            else if ((a == 2) == (b == 2))
                sum *= -2.0;
            c[n * a + b] += sum;
        }
    }
}

/* Moduli, see MODULI of point_lanes.h; returns which points can be evaluated. */
INLINE ivec by_place(enum section section, const Branches *w, const Deformation *at, const Moved *moved, vec *moduli)
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
        add_branch(section, w->modulus[b], w->share[b], at, moved + b, S, Z, &p, &both, c);
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
    const int space = section == SPACE, count = space ? 9 : 5, size = space ? 6 : 4;
    const int branches = (int)w->branches, lost = size * branches, kept = lost + branches;
    const int width = kept + branches;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    Sum sum;
    Deformation at;
    Moved moved[branches];
    tensor FN;
    vec ok = all(0.0);
    deformation(space, F, &at);
#pragma GCC unroll 1
    for (int b = 0; b < branches; ++b) /* none waits for another one's root */
        move(space, w->share[b], w->rest[b], &at, state + size * b, moved + b);
    if (moduli) {
        *good = by_place(section, w, &at, moved, moduli);
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
        branch(space, w->modulus[b], w->share[b], ratio, &at, moved + b, state + size * b,
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
    sum.pressure *= 1.0 / at.J;
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
