/* Material points of finite J2 plasticity, eight at a time.
 *
 * The same operations as forms/bodies/plastic_points.py, return_mapping.py and principal_axes.py,
 * where the equations are. Principal axes in space come without iterations over rotations: the
 * principal value that is farthest from the other two from its cubic, its axis from a cross product
 * (D. Eberly, A robust eigensolver for 3x3 symmetric matrices, geometrictools.com, 2014), the
 * other two from the plane across it. All of it is scaled by the deviator, so that nearly equal
 * values, as of the elastic strains of metals, lose nothing. Only the hardening laws other than the
 * linear one, and the rate factors, are taken point by point.
 */

#include <math.h>

#include "point_lanes.h"

enum law { LINEAR, VOCE, SWIFT, TABLE };
enum rate { NO_RATE, JOHNSON_COOK, PERZYNA };

/* Those of return_mapping.py and principal_axes.py. */
static const double NEUTRAL = 1e-9, STILL = 1e-11;
static const double SMALL_STEP = 1e-9, ROUNDOFF = 1e-15, SERIES = 0.02;
enum { ITERATIONS = 200 };

typedef struct {
    double shear, bulk, dt, rate_parameters[2];
    int64_t law, rate, count; /* count: points of a table */
    const double *parameters; /* of the law; of a table the strains, then the stresses */
} Material;

/* For the caller to compare with the structure that it lays out itself. */
int64_t tribox_plastic_material_size(void)
{
    return (int64_t)sizeof(Material);
}

/* Yield stress and its slope at a plastic strain. */
static void yield_stress(const Material *m, double alpha, double *stress, double *slope)
{
    const double *p = m->parameters;
    if (m->law == LINEAR) { /* stress, modulus */
        *stress = p[0] + p[1] * alpha;
        *slope = p[1];
    } else if (m->law == VOCE) { /* stress, saturation, exponent, modulus */
        double decay = exp(-p[2] * alpha), gain = p[1] - p[0];
        *stress = p[0] + p[3] * alpha + gain * (1.0 - decay);
        *slope = p[3] + gain * p[2] * decay;
    } else if (m->law == SWIFT) { /* K, strain0, n */
        *stress = p[0] * pow(p[1] + alpha, p[2]);
        *slope = p[2] * *stress / (p[1] + alpha);
    } else {
        const double *value = p + m->count;
        int64_t low = 0, high = m->count; /* p[low] <= alpha < p[high] */
        while (high - low > 1) {
            int64_t middle = (low + high) / 2;
            if (p[middle] <= alpha)
                low = middle;
            else
                high = middle;
        }
        int level = high == m->count;
        *slope = level ? 0.0 : (value[high] - value[low]) / (p[high] - p[low]);
        *stress = value[low] + *slope * (alpha - p[low]);
    }
}

/* Flow stress, yield stress times the factor of the rate step/dt, and its slope over the step. */
static void flow_stress(const Material *m, double alpha, double step, double *stress, double *slope)
{
    yield_stress(m, alpha + step, stress, slope);
    if (m->rate == NO_RATE)
        return;
    double factor = 1.0, by_rate = 0.0, reference, speed = step / m->dt;
    if (m->rate == JOHNSON_COOK) { /* C, reference rate */
        reference = m->rate_parameters[1];
        if (speed >= reference) {
            factor += m->rate_parameters[0] * log(speed / reference);
            by_rate = m->rate_parameters[0] / speed;
        }
    } else { /* reference rate, exponent */
        reference = m->rate_parameters[0];
        double power = m->rate_parameters[1];
        factor += pow(speed / reference, power);
        by_rate = power / reference * pow(speed / reference, power - 1.0);
    }
    *slope = *slope * factor + *stress * by_rate / m->dt;
    *stress *= factor;
}

