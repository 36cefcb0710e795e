/* Material points of Maxwell branches at finite strain, eight at a time.
 *
 * The equations are in forms/bodies/viscous_points.py. Tensors that are
 * symmetric are computed in their upper half, and m^(-1/3) gives 1/m too.
 */

#include "point_lanes.h"

static const double ROUNDOFF = 1e-14; /* of G/2: less is no stored energy but what rounding leaves of 3 - 3 */

typedef struct {
    int64_t branches;
    const double *modulus, *share, *rest; /* of each: G, t = dt/(tau + dt) and 1 - t */
} Branches;

/* tr (dev A dev A) of A = B N, not negative: A is similar to a symmetric tensor. */
INLINE vec distance(int space, const tensor B, const tensor N)
{
    tensor A;
    multiply(space, B, N, A);
    vec mean = trace(A) * (1.0 / 3.0), sum = all(0.0);
    for (int i = 0; i < 3; ++i)
        A[i][i] -= mean;
    EACH(space, i, j) sum += A[i][j] * A[j][i];
    return choose((ivec)(sum < 0.0), all(0.0), sum);
}

/* What a point has of F alone: H = F^-T, C, j = J^(-2/3). */
typedef struct {
    tensor F, H, C;
    vec j;
    ivec good;
} Deformation;

INLINE void deformation(int space, const vec *F, Deformation *at)
{
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    vec J;
    for (int p = 0; p < (space ? 9 : 5); ++p)
        at->F[place[p][0]][place[p][1]] = F[p];
    if (space) {
        for (int i = 0; i < 3; ++i)
            cross(at->F[(i + 1) % 3], at->F[(i + 2) % 3], at->H[i]);
        J = dot(at->F[0], at->H[0]);
    } else {
        at->H[0][0] = F[3] * F[4];
        at->H[0][1] = -F[2] * F[4];
        at->H[1][0] = -F[1] * F[4];
        at->H[1][1] = F[0] * F[4];
        at->H[2][2] = F[0] * F[3] - F[1] * F[2];
        J = at->H[2][2] * F[4];
    }
    at->good = (ivec)(J > 0.0) & is_finite(J);
    vec root = inverse_cube_root(choose(at->good, J, all(1.0)));
    at->j = root * root;
    EACH(space, i, j) at->H[i][j] *= at->j * root;
    UPPER(space, i, j)
    {
        at->C[i][j] = all(0.0);
        for (int k = 0; k < 3; ++k)
            if (COUPLED(space, k, i))
                at->C[i][j] += at->F[k][i] * at->F[k][j];
    }
    mirror(space, at->C);
}

/* What the branches add up: sum of g N, sum of g n/3, and of the tangent Z and c. */
typedef struct {
    tensor N, Z;
    vec pressure, c;
} Sum;

/* A += W_ik N_JL - y U_iL U_kJ + 2 y/3 U_iJ U_kL, upper half; W = g I - y V. */
INLINE void add_branch(enum section section, vec g, vec y, const tensor U, const tensor V, const tensor N,
                       vec *A)
{
    const int space = section == SPACE, count = space ? 9 : 5, rows = section == STRAIN ? 4 : count;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    tensor W, yU;
    EACH(space, i, k)
    {
        W[i][k] = (i == k ? g : all(0.0)) - y * V[i][k];
        yU[i][k] = y * U[i][k];
    }
#pragma GCC unroll 9
    for (int p = 0; p < rows; ++p) {
        const int i = place[p][0], J = place[p][1];
        vec twice = (2.0 / 3.0) * yU[i][J];
#pragma GCC unroll 9
        for (int q = p; q < rows; ++q) {
            const int k = place[q][0], L = place[q][1];
            vec sum = twice * U[k][L];
            if (COUPLED(space, i, k) && COUPLED(space, J, L))
                sum += W[i][k] * N[J][L];
            if (COUPLED(space, i, L) && COUPLED(space, k, J))
                sum -= yU[i][L] * U[k][J];
            A[p * count + q] += sum;
        }
    }
}

/* One branch: from C_n to C_k, both as in the state, with what it stores and what it dissipates by
 * the rate at the end, where there is a place for them. Without it a C_k that is given is read: then
 * N is its cofactors over m^(1/3) = tr M/tr C_k. */
