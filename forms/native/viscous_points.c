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
    vec root = root_of(space ? place->J : place->J * place->hoop, &at->good);
    at->j = root * root;
    vec scale = at->j * root;
    EACH(space, i, j) at->H[i][j] *= scale;
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

INLINE void start(int space, Sum *sum)
{
    sum->pressure = sum->c = all(0.0);
    EACH(space, i, j) sum->N[i][j] = sum->Z[i][j] = all(0.0);
}

/* A += W_ik N_JL - y U_iL U_kJ + 2 y/3 U_iJ U_kL in space, (J, i, L, k), upper half; W = g I - y V. */
INLINE void add_branch(vec g, vec y, const tensor U, const tensor V, const tensor N, vec *A)
{
    tensor W, yU;
    EACH(1, i, k)
    {
        W[i][k] = (i == k ? g : all(0.0)) - y * V[i][k];
        yU[i][k] = y * U[i][k];
    }
#pragma GCC unroll 9
    for (int p = 0; p < 9; ++p) {
        const int J = p / 3, i = p % 3;
        vec twice = (2.0 / 3.0) * yU[i][J];
#pragma GCC unroll 9
        for (int q = p; q < 9; ++q) {
            const int L = q / 3, k = q % 3;
            A[p * 9 + q] += twice * U[k][L]; /* one by one, three instructions for four */
            A[p * 9 + q] += W[i][k] * N[J][L];
            A[p * 9 + q] -= yU[i][L] * U[k][J];
        }
    }
}

/* What a branch adds to the moduli in space, and to Z and c. */
INLINE void branch_moduli(const Deformation *at, vec g, vec y, vec n, const tensor N, vec *moduli, Sum *sum)
{
    tensor U, V, VU;
    multiply(1, at->F, N, U);
    UPPER(1, i, k) V[i][k] = dot(U[i], at->F[k]);
    mirror(1, V);
    vec q = contract(1, V, V), second = (2.0 / 3.0) * y;
    add_branch(g, y, U, V, N, moduli);
    multiply(1, V, U, VU);
    vec first = -(2.0 / 3.0) * g - (1.0 / 3.0) * second * n;
    EACH(1, i, j) sum->Z[i][j] += first * U[i][j] + second * VU[i][j];
    sum->c += (2.0 / 9.0) * g * n + y * ((2.0 / 27.0) * n * n - (2.0 / 9.0) * q);
}

/* One branch: from C_n to C_k, both as in the state, with what it stores and what it dissipates by
 * the rate at the end, where there is a place for them; moduli in space only. */
INLINE void branch(enum section section, double G, double t, double s, double ratio, const Deformation *at,
                   const vec *from, vec *to, vec *energies, vec *moduli, Sum *sum)
{
    const int space = section == SPACE;
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
    if (moduli) {
        vec inverse = square * root;
        EACH(space, i, j) K[i][j] *= inverse;
        g *= m;
        branch_moduli(at, g, share * g, 3.0 * mean * inverse, K, moduli, sum);
    }
}

/* A += H (x) Z + Z (x) H + c H (x) H + d H_iL H_kJ in space, upper half. */
INLINE void add_shared(const tensor H, const Sum *of, vec *A)
{
    tensor Y, dH;
    EACH(1, i, j)
    {
        Y[i][j] = of->Z[i][j] + of->c * H[i][j];
        dH[i][j] = of->pressure * H[i][j];
    }
#pragma GCC unroll 9
    for (int p = 0; p < 9; ++p) {
        const int J = p / 3, i = p % 3;
#pragma GCC unroll 9
        for (int q = p; q < 9; ++q) {
            const int L = q / 3, k = q % 3;
            A[p * 9 + q] += H[i][J] * Y[k][L];
            A[p * 9 + q] += of->Z[i][J] * H[k][L];
            A[p * 9 + q] += dH[i][L] * H[k][J];
        }
    }
}

/* P in the plane, and A, (J, i, L, k) and 33 last, upper half, see viscous_points.py: a L, b L, T_3 and
 * T_4 summed up over the branches. Returns which points can be evaluated. */