/* Left of the root for concave laws, see return_mapping.py. */
static double start(const Material *m, double over, double stress, double slope)
{
    double x = over / (3.0 * m->shear + slope), rate;
    if (m->rate == NO_RATE)
        return x;
    if (m->rate == JOHNSON_COOK)
        rate = m->rate_parameters[1] * exp(0.5 * over / stress / m->rate_parameters[0]);
    else
        rate = m->rate_parameters[0] * pow(0.5 * over / stress, 1.0 / m->rate_parameters[1]);
    return over > 0.0 ? fmin(0.5 * x, m->dt * rate) : 0.0;
}

/* The plastic strain of the step that brings the von Mises stress `trial` to yield. */
static double plastic_step(const Material *m, double trial, double alpha)
{
    double stress, slope;
    yield_stress(m, alpha, &stress, &slope);
    double over = trial > (1.0 + STILL) * stress ? trial - stress : 0.0;
    double low = 0.0, high = over / (3.0 * m->shear);
    double x = start(m, over, stress, slope);
    for (int i = 0; i < ITERATIONS && x > 0.0; ++i) {
        flow_stress(m, alpha, x, &stress, &slope);
        double g = trial - 3.0 * m->shear * x - stress;
        if (g >= 0.0)
            low = x;
        else
            high = x;
        double newton = x + g / (3.0 * m->shear + slope);
        if (fabs(newton - x) <= SMALL_STEP * x || fabs(g) <= ROUNDOFF * trial)
            return newton;
        x = newton > low && newton < high ? newton : 0.5 * (low + high);
    }
    return x;
}

/* Principal axes a of the trial deformation; n_a and F^-1 n_a by rows. */
typedef struct {
    vec w[3], logs[3], n[3][3], G[3][3];
    ivec good;
} Axes;

/* Larger principal value and its axis (x, y) of a symmetric tensor in the plane. */
INLINE vec mohr(vec b11, vec b22, vec b12, vec *x, vec *y)
{
    vec half = 0.5 * (b11 - b22), radius = square_root(half * half + b12 * b12);
    vec far = radius + absolute(half), length = square_root(far * far + b12 * b12);
    ivec round = (ivec)(length == 0.0), first = (ivec)(half >= 0.0);
    vec scale = 1.0 / choose(round, all(1.0), length);
    *x = choose(round, all(1.0), choose(first, far, b12) * scale);
    *y = choose(round, all(0.0), choose(first, b12, far) * scale);
    return 0.5 * (b11 + b22) + radius;
}

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

/* In the plane: F (11, 12, 21, 22, 33), C_p^-1 (11, 22, 33, 12). */
INLINE void axes_in_plane(const vec *F, const vec *C, Axes *at)
{
    vec det = F[0] * F[3] - F[1] * F[2], inverse = 1.0 / det, *n = at->n[0];
    at->good = (ivec)(det > 0.0) & (ivec)(F[4] > 0.0) & is_finite(det);
    vec b11 = F[0] * (F[0] * C[0] + 2.0 * F[1] * C[3]) + F[1] * F[1] * C[1];
    vec b22 = F[2] * (F[2] * C[0] + 2.0 * F[3] * C[3]) + F[3] * F[3] * C[1];
    vec b12 = F[0] * (C[0] * F[2] + C[3] * F[3]) + F[1] * (C[3] * F[2] + C[1] * F[3]);
    at->w[0] = mohr(b11, b22, b12, &n[0], &n[1]);
    at->w[1] = det * det * (C[0] * C[1] - C[3] * C[3]) / at->w[0];
    at->w[2] = F[4] * F[4] * C[2];
    at->n[1][0] = -n[1];
    at->n[1][1] = n[0];
    for (int a = 0; a < 2; ++a) {
        at->G[a][0] = (F[3] * at->n[a][0] - F[1] * at->n[a][1]) * inverse;
        at->G[a][1] = (F[0] * at->n[a][1] - F[2] * at->n[a][0]) * inverse;
    }
    at->n[2][2] = all(1.0);
    at->G[2][2] = 1.0 / F[4];
}

/* The principal value, times `sign` in [sqrt 3, 2], that is farthest from the other two of a
 * deviator whose squares sum to 6: the largest root of x^3 - 3 x - 2 h, h = |det|/2 in [0, 1], by
 * Newton's method from a parabola that is right to 3e-3. */