INLINE void branch(enum section section, double G, double t, double s, const Deformation *at,
                   const vec *from, vec *to, vec *energies, vec *moduli, Sum *sum)
{
    const int space = section == SPACE;
    tensor old, M, N;
    vec share = t * at->j, cube, root, scale_of_N;
    if (to && !energies) {
        vec size = s * (from[0] + from[1] + from[2]) + share * trace(at->C), whole = to[0] + to[1] + to[2];
        symmetric_of(space, to, M);
        scale_of_N = whole / size;
        cube = size / whole;
        cofactors(space, M, N);
    } else {
        symmetric_of(space, from, old);
        UPPER(space, i, j) M[i][j] = s * old[i][j] + share * at->C[i][j];
        mirror(space, M);
        vec m = cofactors(space, M, N), square;
        root = inverse_cube_root(m);
        square = root * root;
        scale_of_N = square * root;
        cube = m * square;
    }
    EACH(space, i, j) N[i][j] *= scale_of_N;
    vec scale = G * cube, g = scale * at->j, n = contract(space, N, at->C);
    EACH(space, i, j) sum->N[i][j] += g * N[i][j];
    sum->pressure += g * ((1.0 / 3.0) * n);
    if (energies) {
        for (int k = 0; k < (space ? 6 : 4); ++k)
            to[k] = root * M[PAIRS[k][0]][PAIRS[k][1]];
        vec excess = cube * at->j * n - 3.0;
        energies[0] = 0.5 * G * choose((ivec)(excess < ROUNDOFF), all(0.0), excess);
        if (t < 0.5)
            energies[1] = 0.5 * (t / s) * scale * cube * at->j * at->j * distance(space, at->C, N);
        else
            energies[1] = 0.5 * (s / t) * scale * cube * distance(space, old, N);
    }
    if (!moduli)
        return;
    tensor U, V, VU;
    vec y = t * at->j * g;
    multiply(space, at->F, N, U);
    UPPER(space, i, k)
    {
        V[i][k] = all(0.0);
        for (int j = 0; j < 3; ++j)
            if (COUPLED(space, i, j))
                V[i][k] += U[i][j] * at->F[k][j];
    }
    mirror(space, V);
    vec q = contract(space, V, V), second = (2.0 / 3.0) * y;
    add_branch(section, g, y, U, V, N, moduli);
    multiply(space, V, U, VU);
    vec first = -(2.0 / 3.0) * g - (1.0 / 3.0) * second * n;
    EACH(space, i, j) sum->Z[i][j] += first * U[i][j] + second * VU[i][j];
    sum->c += (2.0 / 9.0) * g * n + y * ((2.0 / 27.0) * n * n - (2.0 / 9.0) * q);
}

/* A += H (x) Z + Z (x) H + c H (x) H + d H_iL H_kJ, upper half and then the lower one. */
INLINE void add_shared(enum section section, const tensor H, const Sum *of, vec *A)
{
    const int space = section == SPACE, count = space ? 9 : 5, rows = section == STRAIN ? 4 : count;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    tensor Y, dH;
    EACH(space, i, j)
    {
        Y[i][j] = of->Z[i][j] + of->c * H[i][j];
        dH[i][j] = of->pressure * H[i][j];
    }
#pragma GCC unroll 9
    for (int p = 0; p < rows; ++p) {
        const int i = place[p][0], J = place[p][1];
#pragma GCC unroll 9
        for (int q = p; q < rows; ++q) {
            const int k = place[q][0], L = place[q][1];
            vec sum = H[i][J] * Y[k][L] + of->Z[i][J] * H[k][L];
            if (COUPLED(space, i, L) && COUPLED(space, k, J))
                sum += dH[i][L] * H[k][J];
            A[p * count + q] += sum;
            A[q * count + p] = A[p * count + q];
        }
    }
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
    Sum sum = {};
    Deformation at;
    tensor FN;
    vec ok = all(0.0);
    deformation(space, F, &at);
    for (int k = 0; moduli && k < count * count; ++k)
        moduli[k] = all(0.0);
    for (int k = 0; energies && k < ENERGIES; ++k)
        energies[k] = all(0.0);
#pragma GCC unroll 1
    for (int b = 0; b < branches; ++b) {
        vec energy[2];
        branch(section, w->modulus[b], w->share[b], w->rest[b], &at, state + size * b,
               end ? end + size * b : 0, energies ? energy : 0, moduli, &sum);
        if (!energies)
            continue;
        vec fallen = square_root(state[kept + b]) - square_root(energy[0]);
        if (w->share[b] < 0.5) {
            const double ratio = w->share[b] / w->rest[b];
            energy[1] += square_root(0.5 * ratio * energy[1]) * fallen;
            energy[1] = choose((ivec)(energy[1] > 0.0), energy[1], all(0.0));
        } else {
            energy[1] += choose((ivec)(fallen > 0.0), fallen * fallen, all(0.0));
        }
        end[lost + b] = state[lost + b] + energy[1];
        end[kept + b] = energy[0];
        energies[0] += energy[0];
        energies[1] += energy[1];
    }
    multiply(space, at.F, sum.N, FN);
    for (int p = 0; p < count; ++p) {
        const int i = place[p][0], J = place[p][1];
        P[p] = FN[i][J] - sum.pressure * at.H[i][J];
    }
    if (moduli)
        add_shared(section, at.H, &sum, moduli);
    probe(P, count, &ok);
    if (energies)
        probe(end, width, &ok);
    *good = at.good & is_finite(ok);
    for (int k = 0; energies && k < width; ++k)
        end[k] = choose(*good, end[k], state[k]);
}

KERNEL(viscous_strain, STRAIN, update)
KERNEL(viscous_ring, RING, update)
KERNEL(viscous_space, SPACE, update)
