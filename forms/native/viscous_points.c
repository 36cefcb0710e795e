/* Material points of Maxwell branches at finite strain, eight at a time.
 *
 * The same operations as forms/bodies/viscous_points.py, where the equations are. In the plane the
 * tensors are those in space with zeros.
 */

#include "point_lanes.h"

static const double ROUNDOFF = 1e-14; /* as in viscous_points.py */

typedef struct {
    int64_t branches;
    const double *modulus, *share, *rest; /* of each: G, t = dt/(tau + dt) and 1 - t */
} Work;

typedef vec Tensor[3][3];

/* C = A B^T. */
INLINE void times_transposed(const vec A[3][3], const vec B[3][3], vec C[3][3])
{
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            C[i][j] = A[i][0] * B[j][0] + A[i][1] * B[j][1] + A[i][2] * B[j][2];
}

INLINE void times(const vec A[3][3], const vec B[3][3], vec C[3][3])
{
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            C[i][j] = A[i][0] * B[0][j] + A[i][1] * B[1][j] + A[i][2] * B[2][j];
}

/* cof A; returns det A. */
INLINE vec cofactors(const vec A[3][3], vec cof[3][3])
{
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            cof[i][j] = A[a][c] * A[b][d] - A[a][d] * A[b][c];
        }
    return A[0][0] * cof[0][0] + A[0][1] * cof[0][1] + A[0][2] * cof[0][2];
}

INLINE vec trace_of(const vec A[3][3])
{
    return A[0][0] + A[1][1] + A[2][2];
}

/* tr (dev A dev A) of A = B N, not negative: A is similar to a symmetric tensor. */
INLINE vec distance(const vec B[3][3], const vec N[3][3])
{
    Tensor A;
    times(B, N, A);
    vec mean = trace_of(A) * (1.0 / 3.0), sum = all(0.0);
    for (int i = 0; i < 3; ++i)
        A[i][i] -= mean;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            sum += A[i][j] * A[j][i];
    return choose((ivec)(sum < 0.0), all(0.0), sum);
}

/* What a point has of F alone: H = F^-T, C, j = J^(-2/3). */
typedef struct {
    Tensor F, H, C;
    vec j;
    ivec good;
} Deformation;

INLINE void deformation(int space, const vec *F, Deformation *at)
{
    const int count = space ? 9 : 5;
    const int(*place)[2] = space ? SPACE : PLANE;
    for (int k = 0; k < 9; ++k)
        at->F[k / 3][k % 3] = all(0.0);
    for (int p = 0; p < count; ++p)
        at->F[place[p][0]][place[p][1]] = F[p];
    vec J = cofactors(at->F, at->H);
    at->good = (ivec)(J > 0.0) & is_finite(J);
    vec safe = choose(at->good, J, all(1.0)), inverse = 1.0 / safe, root = inverse_cube_root(safe);
    at->j = root * root;
    for (int k = 0; k < 9; ++k)
        at->H[k / 3][k % 3] *= inverse;
    for (int I = 0; I < 3; ++I)
        for (int K = 0; K < 3; ++K)
            at->C[I][K] = at->F[0][I] * at->F[0][K] + at->F[1][I] * at->F[1][K] +
                          at->F[2][I] * at->F[2][K];
}

/* Terms of the tangent that the branches share: see class Tangent in viscous_points.py. */
typedef struct {
    Tensor Z;
    vec c, d;
} Shared;

/* A += W_ik N_JL - y U_iL U_kJ + 2 y/3 U_iJ U_kL, upper half; W = g I - y V. */
INLINE void add_branch(int space, vec g, vec y, const vec U[3][3], const vec V[3][3],
                       const vec N[3][3], vec *A)
{
    const int count = space ? 9 : 5;
    const int(*place)[2] = space ? SPACE : PLANE;
#pragma GCC unroll 1
    for (int p = 0; p < count; ++p) {
        const int i = place[p][0], J = place[p][1];
        vec twice = (2.0 / 3.0) * y * U[i][J];
#pragma GCC unroll 1
        for (int q = p; q < count; ++q) {
            const int k = place[q][0], L = place[q][1];
            vec W = (i == k ? g : all(0.0)) - y * V[i][k];
            A[p * count + q] += W * N[J][L] - y * U[i][L] * U[k][J] + twice * U[k][L];
        }
    }
}

/* One branch: from C_n (6 or 4) to C_k, with energies[0] what it stores and energies[1] what it
 * dissipates by the rate at the end; adds to P and A. */