INLINE vec far_value(vec h)
{
    vec x = 1.7320508075688772 + h * (0.3333333333333333 - 0.0653841409022105 * h);
    for (int i = 0; i < 3; ++i)
        x -= (x * (x * x - 3.0) - 2.0 * h) / (3.0 * (x * x - 1.0));
    return x;
}

/* Axis of the principal value `x` of the deviator d (11, 22, 33, 12, 23, 13): the longest of the
 * cross products of rows of d - x I. */
INLINE void axis_of(const vec *d, vec x, vec *axis)
{
    vec rows[3][3] = {{d[0] - x, d[3], d[5]}, {d[3], d[1] - x, d[4]}, {d[5], d[4], d[2] - x}};
    vec length = all(0.0);
    for (int a = 0; a < 3; ++a) {
        vec product[3];
        cross(rows[a], rows[(a + 1) % 3], product);
        vec found = dot(product, product);
        ivec longer = (ivec)(found > length);
        length = choose(longer, found, length);
        for (int i = 0; i < 3; ++i)
            axis[i] = choose(longer, product[i], axis[i]);
    }
    vec scale = 1.0 / square_root(choose((ivec)(length > 0.0), length, all(1.0)));
    for (int i = 0; i < 3; ++i)
        axis[i] *= scale;
}

/* A unit vector across another one. */
INLINE void across(const vec *n, vec *v)
{
    ivec first = (ivec)(absolute(n[0]) > absolute(n[1]));
    v[0] = choose(first, -n[2], all(0.0));
    v[1] = choose(first, all(0.0), n[2]);
    v[2] = choose(first, n[0], -n[1]);
    vec scale = 1.0 / square_root(dot(v, v));
    for (int i = 0; i < 3; ++i)
        v[i] *= scale;
}

/* Principal values and axes of b (11, 22, 33, 12, 23, 13). */
INLINE void principal(const vec *b, vec *w, vec n[3][3])
{
    vec d[6], mean = (b[0] + b[1] + b[2]) * (1.0 / 3.0), size = all(0.0);
    for (int i = 0; i < 6; ++i) {
        d[i] = i < 3 ? b[i] - mean : b[i];
        size += (i < 3 ? 1.0 : 2.0) * d[i] * d[i];
    }
    size *= 1.0 / 6.0;
    ivec round = (ivec)(size <= 1e-36 * mean * mean);
    vec scale = 1.0 / square_root(choose(round, all(1.0), size));
    for (int i = 0; i < 6; ++i)
        d[i] *= scale;
    vec half = 0.5 * (d[0] * (d[1] * d[2] - d[4] * d[4]) - d[3] * (d[3] * d[2] - d[4] * d[5]) +
                      d[5] * (d[3] * d[4] - d[1] * d[5]));
    vec h = absolute(half), value = far_value(choose((ivec)(h < 1.0), h, all(1.0)));
    for (int i = 0; i < 3; ++i)
        n[2][i] = all(i == 2);
    axis_of(d, choose((ivec)(half >= 0.0), value, -value), n[2]);
    vec u[3], v[3], Du[3], Dv[3], x, y;
    across(n[2], u);
    cross(n[2], u, v);
    const vec D[3][3] = {{d[0], d[3], d[5]}, {d[3], d[1], d[4]}, {d[5], d[4], d[2]}};
    for (int i = 0; i < 3; ++i) {
        Du[i] = dot(D[i], u);
        Dv[i] = dot(D[i], v);
    }
    vec uu = dot(u, Du), vv = dot(v, Dv), larger = mohr(uu, vv, dot(u, Dv), &x, &y);
    vec inverse = choose(round, all(0.0), 1.0 / scale);
    w[0] = mean + larger * inverse;
    w[1] = mean + (uu + vv - larger) * inverse;
    w[2] = mean - (uu + vv) * inverse;
    for (int i = 0; i < 3; ++i) {
        n[0][i] = x * u[i] + y * v[i];
        n[1][i] = x * v[i] - y * u[i];
    }
}