INLINE ivec in_plane(enum section section, const Branches *w, const Place *at, const vec *state, vec *P,
                     vec A[5][5])
{
    const int rows = section == STRAIN ? 4 : 5, ring = section == RING;
    const vec *g = at->g, J = at->J;
    ivec good;
    const vec root = root_of(ring ? J * at->hoop : J, &good), j = root * root, jj = j * j;
    const vec scale = ring ? j * root * at->hoop : j * root;
    const vec H[4] = {g[3] * scale, -g[2] * scale, -g[1] * scale, g[0] * scale}, hoop = J * j * root;
    const vec across = ring ? at->hoop * at->hoop : all(1.0), jA = ring ? jj * across : jj, jV = jj * J * J;
    vec first[3] = {}, second[3] = {}, third = all(0.0), fourth = all(0.0);
#pragma GCC unroll 5
    for (int k = 0; k < 5; ++k)
#pragma GCC unroll 5
        for (int l = k; l < 5; ++l)
            A[k][l] = all(0.0);
#pragma GCC unroll 1
    for (int b = 0; b < w->branches; ++b) {
        const double modulus = w->modulus[b], t = w->share[b], s = w->rest[b];
        const vec *C = state + 4 * b;
        vec L[3] = {C[1], C[0], -C[3]}, d = C[0] * C[1] - C[3] * C[3], p[5], u[4];
        for (int i = 0; i < 2; ++i) {
            u[i] = g[i] * L[0] + g[2 + i] * L[2];
            u[2 + i] = g[i] * L[2] + g[2 + i] * L[1];
        }
        vec I = (g[0] * u[0] + g[1] * u[1]) + (g[2] * u[2] + g[3] * u[3]);
        vec one = (s * s) * j * C[2], two = (s * t) * jA, four = (s * t) * jV * C[2];
        vec three = ring ? (s * s) * j * across * d : (s * s) * j * d;
        vec sum = one + two, m = (s * s * s) * (C[2] * d) + t * (sum * I + three + four) + t * t * t;
        vec root = inverse_cube_root_of_ratio(m), by = (0.5 * modulus) * (root * root);
        one *= by, two *= by, three *= by, four *= by, sum *= 2.0 * by;
        for (int k = 0; k < 3; ++k) {
            first[k] += one * L[k];
            second[k] += two * L[k];
        }
        third += three;
        fourth += four;
        vec slope = (2.0 / 3.0) * (four - three - (one + 2.0 * two) * I);
        vec bent = (-4.0 / 3.0 * t / modulus) * root;
        for (int k = 0; k < 4; ++k)
            p[k] = sum * u[k] + slope * H[k];
        p[4] = (2.0 / 3.0) * ((two - one) * I + 2.0 * (three - four)) * hoop;
#pragma GCC unroll 5
        for (int k = 0; k < rows; ++k) {
            vec row = bent * p[k];
#pragma GCC unroll 5
            for (int l = k; l < rows; ++l)
                A[k][l] += row * p[l];
        }
    }
    vec U[4], V[4], T = all(0.0), S = all(0.0), Z[4];
    for (int k = 0; k < 4; ++k) {
        const int i = k & 1, x = k & 2;
        U[k] = g[i] * first[x ? 2 : 0] + g[2 + i] * first[x ? 1 : 2];
        V[k] = g[i] * second[x ? 2 : 0] + g[2 + i] * second[x ? 1 : 2];
        T += g[k] * U[k];
        S += g[k] * V[k];
    }
    vec slope = (2.0 / 3.0) * (fourth - third - T - 2.0 * S);
    vec turn = (5.0 / 9.0) * (T + third) + (14.0 / 9.0) * S - (1.0 / 9.0) * fourth;
    vec mixed = (4.0 / 9.0) * T - (8.0 / 9.0) * (S + third + fourth);
    vec area = slope * scale;
    for (int k = 0; k < 4; ++k) {
        P[2 * (k & 1) + (k >> 1)] = 2.0 * (U[k] + V[k]) + slope * H[k];
        Z[k] = turn * H[k] - (4.0 / 3.0) * (U[k] + 2.0 * V[k]);
        A[k][4] += ((4.0 / 3.0) * (V[k] - U[k]) + mixed * H[k]) * hoop;
    }
    P[4] = (2.0 / 3.0) * (S - T + 2.0 * (third - fourth)) * hoop;
    A[4][4] += ((10.0 / 9.0) * T - (2.0 / 9.0) * S + (4.0 / 9.0) * third + (28.0 / 9.0) * fourth) * (hoop * hoop);
    for (int k = 0; k < 3; ++k)
        first[k] = 2.0 * (first[k] + second[k]);
    for (int i = 0; i < 2; ++i) {
        A[i][i] += first[0];
        A[i][2 + i] += first[2];
        A[2 + i][2 + i] += first[1];
    }
    A[0][3] += area;
    A[1][2] -= area;
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k)
#pragma GCC unroll 4
        for (int l = k; l < 4; ++l)
            A[k][l] = (A[k][l] + H[k] * Z[l]) + Z[k] * H[l];
    return good;
}

/* Moduli of a point by itself. */
INLINE void whole(int space, const vec *upper, vec *moduli)
{
    const int dim = space ? 3 : 2, count = space ? 9 : 5, all_of = dim * dim;
    for (int p = 0; p < count; ++p)
        for (int q = 0; q < count; ++q) {
            const int a = p < all_of ? dim * (p % dim) + p / dim : p;
            const int b = q < all_of ? dim * (q % dim) + q / dim : q;
            moduli[count * p + q] = a < b ? upper[count * a + b] : upper[count * b + a];
        }
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
    vec ok = all(0.0), g[9], upper[81];
    for (int p = 0; p < dim * dim; ++p)
        g[dim * (p % dim) + p / dim] = F[p];
    Place here = {g, space ? all(0.0) : g[0] * g[3] - g[1] * g[2], F[4]};
    if (space) {
        vec normal[3];
        cross(g + 3, g + 6, normal);
        here.J = dot(g, normal);
    }
    start(space, &sum);
    if (space || !moduli || energies)
        deformation(space, &here, &at);
    if (moduli && !space) {
        vec A[5][5];
        at.good = in_plane(section, w, &here, state, P, A);
        whole(0, A[0], moduli);
    }
    for (int k = 0; moduli && space && k < 81; ++k)
        upper[k] = all(0.0);
    for (int k = 0; energies && k < ENERGIES; ++k)
        energies[k] = all(0.0);
#pragma GCC unroll 1
    for (int b = 0; b < branches && (space || !moduli || energies); ++b) {
        const double ratio = w->ratio[b];
        const int late = w->share[b] < 0.5;
        vec energy[2];
        branch(section, w->modulus[b], w->share[b], w->rest[b], ratio, &at, state + size * b,
               end ? end + size * b : 0, energies ? energy : 0, space && moduli ? upper : 0, &sum);
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
    for (int p = 0; p < count && (space || !moduli); ++p) {
        const int i = place[p][0], J = place[p][1];
        P[p] = FN[i][J] - sum.pressure * at.H[i][J];
    }
    if (moduli && space) {
        add_shared(at.H, &sum, upper);
        whole(1, upper, moduli);
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