INLINE void branch(int space, double G, double t, double s, const Deformation *at, const vec *from,
                   vec *to, vec stress[3][3], vec *moduli, Shared *shared, vec *energies)
{
    const int size = space ? 6 : 4;
    Tensor old, M, N, U, V;
    for (int k = 0; k < 9; ++k)
        old[k / 3][k % 3] = all(0.0);
    for (int k = 0; k < size; ++k)
        old[PAIRS[k][0]][PAIRS[k][1]] = old[PAIRS[k][1]][PAIRS[k][0]] = from[k];
    for (int k = 0; k < 9; ++k)
        M[k / 3][k % 3] = s * old[k / 3][k % 3] + (t * at->j) * at->C[k / 3][k % 3];
    vec m = cofactors(M, N), inverse = 1.0 / m, root = inverse_cube_root(m);
    vec cube = m * root * root; /* m^(1/3) */
    for (int k = 0; k < 9; ++k)
        N[k / 3][k % 3] *= inverse;
    for (int k = 0; k < size; ++k)
        to[k] = root * M[PAIRS[k][0]][PAIRS[k][1]];
    times(at->F, N, U);
    times_transposed(U, at->F, V);
    vec g = G * cube * at->j, n = trace_of(V);
    for (int k = 0; k < 9; ++k)
        stress[k / 3][k % 3] += g * (U[k / 3][k % 3] - (1.0 / 3.0) * n * at->H[k / 3][k % 3]);
    vec excess = cube * at->j * n - 3.0, scale = 0.5 * G * cube * cube;
    energies[0] = 0.5 * G * choose((ivec)(excess < ROUNDOFF), all(0.0), excess);
    if (t < 0.5)
        energies[1] = (t / s) * scale * at->j * at->j * distance(at->C, N);
    else
        energies[1] = (s / t) * scale * distance(old, N);
    if (!moduli)
        return;
    vec y = t * at->j * g, q = all(0.0);
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            q += V[i][k] * V[k][i];
    add_branch(space, g, y, U, V, N, moduli);
    Tensor VU;
    times(V, U, VU);
    vec first = -(2.0 / 3.0) * g - (2.0 / 9.0) * y * n, second = (2.0 / 3.0) * y;
    for (int k = 0; k < 9; ++k)
        shared->Z[k / 3][k % 3] += first * U[k / 3][k % 3] + second * VU[k / 3][k % 3];
    shared->d += (1.0 / 3.0) * g * n;
    shared->c += (2.0 / 9.0) * g * n + y * ((2.0 / 27.0) * n * n - (2.0 / 9.0) * q);
}

/* A += H (x) Z + Z (x) H + c H (x) H + d H_iL H_kJ, upper half and then the lower one. */
INLINE void add_shared(int space, const vec H[3][3], const Shared *of, vec *A)
{
    const int count = space ? 9 : 5;
    const int(*place)[2] = space ? SPACE : PLANE;
#pragma GCC unroll 1
    for (int p = 0; p < count; ++p) {
        const int i = place[p][0], J = place[p][1];
#pragma GCC unroll 1
        for (int q = p; q < count; ++q) {
            const int k = place[q][0], L = place[q][1];
            A[p * count + q] += H[i][J] * (of->Z[k][L] + of->c * H[k][L]) +
                                of->Z[i][J] * H[k][L] + of->d * H[i][L] * H[k][J];
            A[q * count + p] = A[p * count + q];
        }
    }
}

INLINE int64_t over_points(int space, const Work *w, int64_t n, const double *F,
                           const double *state, double *P, double *end, double *A, double *energies)
{
    const int count = space ? 9 : 5, size = space ? 6 : 4, count_of = (int)w->branches, lost = size * count_of,
              kept = lost + count_of, width = kept + count_of;
    const int(*place)[2] = space ? SPACE : PLANE;
    const ivec always = ~(ivec){};
    ivec bad = {};
    vec s[width], next[width];
    for (int64_t first = 0; first < n; first += LANES) {
        vec f[9], stress[9], moduli[81], energy[2], total[2] = {};
        Tensor sum = {};
        Shared shared = {};
        Deformation at;
        load(F, first, n, count, f);
        load(state, first, n, width, s);
        deformation(space, f, &at);
        for (int k = 0; A && k < count * count; ++k)
            moduli[k] = all(0.0);
#pragma GCC unroll 1
        for (int b = 0; b < w->branches; ++b) {
            branch(space, w->modulus[b], w->share[b], w->rest[b], &at, s + size * b,
                   next + size * b, sum, A ? moduli : 0, &shared, energy);
            vec fallen = square_root(s[kept + b]) - square_root(energy[0]);
            energy[1] += choose((ivec)(fallen > 0.0), fallen * fallen, all(0.0));
            next[lost + b] = s[lost + b] + energy[1];
            next[kept + b] = energy[0];
            total[0] += energy[0];
            total[1] += energy[1];
        }
        vec ok = all(0.0);
        for (int p = 0; p < count; ++p)
            stress[p] = sum[place[p][0]][place[p][1]];
        probe(stress, count, &ok);
        probe(next, width, &ok);
        if (A)
            add_shared(space, at.H, &shared, moduli);
        ivec good = at.good & is_finite(ok);
        for (int k = 0; k < width; ++k)
            next[k] = choose(good, next[k], s[k]);
        store(stress, good, first, n, count, P);
        store(next, always, first, n, width, end);
        for (int k = 0; k < 2; ++k)
            store(total + k, good, first, n, 1, energies + k * n);
        if (A)
            store(moduli, good, first, n, count * count, A);
        bad |= ~good;
    }
    return any(bad);
}

/* Updates n points; returns whether any was not valid. F (n, p), state and end (n, s): the C of all
 * branches, what each has dissipated, what each stores; P (n, p), A (n, p, p) or null, energies (2, n): stored,
 * dissipated in the step. */
EXPORT int64_t tribox_viscous_plane(const Work *w, int64_t n, const double *F, const double *state,
                                    double *P, double *end, double *A, double *energies)
{
    return over_points(0, w, n, F, state, P, end, A, energies);
}

EXPORT int64_t tribox_viscous_space(const Work *w, int64_t n, const double *F, const double *state,
                                    double *P, double *end, double *A, double *energies)
{
    return over_points(1, w, n, F, state, P, end, A, energies);
}