/* In space: F (3, 3), C_p^-1 (11, 22, 33, 12, 23, 13). */
INLINE void axes_in_space(const vec *F, const vec *C, Axes *at)
{
    const vec tensor[3][3] = {{C[0], C[3], C[5]}, {C[3], C[1], C[4]}, {C[5], C[4], C[2]}};
    vec cofactor[3][3], FC[3][3], b[6];
    for (int i = 0; i < 3; ++i)
        cross(F + 3 * ((i + 1) % 3), F + 3 * ((i + 2) % 3), cofactor[i]);
    vec det = dot(F, cofactor[0]), inverse = 1.0 / det;
    at->good = (ivec)(det > 0.0) & is_finite(det);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            FC[i][j] = dot(F + 3 * i, tensor[j]);
    for (int k = 0; k < 6; ++k)
        b[k] = dot(FC[PAIRS[k][0]], F + 3 * PAIRS[k][1]);
    principal(b, at->w, at->n);
    for (int a = 0; a < 3; ++a)
        for (int J = 0; J < 3; ++J)
            at->G[a][J] = (cofactor[0][J] * at->n[a][0] + cofactor[1][J] * at->n[a][1] +
                           cofactor[2][J] * at->n[a][2]) *
                          inverse;
}

/* The end of the step, see class Flow of return_mapping.py. */
typedef struct {
    vec strain[3], n[3], theta, theta_bar, step, stress, numerical;
} Flow;

/* What points take for themselves with laws that are not linear: the plastic strain of the step,
 * the flow stress and its slope, the yield stress at the end. */
static void flow_by_point(const Material *m, const double *trial, const double *alpha,
                          const int64_t *flows, double *step, double *stress, double *slope,
                          double *end)
{
    for (int l = 0; l < LANES; ++l) {
        double unused;
        step[l] = flows[l] ? plastic_step(m, trial[l], alpha[l]) : 0.0;
        flow_stress(m, alpha[l], step[l], &stress[l], &slope[l]);
        yield_stress(m, alpha[l] + step[l], &end[l], &unused);
    }
}

/* Yield stress, by point where the law is not linear. */
INLINE vec yield_stresses(const Material *m, vec alpha)
{
    if (m->law == LINEAR)
        return m->parameters[0] + m->parameters[1] * alpha;
    double stress[LANES], slope;
    for (int l = 0; l < LANES; ++l)
        yield_stress(m, alpha[l], &stress[l], &slope);
    vec result;
    __builtin_memcpy(&result, stress, sizeof result);
    return result;
}

/* The return mapping of the trial strains `logs`, see return_mapping.py. */
INLINE void flow(const Material *m, const vec *logs, vec alpha, Flow *f)
{
    const double three = 3.0 * m->shear, modulus = m->parameters[1];
    vec mean = (logs[0] + logs[1] + logs[2]) * (1.0 / 3.0), end, slope;
    for (int a = 0; a < 3; ++a)
        f->strain[a] = logs[a] - mean;
    vec size = square_root(dot(f->strain, f->strain));
    vec trial = 2.449489742783178 * m->shear * size, begin = yield_stresses(m, alpha);
    ivec flows = (ivec)(trial >= (1.0 - NEUTRAL) * begin);
    if (m->law == LINEAR && m->rate == NO_RATE) {
        ivec over = (ivec)(trial > (1.0 + STILL) * begin);
        f->step = choose(over, (trial - begin) / (three + modulus), all(0.0));
        slope = all(modulus);
        f->stress = end = begin + modulus * f->step;
    } else {
        flow_by_point(m, (double *)&trial, (double *)&alpha, (int64_t *)&flows,
                      (double *)&f->step, (double *)&f->stress, (double *)&slope, (double *)&end);
    }
    vec drop = three * f->step / choose(flows, trial, all(1.0));
    f->theta = 1.0 - drop;
    f->theta_bar = choose(flows, 1.0 / (1.0 + slope / three) - drop, all(0.0));
    f->numerical = 0.5 * (f->stress / end) * (end - begin) * f->step;
    for (int a = 0; a < 3; ++a)
        f->n[a] = f->strain[a] / choose(flows, size, all(1.0));
}

/* artanh(z)/z, z = (w - v)/(w + v), with half of ln(w/v) given. */
INLINE vec log_ratio(vec w, vec v, vec difference)
{
    vec z = (w - v) / (w + v), s = z * z;
    ivec near = (ivec)(absolute(z) < SERIES);
    vec series = 1.0 + s * (1.0 / 3 + s * (1.0 / 5 + s * (1.0 / 7 + s * (1.0 / 9))));
    return choose(near, series, difference / choose(near, all(1.0), z));
}

/* A += M_p T_q, upper half. */
INLINE void add_product(int count, const vec *M, const vec *T, vec *A)
{
#pragma GCC unroll 1
    for (int p = 0; p < count; ++p)
#pragma GCC unroll 1
        for (int q = p; q < count; ++q)
            A[p * count + q] += M[p] * T[q];
}

/* dP/dF (p, p), upper half: the sum of M_ab B_(ab)(cd) M_cd with M_ab = n_a x G_b. */
INLINE void tangent(int space, const Material *m, const Axes *at, const Flow *f, const vec *tau,
                    vec *A)
{
    const int count = space ? 9 : 5;
    const int(*place)[2] = space ? SPACE : PLANE;
    vec M[3][3][9], T[9];
#pragma GCC unroll 1
    for (int ab = 0; ab < 9; ++ab)
#pragma GCC unroll 1
        for (int p = 0; p < count; ++p)
            M[ab / 3][ab % 3][p] = at->n[ab / 3][place[p][0]] * at->G[ab % 3][place[p][1]];
#pragma GCC unroll 1
    for (int k = 0; k < count * count; ++k)
        A[k] = all(0.0);
#pragma GCC unroll 1
    for (int a = 0; a < 3; ++a) {
        vec D[3];
#pragma GCC unroll 1
        for (int b = 0; b < 3; ++b) {
            vec g = at->logs[a] - at->logs[b];
            g = m->shear * f->theta * log_ratio(at->w[a], at->w[b], g) - 0.5 * (tau[a] + tau[b]);
            D[b] = m->bulk + 2.0 * m->shear * (((a == b) - 1.0 / 3.0) * f->theta -
                                               f->theta_bar * f->n[a] * f->n[b]);
            if (a == b) {
                D[b] -= tau[a];
                continue;
            }
            if (!space && (a == 2 || b == 2))
                continue;
#pragma GCC unroll 1
            for (int p = 0; p < count; ++p)
                T[p] = (g + tau[b]) * M[a][b][p] + g * M[b][a][p];
            add_product(count, M[a][b], T, A);
        }
#pragma GCC unroll 1
        for (int p = 0; p < count; ++p)
            T[p] = D[0] * M[0][0][p] + D[1] * M[1][1][p] + D[2] * M[2][2][p];
        add_product(count, M[a][a], T, A);
    }
}

/* C_p^-1 at the end of the step, in the order of the state. */
INLINE void plastic_metric(int space, const Axes *at, const Flow *f, vec *C)
{
    const int count = space ? 6 : 4;
    for (int k = 0; k < count; ++k)
        C[k] = all(0.0);
    for (int a = 0; a < 3; ++a) {
        vec stretch = at->w[a] * exponential(-2.0 * (1.0 - f->theta) * f->strain[a]);
        for (int k = 0; k < count; ++k)
            C[k] += stretch * at->G[a][PAIRS[k][0]] * at->G[a][PAIRS[k][1]];
    }
}

/* Strains and the return mapping; marks the points where they do not exist. */
INLINE void strain_and_flow(int space, const Material *m, const vec *F, const vec *state, Axes *at,
                            Flow *f)
{
    const vec alpha = state[space ? 6 : 4];
    if (space)
        axes_in_space(F, state, at);
    else
        axes_in_plane(F, state, at);
    at->good &= is_finite(alpha);
    for (int a = 0; a < 3; ++a)
        at->good &= (ivec)(at->w[a] > 0.0) & is_finite(at->w[a]);
#pragma GCC unroll 1
    for (int a = 0; a < 3; ++a) {
        at->w[a] = choose(at->good, at->w[a], all(1.0));
        at->logs[a] = 0.5 * logarithm(at->w[a]);
    }
    flow(m, at->logs, alpha, f);
}

/* One block: F (p) and the state (s) to P (p), the state at the end (s), moduli (p, p) if there is
 * room for them, and energies (3); returns which points are valid. */
INLINE ivec update(int space, const Material *m, const vec *F, const vec *state, vec *P, vec *end,
                   vec *moduli, vec *energies)
{
    const int count = space ? 9 : 5, alpha = space ? 6 : 4;
    const int(*place)[2] = space ? SPACE : PLANE;
    vec tau[3], sum = all(0.0);
    Axes at = {};
    Flow f;
    strain_and_flow(space, m, F, state, &at, &f);
    vec volume = at.logs[0] + at.logs[1] + at.logs[2];
    for (int a = 0; a < 3; ++a)
        tau[a] = 2.0 * m->shear * f.theta * f.strain[a] + m->bulk * volume;
#pragma GCC unroll 1
    for (int p = 0; p < count; ++p) {
        const int i = place[p][0], J = place[p][1];
        P[p] = tau[0] * at.n[0][i] * at.G[0][J] + tau[1] * at.n[1][i] * at.G[1][J] +
               tau[2] * at.n[2][i] * at.G[2][J];
    }
    probe(P, count, &sum);
    if (moduli) {
        tangent(space, m, &at, &f, tau, moduli);
#pragma GCC unroll 1
        for (int p = 0; p < count; ++p)
            for (int q = 0; q < p; ++q)
                moduli[p * count + q] = moduli[q * count + p];
        probe(moduli, count * count, &sum);
    }
    energies[0] = m->shear * f.theta * f.theta * dot(f.strain, f.strain) +
                  0.5 * m->bulk * volume * volume;
    energies[1] = f.stress * f.step;
    energies[2] = f.numerical;
    at.good &= is_finite(f.step) & is_finite(sum);
    ivec moved = at.good & (ivec)(f.step > 0.0);
    plastic_metric(space, &at, &f, end);
    end[alpha] = state[alpha] + f.step;
    for (int k = 0; k <= alpha; ++k)
        end[k] = choose(moved, end[k], state[k]);
    return at.good;
}

INLINE int64_t over_points(int space, const Material *m, int64_t n, const double *F,
                           const double *state, double *P, double *end, double *A, double *energies)
{
    const int count = space ? 9 : 5, size = space ? 7 : 5;
    const ivec always = ~(ivec){};
    ivec bad = {};
    for (int64_t first = 0; first < n; first += LANES) {
        vec f[9], s[7], stress[9], next[7], moduli[81], energy[3];
        load(F, first, n, count, f);
        load(state, first, n, size, s);
        ivec good = update(space, m, f, s, stress, next, A ? moduli : 0, energy);
        store(stress, good, first, n, count, P);
        store(next, always, first, n, size, end);
        for (int k = 0; k < 3; ++k)
            store(energy + k, good, first, n, 1, energies + k * n);
        if (A)
            store(moduli, good, first, n, count * count, A);
        bad |= ~good;
    }
    return any(bad);
}

/* Updates n points; returns whether any was not valid. P (n, p), state at the end (n, s),
 * A (n, p, p) or null, energies (3, n): elastic, dissipation, its numerical part. */
EXPORT int64_t tribox_plastic_plane(const Material *m, int64_t n, const double *F,
                                    const double *state, double *P, double *end, double *A,
                                    double *energies)
{
    return over_points(0, m, n, F, state, P, end, A, energies);
}

EXPORT int64_t tribox_plastic_space(const Material *m, int64_t n, const double *F,
                                    const double *state, double *P, double *end, double *A,
                                    double *energies)
{
    return over_points(1, m, n, F, state, P, end, A, energies);
}
