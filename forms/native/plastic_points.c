/* Material points of finite J2 plasticity, several at a time.
 *
 * The equations are in forms/bodies/elastoplastic.py. Principal axes in space come without iterations over rotations: the
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

/* NEUTRAL: of the yield stress: so little below it a point counts as one that flows; STILL: an
 * overstress that is round-off. SMALL_STEP: relative, after which Newton's next one would be below
 * round-off; ROUNDOFF: of g over the trial stress. SERIES: up to which artanh(z)/z is one, whose
 * rest is below 1e-17. SETTLED: of Σ c and 25 times the trial stress, a change of the rest that is
 * round-off; STEADY: of the step, a change after which the one after the next is. ITERATIONS and TURNS
 * are far beyond need: 4 are usual. */
static const double NEUTRAL = 1e-9, STILL = 1e-11;
static const double SMALL_STEP = 1e-8, ROUNDOFF = 1e-15, SERIES = 0.02, SETTLED = 4e-15;
static const double NEAR = 0.25, TURNING = 1e-2, STEADY = 1e-7; /* of `mean_decay` and of turns */
enum { ITERATIONS = 200, MOST = 8, TURNS = 50 };

typedef struct {
    double shear, bulk, dt, rate_parameters[2];
    int64_t law, rate, count; /* count: points of a table */
    const double *parameters; /* of the law; of a table the strains, then the stresses */
    int64_t branches;         /* of the backstress, at most MOST */
    const double *backstress; /* c and b of each */
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

/* Left of the root for concave laws. */
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
    for (int a = 0; a < 2; ++a)
        at->n[a][2] = at->n[2][a] = at->G[a][2] = at->G[2][a] = all(0.0);
    at->n[2][2] = all(1.0);
    at->G[2][2] = 1.0 / F[4];
}

/* The principal value, times `sign` in [sqrt 3, 2], that is farthest from the other two of a
 * deviator whose squares sum to 6: the largest root of x^3 - 3 x - 2 h, h = |det|/2 in [0, 1], by
 * Newton's method from a polynomial that is right to 1e-5. */
INLINE vec far_value(vec h)
{
    vec x = 1.7320597067184762 + h * (0.3328580367612478 + h * (-0.0920105227157930 +
            h * (0.0352847297756343 - 0.0081988109128235 * h)));
    for (int i = 0; i < 2; ++i)
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

/* The end of the step, see "return mapping" in elastoplastic.py. */
typedef struct {
    vec strain[3], n[3], theta, theta_bar, step, stress, numerical;
} Flow;

/* The sum of c[n] x^n to the twelfth power, in pairs that do not wait for each other. */
INLINE vec twelfth_power_series(const double *c, vec x)
{
    vec square = x * x, fourth = square * square, pair[7];
    for (int n = 0; n < 6; ++n)
        pair[n] = c[2 * n] + c[2 * n + 1] * x;
    pair[6] = all(c[12]);
    vec low = pair[0] + pair[1] * square, middle = pair[2] + pair[3] * square;
    vec high = pair[4] + pair[5] * square + pair[6] * fourth;
    return low + fourth * (middle + fourth * high);
}

/* e^-y, phi and the ratio (φ and (φ − e^−y)/y, φ = (1 − e^−y)/y); where y is small by the series of
 * (1 − φ)/y, which is φ less the ratio. */
INLINE void mean_decay(vec y, vec *decay, vec *phi, vec *ratio)
{
    /* (-1)^n/(n + 2)! */
    static const double REST[] = {1.0 / 2,       -1.0 / 6,        1.0 / 24,        -1.0 / 120,       1.0 / 720,
                                  -1.0 / 5040,   1.0 / 40320,     -1.0 / 362880,   1.0 / 3628800,    -1.0 / 39916800,
                                  1.0 / 479001600, -1.0 / 6227020800, 1.0 / 87178291200};
    ivec far = (ivec)(y >= NEAR);
    vec x = choose(far, all(0.0), y), rest = twelfth_power_series(REST, x);
    *phi = 1.0 - x * rest;
    *ratio = *phi - rest;
    *decay = 1.0 - x * *phi;
    if (!any(far))
        return;
    y = choose(far, y, all(1.0));
    vec z = 1.0 / y, power = exponential(-choose((ivec)(y < 690.0), y, all(690.0))), mean = (1.0 - power) * z;
    *decay = choose(far, power, *decay);
    *phi = choose(far, mean, *phi);
    *ratio = choose(far, (mean - power) * z, *ratio);
}

/* Squares and products of what g of the return mapping is made from, of LANES points. */
typedef struct {
    vec aim, trial, with[MOST], among[MOST][MOST]; /* trial: von Mises stress at no step */
} Products;

/* At a step: the von Mises stress of what is left over `fall`, which is g but for the flow stress;
 * g falls by `slope` but for a share `rise` of 1/size. */
typedef struct {
    vec size, fall, slope, rise;
} Over;

INLINE void over_stress(const Material *m, const Products *p, vec x, const vec *decay, const vec *phi,
                        Over *over)
{
    vec sum = p->aim;
    over->slope = all(3.0 * m->shear);
    over->fall = over->slope * x;
    over->rise = all(0.0);
    if (m->branches == 0) {
        over->size = p->trial;
        return;
    }
    for (int k = 0; k < m->branches; ++k) {
        const double c = m->backstress[2 * k];
        vec others = all(0.0);
        over->fall += c * phi[k] * x;
        over->slope += c * decay[k];
        for (int j = 0; j < m->branches; ++j)
            others += decay[j] * p->among[k][j];
        sum += decay[k] * (others - 2.0 * p->with[k]);
        over->rise += 1.5 * m->backstress[2 * k + 1] * decay[k] * (p->with[k] - others);
    }
    over->size = square_root(1.5 * choose((ivec)(sum > 0.0), sum, all(0.0)));
}

/* Flow stress and its slope over the step; point by point where there is no formula for all. */
INLINE void flow_stresses(const Material *m, vec alpha, vec step, vec *stress, vec *slope)
{
    const double *p = m->parameters;
    vec end = alpha + step;
    if (m->rate == NO_RATE && m->law == LINEAR) {
        *stress = p[0] + p[1] * end;
        *slope = all(p[1]);
    } else if (m->rate == NO_RATE && m->law == VOCE) {
        vec far = choose((ivec)(p[2] * end < 690.0), p[2] * end, all(690.0));
        vec decay = exponential(-far), gain = all(p[1] - p[0]);
        *stress = p[0] + p[3] * end + gain * (1.0 - decay);
        *slope = p[3] + gain * p[2] * decay;
    } else if (m->rate == NO_RATE && m->law == SWIFT) {
        vec sum = p[1] + end;
        *stress = p[0] * exponential(p[2] * logarithm(sum));
        *slope = p[2] * *stress / sum;
    } else {
        for (int l = 0; l < LANES; ++l)
            flow_stress(m, ((const double *)&alpha)[l], ((const double *)&step)[l],
                        (double *)stress + l, (double *)slope + l);
    }
}

/* Yield stress and its slope at a plastic strain. */
INLINE void yields(const Material *m, vec alpha, vec *stress, vec *slope)
{
    Material still = *m;
    still.rate = NO_RATE;
    flow_stresses(&still, alpha, all(0.0), stress, slope);
}

/* Flow stress and its slope over a step, and the yield stress at its end. */
INLINE void end_stresses(const Material *m, vec alpha, vec step, vec *stress, vec *slope, vec *yield)
{
    vec unused;
    flow_stresses(m, alpha, step, stress, slope);
    if (m->rate == NO_RATE)
        *yield = *stress;
    else
        yields(m, alpha + step, yield, &unused);
}

/* Left of the root for concave laws where there is a rate factor, see `start`. */
INLINE vec starts(const Material *m, vec over, vec stress, vec slope)
{
    if (m->rate == NO_RATE)
        return over / (3.0 * m->shear + slope);
    vec x;
    for (int l = 0; l < LANES; ++l)
        ((double *)&x)[l] = start(m, ((double *)&over)[l], ((double *)&stress)[l],
                                  ((double *)&slope)[l]);
    return x;
}

/* One step of Newton's method for g = 0, with e^-y and phi of the branches at x. */
INLINE vec newton(const Material *m, const Products *p, vec alpha, vec x, const vec *decay,
                  const vec *phi, vec *g)
{
    Over over;
    vec stress, slope;
    over_stress(m, p, x, decay, phi, &over);
    flow_stresses(m, alpha, x, &stress, &slope);
    *g = over.size - over.fall - stress;
    if (m->branches == 0)
        return x + *g / (over.slope + slope);
    vec size = choose((ivec)(over.size > 0.0), over.size, all(1.0));
    return x + *g * size / ((over.slope + slope) * size - over.rise);
}

/* The plastic strain of the step that brings the von Mises stress to yield; from x on where that is
 * known, until it moves by a share that is `close`. Without branches the stress falls by 3 G of it. */
INLINE vec plastic_step(const Material *m, Products *p, vec alpha, vec begin, vec rise, ivec done,
                       vec known, double close)
{
    vec trial = p->aim, first = all(0.0), most = square_root(p->aim);
    for (int k = 0; k < m->branches; ++k) {
        vec others = all(0.0);
        for (int j = 0; j < m->branches; ++j)
            others += p->among[k][j];
        trial += others - 2.0 * p->with[k];
        first += 1.5 * m->backstress[2 * k + 1] * (p->with[k] - others);
        most += square_root(p->among[k][k]);
    }
    p->trial = trial = square_root(1.5 * choose((ivec)(trial > 0.0), trial, all(0.0)));
    if (m->branches > 0)
        rise -= first / choose((ivec)(trial > 0.0), trial, all(1.0));
    for (int k = 0; k < m->branches; ++k)
        rise += m->backstress[2 * k];
    rise = choose((ivec)(rise > 0.0), rise, all(0.0));
    vec over = choose((ivec)(trial > (1.0 + STILL) * begin), trial - begin, all(0.0));
    vec low = all(0.0), high = (1.2247448713915890 * most - begin) / (3.0 * m->shear);
    vec x = starts(m, over, begin, rise);
    x = choose((ivec)(known > 0.0) & (ivec)(known < high), known, x);
    x = choose(done, known, x);
    done |= ~(ivec)(x > 0.0);
    for (int i = 0; i < ITERATIONS && any(~done); ++i) {
        vec g, moved, decay[MOST], phi[MOST], unused;
        for (int k = 0; k < m->branches; ++k)
            mean_decay(m->backstress[2 * k + 1] * x, &decay[k], &phi[k], &unused);
        moved = newton(m, p, alpha, x, decay, phi, &g);
        ivec left = (ivec)(g >= 0.0);
        low = choose(left, x, low);
        high = choose(left, high, x);
        ivec settled = (ivec)(absolute(moved - x) <= close * x) |
                       (ivec)(absolute(g) <= ROUNDOFF * trial);
        ivec inside = (ivec)(moved > low) & (ivec)(moved < high);
        vec next = choose(inside | settled, moved, 0.5 * (low + high));
        x = choose(done, x, next);
        done |= settled;
    }
    return x;
}

/* The return mapping of the trial strains `logs`; to `last` if that is not
 * null, the plastic strain that it has led to before. */
INLINE void flow(const Material *m, const vec *logs, vec alpha, const vec *last, Flow *f)
{
    const double three = 3.0 * m->shear;
    vec mean = (logs[0] + logs[1] + logs[2]) * (1.0 / 3.0), end, slope;
    for (int a = 0; a < 3; ++a)
        f->strain[a] = logs[a] - mean;
    vec size = square_root(dot(f->strain, f->strain));
    vec trial = 2.449489742783178 * m->shear * size, begin;
    yields(m, alpha, &begin, &slope);
    ivec flows = (ivec)(trial >= (1.0 - NEUTRAL) * begin);
    if (m->law == LINEAR && m->rate == NO_RATE) {
        ivec over = (ivec)(trial > (1.0 + STILL) * begin);
        f->step = choose(over, (trial - begin) / (three + slope), all(0.0));
        f->stress = end = begin + slope * f->step;
    } else {
        Products alone;
        alone.aim = trial * trial * (2.0 / 3.0);
        if (last)
            f->step = *last - alpha;
        else
            f->step = plastic_step(m, &alone, alpha, begin, slope, ~flows, all(0.0), SMALL_STEP);
        end_stresses(m, alpha, f->step, &f->stress, &slope, &end);
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

/* Moduli, see MODULI of point_lanes.h: by the products of two principal axes, D - 2 tau of each and g of
 * pairs; "tangent" in elastoplastic.py. */
INLINE void tangent(int space, const Material *m, const Axes *at, const Flow *f, const vec *tau,
                    vec *moduli)
{
    const int n = space ? 6 : 4;
    vec M[3][6], S[6], *c = tangent_of(space, moduli);
#pragma GCC unroll 9
    for (int k = 0; k < n; ++k) {
        const int i = PAIRS[k][0], j = PAIRS[k][1];
#pragma GCC unroll 9
        for (int a = 0; a < 3; ++a)
            M[a][k] = at->n[a][i] * at->n[a][j];
        moduli[k] = tau[0] * M[0][k] + tau[1] * M[1][k] + tau[2] * M[2][k];
#pragma GCC unroll 9
        for (int l = 0; l < n; ++l)
            c[k * n + l] = all(0.0);
    }
#pragma GCC unroll 9
    for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3;
        vec D[3], T[6];
#pragma GCC unroll 9
        for (int d = 0; d < 3; ++d)
            D[d] = m->bulk + 2.0 * m->shear * (((a == d) - 1.0 / 3.0) * f->theta -
                                               f->theta_bar * f->n[a] * f->n[d]);
        D[a] -= 2.0 * tau[a];
#pragma GCC unroll 9
        for (int k = 0; k < n; ++k)
            T[k] = D[0] * M[0][k] + D[1] * M[1][k] + D[2] * M[2][k];
#pragma GCC unroll 9
        for (int k = 0; k < n; ++k)
#pragma GCC unroll 9
            for (int l = k; l < n; ++l)
                c[k * n + l] += M[a][k] * T[l];
        if (!space && a > 0) /* no shear across the plane */
            continue;
        vec g = m->shear * f->theta * log_ratio(at->w[a], at->w[b], at->logs[a] - at->logs[b]) -
                0.5 * (tau[a] + tau[b]);
#pragma GCC unroll 9
        for (int k = 0; k < n; ++k) {
            const int i = PAIRS[k][0], j = PAIRS[k][1];
            S[k] = at->n[a][i] * at->n[b][j] + at->n[b][i] * at->n[a][j];
        }
#pragma GCC unroll 9
        for (int k = 0; k < n; ++k) {
            vec by = g * S[k];
#pragma GCC unroll 9
            for (int l = k; l < n; ++l)
                c[k * n + l] += by * S[l];
        }
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

/* Principal axes of F C F^T with half the logarithms of its values; marks the points where it does not
 * exist, whose values are 1. */
INLINE void axes(int space, const vec *F, const vec *C, Axes *at)
{
    if (space)
        axes_in_space(F, C, at);
    else
        axes_in_plane(F, C, at);
    for (int a = 0; a < 3; ++a)
        at->good &= (ivec)(at->w[a] > 0.0) & is_finite(at->w[a]);
#pragma GCC unroll 1
    for (int a = 0; a < 3; ++a) {
        at->w[a] = choose(at->good, at->w[a], all(1.0));
        at->logs[a] = 0.5 * logarithm(at->w[a]);
    }
}

/* See Update of point_lanes.h. */
INLINE void update(int space, const Material *m, const vec *F, const vec *state, vec *P, vec *end,
                   vec *moduli, vec *energies, ivec *good)
{
    const int count = space ? 9 : 5, alpha = space ? 6 : 4;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    vec tau[3], sum = all(0.0);
    Axes at;
    Flow f;
    axes(space, F, state, &at);
    at.good &= is_finite(state[alpha]);
    flow(m, at.logs, state[alpha], moduli && end ? end + alpha : 0, &f);
    vec volume = at.logs[0] + at.logs[1] + at.logs[2];
    for (int a = 0; a < 3; ++a)
        tau[a] = 2.0 * m->shear * f.theta * f.strain[a] + m->bulk * volume;
    *good = at.good & is_finite(f.step);
    if (moduli) {
        tangent(space, m, &at, &f, tau, moduli);
        probe(tau, 3, &sum);
        *good &= is_finite(sum);
        return;
    }
#pragma GCC unroll 1
    for (int p = 0; p < count; ++p) {
        const int i = place[p][0], J = place[p][1];
        P[p] = tau[0] * at.n[0][i] * at.G[0][J] + tau[1] * at.n[1][i] * at.G[1][J] +
               tau[2] * at.n[2][i] * at.G[2][J];
    }
    probe(P, count, &sum);
    *good &= is_finite(sum);
    if (!energies)
        return;
    energies[0] = m->shear * f.theta * f.theta * dot(f.strain, f.strain) +
                  0.5 * m->bulk * volume * volume;
    energies[1] = f.stress * f.step;
    energies[2] = f.numerical;
    ivec moved = *good & (ivec)(f.step > 0.0);
    plastic_metric(space, &at, &f, end);
    end[alpha] = state[alpha] + f.step;
    for (int k = 0; k <= alpha; ++k)
        end[k] = choose(moved, end[k], state[k]);
}

/* -- backstress: see elastoplastic.py ----------------------------------------------------------
 * Tensors stand in the principal axes of the trial deformation, which the end need not share. In
 * the plane those axes are two in it and its normal, and nothing couples them. Of symmetric ones that
 * are kept the upper half is, since storing takes longer than computing. */

/* One branch of the backstress at its end, the tensors without the volume of the strain: metric at
 * the begin, K = E^-1 B^-1 E^-1 but for its size, and B = E K^-1 E. */
typedef struct {
    double modulus, recovery;
    tensor metric, start, X, K, B;
    vec decay, phi, ratio;
} Branch;

/* Deviator e of the elastic strain at the end, E = exp(-e) and its square; 1/w of the begin. */
typedef struct {
    tensor e, E, E2;
    vec begin[3], volume; /* cube root of what the w make together */
} Strain;

/* E and E2 of e. By Cayley and Hamilton e^3 = q e + p 1, with q = tr e^2/2 and p = det e, all powers
 * are p_n 1 + q_n e + r_n e^2. Strains beyond .1, which metals do not bear, are halved. */
INLINE void exponentiate(int space, Strain *at)
{
    tensor e, square;
    vec size = contract(space, at->e, at->e), scale = all(1.0);
    int halved = 0;
    for (; halved < 60 && any((ivec)(size > 0.01)); ++halved) {
        size *= 0.25;
        scale *= 0.5;
    }
    whole_of(space, at->e, e);
    EACH(space, i, j) e[i][j] = halved ? scale * e[i][j] : e[i][j];
    multiply(space, e, e, square);
    vec second = 0.5 * trace(square), third = contract(space, e, square) * (1.0 / 3.0);
    vec p = all(0.0), q = all(0.0), r = all(1.0), a = all(1.0), b = all(-1.0), c = all(0.5);
    double factor = 0.5;
    for (int n = 3; n < 11; ++n) {
        const vec last_p = p, last_q = q;
        p = third * r;
        q = last_p + second * r;
        r = last_q;
        factor /= -n;
        a += factor * p, b += factor * q, c += factor * r;
    }
    UPPER(space, i, j) at->E[i][j] = (i == j ? a : all(0.0)) + b * e[i][j] + c * square[i][j];
    for (; halved > -1; --halved) {
        tensor root;
        whole_of(space, at->E, root);
        multiply(space, root, root, square);
        UPPER(space, i, j) (halved ? at->E : at->E2)[i][j] = square[i][j];
    }
}

/* A branch at a step whose decay is known. */
INLINE void move(int space, const Strain *at, vec step, Branch *k)
{
    tensor K, cofactor, E, B;
    vec end = 1.0 - k->phi, mid = k->recovery * step * k->ratio;
    UPPER(space, a, b) k->K[a][b] = k->decay * k->metric[a][b] + end * at->E2[a][b];
    for (int a = 0; a < 3; ++a)
        k->K[a][a] += mid * at->begin[a];
    whole_of(space, k->K, K);
    whole_of(space, at->E, E);
    vec root = inverse_cube_root_of_ratio(cofactors(space, K, cofactor));
    sandwich(space, E, cofactor, B);
    UPPER(space, a, b) k->B[a][b] = root * root * B[a][b]; /* last: nothing waits for the root */
    vec mean = trace(k->B) * (1.0 / 3.0);
    double shear = k->modulus / 3.0;
    UPPER(space, a, b) k->X[a][b] = shear * (k->B[a][b] - (a == b ? mean : all(0.0)));
}

/* The end of the step, see class Turned. */
typedef struct {
    Strain at;
    tensor nu;
    ivec flows, good;
    vec step, stress, slope, numerical, recovered;
    Products of;
    Branch k[MOST]; /* last, since few are used */
} Turned;

/* |X|^2 b/(2 mu) of all branches. */
INLINE vec recovered(int space, const Material *m, const Turned *t)
{
    vec sum = all(0.0);
    for (int k = 0; k < m->branches; ++k)
        sum += 1.5 * m->backstress[2 * k + 1] / m->backstress[2 * k] *
               contract(space, t->k[k].X, t->k[k].X);
    return sum;
}

/* One turn, first half: the step with the rest held, and the strain at its end. */
INLINE void return_with(int space, const Material *m, const tensor s, const vec *trial, vec alpha, vec begin,
                        vec rise, const tensor rest, ivec done, Turned *t)
{
    tensor over;
    UPPER(space, a, b) over[a][b] = s[a][b] - rest[a][b];
    t->of.aim = contract(space, over, over);
    const vec last = t->step;
    vec unused, near = last, decay[MOST], phi[MOST];
    for (int k = 0; k < m->branches; ++k) {
        t->of.with[k] = contract(space, over, t->k[k].start);
        decay[k] = t->k[k].decay; /* at the last step */
        phi[k] = t->k[k].phi;
    }
    ivec known = (ivec)(last > 0.0) | done;
    if (!any(~known)) {
        near = newton(m, &t->of, alpha, last, decay, phi, &unused);
        known = (ivec)(absolute(near - last) <= TURNING * last) | done;
    }
    if (any(~known))
        t->step = plastic_step(m, &t->of, alpha, begin, rise, done, last, TURNING);
    else
        t->step = choose(done, last, near); /* that is all it would do */
    for (int k = 0; k < m->branches; ++k) {
        Branch *own = t->k + k;
        mean_decay(own->recovery * t->step, &own->decay, &own->phi, &own->ratio);
        UPPER(space, a, b) over[a][b] -= own->decay * own->start[a][b];
    }
    vec size = square_root(contract(space, over, over));
    vec scale = 1.0 / choose((ivec)(size > 0.0), size, all(1.0)), flown = 1.2247448713915890 * t->step;
    UPPER(space, a, b)
    {
        t->nu[a][b] = over[a][b] * scale;
        t->at.e[a][b] = (a == b ? trial[a] : all(0.0)) - flown * t->nu[a][b];
    }
}

/* Which points have settled, which will have with the next strain, and the square of the last change. */
typedef struct {
    ivec done, close;
    vec change;
} Settling;

/* Second half: the branches there, and the rest anew of the points that have not settled. */
INLINE void find_rest(int space, const Material *m, vec last, Turned *t, tensor rest, Settling *of)
{
    tensor sum = {}, d;
    double moduli = 0.0;
    exponentiate(space, &t->at);
    for (int k = 0; k < m->branches; ++k) {
        Branch *own = t->k + k;
        move(space, &t->at, t->step, own);
        vec straight = 0.8164965809277260 * own->modulus * own->phi * t->step;
        UPPER(space, a, b)
        sum[a][b] += own->X[a][b] - own->decay * own->start[a][b] - straight * t->nu[a][b];
        moduli += own->modulus;
    }
    if (!any(~of->done))
        return;
    UPPER(space, a, b) d[a][b] = sum[a][b] - rest[a][b];
    vec change = contract(space, d, d), bound = SETTLED * (25.0 * square_root(1.5 * t->of.aim) + moduli);
    vec moved = absolute(t->step - last) - bound * (1.0 / (3.0 * m->shear));
    bound *= bound;
    of->done |= (ivec)(change <= bound) & (ivec)(moved <= SMALL_STEP * t->step);
    /* the next change is to this one what this one is to the last, about */
    of->close = of->done | ((ivec)(change * change <= bound * of->change) & (ivec)(moved <= STEADY * t->step));
    of->change = change;
    UPPER(space, a, b) rest[a][b] = choose(of->done, rest[a][b], sum[a][b]);
}

/* The branches at the begin of the step; t->nu is then s less the sum of their stress. */
INLINE void begin_turning(int space, const Material *m, const Axes *axes, const vec *state, Turned *t)
{
    const int count = space ? 6 : 4;
    vec w = axes->w[0] * axes->w[1] * axes->w[2], r = inverse_cube_root_of_ratio(w), square = r * r;
    vec volume = t->at.volume = w * square;
    for (int a = 0; a < 3; ++a)
        t->at.begin[a] = axes->w[(a + 1) % 3] * axes->w[(a + 2) % 3] * square;
    UPPER(space, a, b)
    {
        t->at.E2[a][b] = a == b ? t->at.begin[a] : all(0.0);
        t->at.E[a][b] = a == b ? square_root(t->at.begin[a]) : all(0.0);
    }
    for (int k = 0; k < m->branches; ++k) {
        const vec *C = state + count * (1 + k);
        Branch *own = t->k + k;
        tensor inner;
        own->modulus = m->backstress[2 * k];
        own->recovery = m->backstress[2 * k + 1];
        symmetric_of(space, C, inner);
        EACH(space, a, b) inner[a][b] = choose(axes->good, inner[a][b], all(a == b)) * volume;
        sandwich(space, axes->G, inner, own->metric);
        own->decay = own->phi = all(1.0);
        own->ratio = all(0.5);
        move(space, &t->at, all(0.0), own);
        UPPER(space, a, b)
        {
            own->start[a][b] = own->X[a][b];
            t->nu[a][b] -= own->X[a][b];
        }
        for (int j = 0; j <= k; ++j)
            t->of.among[k][j] = t->of.among[j][k] = contract(space, own->start, t->k[j].start);
    }
}

/* flow_with_backstress: the trial state returned to yield. */
INLINE void flow_turning(int space, const Material *m, const Axes *axes, const vec *state, Turned *t)
{
    const vec alpha = state[(space ? 6 : 4) * (1 + m->branches)];
    const vec mean = (axes->logs[0] + axes->logs[1] + axes->logs[2]) * (1.0 / 3.0);
    tensor s, rest = {};
    vec trial[3], begin, rise, end, unused;
    for (int a = 0; a < 3; ++a)
        trial[a] = axes->logs[a] - mean;
    UPPER(space, a, b)
    {
        t->at.e[a][b] = a == b ? trial[a] : all(0.0);
        t->nu[a][b] = s[a][b] = 2.0 * m->shear * t->at.e[a][b];
    }
    begin_turning(space, m, axes, state, t);
    t->step = all(0.0);
    t->good = ~(ivec){};
    vec q = square_root(1.5 * contract(space, t->nu, t->nu)), lost = recovered(space, m, t);
    yields(m, alpha, &begin, &rise);
    t->flows = (ivec)(q >= (1.0 - NEUTRAL) * begin) & axes->good;
    vec scale = 1.2247448713915890 / choose((ivec)(q > 0.0), q, all(1.0));
    UPPER(space, a, b) t->nu[a][b] *= scale;
    if (any(t->flows)) {
        Settling of = {~t->flows, ~t->flows, all(0.0)};
        for (int i = 0; i < TURNS && any(~of.done); ++i) {
            const vec last = t->step;
            return_with(space, m, s, trial, alpha, begin, rise, rest, of.done, t);
            of.done = of.close;
            find_rest(space, m, last, t, rest, &of);
        }
        t->good = of.done;
    }
    end_stresses(m, alpha, t->step, &t->stress, &t->slope, &end);
    t->recovered = recovered(space, m, t);
    t->numerical = 0.5 * t->step * (t->stress / end * (end - begin) + t->recovered - lost);
}

/* -- moduli of metals with backstress, where an update has led to before, by the axes of the strain there --
 * Deviators have five components there, three in the plane: by (1, -1, 0)/sqrt 2 and (1, 1, -2)/sqrt 6 of
 * the axes, and by the shears 12, 23, 13. */

#define DEVIATORS(space) ((space) ? 5 : 3)
static const double ROOT_HALF = 0.7071067811865476, ROOT_SIXTH = 0.4082482904638630;

/* The end of a step: axes and their values of F C_p^-1 F^T, the deviator of the strain and E = exp(-e)
 * with its square; 1/b of the begin without its volume, and the cube root of what the w make together. */
typedef struct {
    Axes at;
    tensor begin;
    vec values[3], E[3], E2[3], volume, step;
} Ended;

/* What the branches add up to over 2 G: X, what it changes by with the step, and with each component of D
 * alone, where dE + E d = D E. */
typedef struct {
    vec X[5], rise[5], U[9][5];
} Changes;

/* Adds the components of `scale` times a symmetric tensor. */
INLINE void add_deviator(int space, const tensor a, double scale, vec *to)
{
    to[0] += (scale * ROOT_HALF) * (a[0][0] - a[1][1]);
    to[1] += (scale * ROOT_SIXTH) * ((a[0][0] + a[1][1]) - 2.0 * a[2][2]);
    for (int k = 2; k < DEVIATORS(space); ++k)
        to[k] += (scale * 2.0 * ROOT_HALF) * a[PAIRS[k + 1][0]][PAIRS[k + 1][1]];
}

INLINE void end_of_step(int space, const vec *F, const vec *state, const vec *end, int alpha, Ended *t)
{
    tensor C, inverse;
    axes(space, F, end, &t->at);
    const vec *w = t->at.w, mean = (t->at.logs[0] + t->at.logs[1] + t->at.logs[2]) * (1.0 / 3.0);
    vec all_w = w[0] * w[1] * w[2], root = inverse_cube_root_of_ratio(all_w), square = root * root;
    t->volume = all_w * square;
    for (int a = 0; a < 3; ++a) {
        t->values[a] = t->at.logs[a] - mean;
        t->E2[a] = w[(a + 1) % 3] * w[(a + 2) % 3] * square;
        t->E[a] = square_root(t->E2[a]);
    }
    symmetric_of(space, state, C);
    cofactors(space, C, inverse);
    sandwich(space, t->at.G, inverse, t->begin);
    t->step = end[alpha] - state[alpha];
}

/* Adds a branch, of c and b, from C_pi at the begin. */
INLINE void add_branch(int space, const Ended *t, const double *backstress, double per, const vec *from,
                       Changes *sum)
{
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    const double scale = backstress[0] / 3.0 * per, recovery = backstress[1];
    vec decay, phi, ratio;
    tensor C, metric, K, rise, inner, turned, B, J, dB;
    mean_decay(recovery * t->step, &decay, &phi, &ratio);
    symmetric_of(space, from, C);
    sandwich(space, t->at.G, C, metric);
    const vec mid = recovery * t->step * ratio * t->volume, by = recovery * (decay - ratio) * t->volume;
    const vec old = decay * t->volume, fall = recovery * old;
    UPPER(space, a, b)
    {
        K[a][b] = old * metric[a][b] + mid * t->begin[a][b];
        rise[a][b] = by * t->begin[a][b] - fall * metric[a][b];
        if (a == b) {
            K[a][a] += (1.0 - phi) * t->E2[a];
            rise[a][a] += recovery * ratio * t->E2[a];
        }
    }
    mirror(space, K);
    mirror(space, rise);
    vec root = inverse_cube_root_of_ratio(cofactors(space, K, inner)), end = (1.0 - phi) * root;
    EACH(space, a, b) inner[a][b] *= root * root;
    sandwich(space, inner, rise, turned);
    vec growth = contract(space, inner, rise) * root * (1.0 / 3.0);
    UPPER(space, a, b)
    {
        vec both = t->E[a] * t->E[b];
        B[a][b] = both * inner[a][b];
        J[a][b] = (a == b ? all(1.0) : all(0.0)) - end * B[a][b];
        turned[a][b] = growth * B[a][b] - root * both * turned[a][b];
    }
    mirror(space, B);
    mirror(space, J);
    add_deviator(space, B, scale, sum->X);
    add_deviator(space, turned, scale, sum->rise);
#pragma GCC unroll 9
    for (int p = 0; p < (space ? 9 : 5); ++p) {
        const int i = place[p][0], j = place[p][1];
        vec size = 2.0 / 3.0 * end * B[i][j];
        UPPER(space, a, b)
        {
            dB[a][b] = size * B[a][b];
            if (COUPLED(space, a, i))
                dB[a][b] += J[i][a] * B[j][b] + J[i][b] * B[j][a];
        }
        add_deviator(space, dB, scale, sum->U[p]);
    }
}

/* y of W y = R, (count, count) each by rows; R becomes y. W is near to 1. */
INLINE void solve(int count, vec *W, vec *R)
{
    vec inverse[5];
#pragma GCC unroll 9
    for (int k = 0; k < count; ++k) {
        inverse[k] = 1.0 / W[k * count + k];
#pragma GCC unroll 9
        for (int i = k + 1; i < count; ++i) {
            vec by = W[i * count + k] * inverse[k];
#pragma GCC unroll 9
            for (int j = k + 1; j < count; ++j)
                W[i * count + j] -= by * W[k * count + j];
#pragma GCC unroll 9
            for (int j = 0; j < count; ++j)
                R[i * count + j] -= by * R[k * count + j];
        }
    }
#pragma GCC unroll 9
    for (int k = count - 1; k >= 0; --k)
#pragma GCC unroll 9
        for (int j = 0; j < count; ++j) {
            vec sum = R[k * count + j];
#pragma GCC unroll 9
            for (int i = k + 1; i < count; ++i)
                sum -= W[k * count + i] * R[i * count + j];
            R[k * count + j] = sum * inverse[k];
        }
}

/* What X changes by with the strain and with d, each component of deviators alone: X_e and X_d. */
INLINE void by_strain(int space, const Ended *t, const Changes *of, vec X_e[5][5], vec X_d[5][5])
{
    static const int NUMBER[2][3][3] = {{{0, 1, 0}, {2, 3, 0}, {0, 0, 4}}, {{0, 1, 2}, {3, 4, 5}, {6, 7, 8}}};
    const int count = DEVIATORS(space), last = space ? 8 : 4, second = space ? 4 : 3;
    for (int k = 0; k < count; ++k) {
        X_d[0][k] = ROOT_HALF * (of->U[0][k] - of->U[second][k]);
        X_d[1][k] = ROOT_SIXTH * ((of->U[0][k] + of->U[second][k]) - 2.0 * of->U[last][k]);
        X_e[0][k] = -X_d[0][k];
        X_e[1][k] = -X_d[1][k];
    }
    for (int j = 2; j < count; ++j) {
        const int a = PAIRS[j + 1][0], b = PAIRS[j + 1][1], c = 3 - a - b;
        /* one over E_b is what the other two make together */
        const vec one = ROOT_HALF * (t->E[a] * t->E[a] * t->E[c]), other = ROOT_HALF * (t->E[b] * t->E[b] * t->E[c]);
        const vec part = -0.5 / log_ratio(t->E[a], t->E[b], 0.5 * (t->values[b] - t->values[a]));
        const vec by_one = part * (one + ROOT_HALF), by_other = part * (other + ROOT_HALF);
        const vec *u = of->U[NUMBER[space][a][b]], *v = of->U[NUMBER[space][b][a]];
        for (int k = 0; k < count; ++k) {
            X_e[j][k] = by_one * u[k] + by_other * v[k];
            X_d[j][k] = one * u[k] + other * v[k];
        }
    }
}

/* The trial strain e turns with d: it changes by d + r^T more d, d by its deviator. With [e, d] = r d the
 * change is f([e, [e, d]]), f(x^2) = x coth x: more = g(r r^T) r, f(y) = 1 + y g(y). */
INLINE void trial_changes(int space, const vec *e, vec r[3][5], vec more[3][5])
{
    static const double SERIES_OF_COTH[] = {1.0 / 3,       -1.0 / 45,          2.0 / 945,       -1.0 / 4725,
                                            2.0 / 93555,   -1382.0 / 638512875, 4.0 / 18243225, -3617.0 / 162820783125.0};
    enum { KNOWN = 8, NEAR_TERMS = 4, FAR_TERMS = 30 }; /* far: with the poles at x = pi i apart */
    static const double SQUARE_OF_PI = 9.869604401089358;
    const int count = DEVIATORS(space), shears = space ? 3 : 1;
    const vec zero = all(0.0), h1 = ROOT_HALF * e[0], h2 = 1.224744871391589 * e[1], h12 = ROOT_HALF * e[2];
    const vec h23 = space ? ROOT_HALF * e[3] : zero, h13 = space ? ROOT_HALF * e[4] : zero;
    const vec rows[3][5] = {{-2.0 * h12, zero, 2.0 * h1, h13, -h23},
                            {h23, -1.7320508075688772 * h23, -h13, h2 - h1, h12},
                            {-h13, -1.7320508075688772 * h13, -h23, h12, h1 + h2}};
    vec M[3][3], g[3][3], size = zero;
    for (int k = 0; k < shears; ++k) {
        for (int j = 0; j < count; ++j)
            r[k][j] = rows[k][j];
        for (int l = k; l < shears; ++l) {
            M[k][l] = zero;
            for (int j = 0; j < count; ++j)
                M[k][l] += rows[k][j] * rows[l][j];
            M[l][k] = M[k][l];
            g[k][l] = g[l][k] = zero;
        }
        size += M[k][k];
    }
    const int far = any((ivec)(size > 0.01)), terms = far ? FAR_TERMS : NEAR_TERMS;
    double c[FAR_TERMS], pole = far ? 2.0 / SQUARE_OF_PI : 0.0, second = 0.5 / SQUARE_OF_PI;
    for (int n = 0; n < terms; ++n) {
        c[n] = n < KNOWN ? SERIES_OF_COTH[n] - pole : second;
        pole /= -SQUARE_OF_PI, second /= -4.0 * SQUARE_OF_PI;
    }
    for (int n = terms - 1; n >= 0; --n) {
        vec next[3][3];
        for (int k = 0; k < shears; ++k)
            for (int l = k; l < shears; ++l) {
                next[k][l] = k == l ? all(c[n]) : zero;
                for (int j = 0; j < shears; ++j)
                    next[k][l] += M[k][j] * g[j][l];
            }
        for (int k = 0; k < shears; ++k)
            for (int l = k; l < shears; ++l)
                g[k][l] = g[l][k] = next[k][l];
    }
    for (int k = 0; far && k < shears; ++k)
        M[k][k] += SQUARE_OF_PI;
    if (far && space) {
        tensor inverse;
        vec by = 2.0 / cofactors(1, M, inverse);
        EACH(1, k, l) g[k][l] += by * inverse[k][l];
    } else if (far) {
        g[0][0] += 2.0 / M[0][0];
    }
    for (int k = 0; k < shears; ++k)
        for (int j = 0; j < count; ++j) {
            more[k][j] = g[k][0] * rows[0][j];
            for (int l = 1; l < shears; ++l)
                more[k][j] += g[k][l] * rows[l][j];
        }
}

/* What the strain at the end changes by with d (count, count), deviators both; see "tangent" in
 * elastoplastic.py. */
INLINE void turned_moduli(int space, const Material *m, const Ended *t, const Changes *of, vec alpha, vec *c)
{
    const int count = DEVIATORS(space), shears = space ? 3 : 1;
    const double two = 2.0 * m->shear;
    vec W[25], y[25], X_e[5][5], X_d[5][5], r[3][5], more[3][5], nu[5], trial[5] = {}, end, stress, slope;
    vec size = all(0.0);
    for (int a = 0; a < 2; ++a)
        trial[a] = a ? ROOT_SIXTH * (t->values[0] + t->values[1] - 2.0 * t->values[2])
                     : ROOT_HALF * (t->values[0] - t->values[1]);
    for (int k = 0; k < count; ++k) {
        nu[k] = trial[k] - of->X[k];
        size += nu[k] * nu[k];
    }
    size = square_root(size);
    end_stresses(m, alpha, t->step, &stress, &slope, &end);
    const ivec flows = (ivec)(1.224744871391589 * two * size >= (1.0 - NEUTRAL) * end) | (ivec)(t->step > 0.0);
    const vec scale = 1.0 / choose((ivec)(size > 0.0), size, all(1.0)), flown = 1.224744871391589 * t->step;
    for (int k = 0; k < count; ++k) {
        nu[k] *= scale;
        trial[k] += flown * nu[k];
    }
    by_strain(space, t, of, X_e, X_d);
    trial_changes(space, trial, r, more);
    const vec part = two * flown, none = all(0.0);
    const vec across_it = choose(flows, part / (part + 0.8164965809277260 * stress), none);
    const vec onward = choose(flows, 1.0 / (1.0 + slope * (1.0 / (1.5 * two))), none), further = onward - across_it;
#pragma GCC unroll 9
    for (int i = 0; i < count; ++i) {
        vec row[5], along = none, sum[3] = {};
#pragma GCC unroll 9
        for (int j = 0; j < count; ++j)
            along += X_e[j][i] * nu[j];
        along = further * along - 0.8164965809277260 * (onward * of->rise[i]);
#pragma GCC unroll 9
        for (int j = 0; j < count; ++j) {
            W[i * count + j] = (i == j ? all(1.0) : none) - across_it * X_e[j][i] - along * nu[j];
            row[j] = (i == j ? all(1.0) : none) - X_e[j][i];
#pragma GCC unroll 9
            for (int k = 0; k < shears; ++k)
                sum[k] += row[j] * r[k][j];
        }
#pragma GCC unroll 9
        for (int j = 0; j < count; ++j) {
            vec *to = y + i * count + j;
            *to = row[j] - X_d[j][i];
#pragma GCC unroll 9
            for (int k = 0; k < shears; ++k)
                *to += sum[k] * more[k][j];
        }
    }
    solve(count, W, y);
#pragma GCC unroll 9
    for (int j = 0; j < count; ++j) {
        vec sum = none;
#pragma GCC unroll 9
        for (int i = 0; i < count; ++i)
            sum += nu[i] * y[i * count + j];
        sum *= further;
#pragma GCC unroll 9
        for (int i = 0; i < count; ++i) {
            vec to = (i == j ? all(1.0) : none) - across_it * y[i * count + j] - nu[i] * sum;
#pragma GCC unroll 9
            for (int k = 0; k < shears; ++k)
                to += r[k][i] * more[k][j];
            c[i * count + j] = to;
        }
    }
}

/* Whether a component of deviators has a part in one of tensors, in the plane. */
#define CARRIED(space, i, k) ((space) || ((i) == 1 ? (k) < 3 : (k) != 2))

/* c and tau, see MODULI of point_lanes.h, from what the strain's deviator changes by with that of d and the
 * principal stresses: c d is what dtau is but for the change d tau + tau d of place. */
INLINE void by_place(int space, const Material *m, const Axes *at, const vec *tau, const vec *c, vec *moduli)
{
    const int n = space ? 6 : 4, count = DEVIATORS(space);
    vec M[5][6], square[3][6], along[5][6], *to = tangent_of(space, moduli);
#pragma GCC unroll 9
    for (int k = 0; k < n; ++k) {
        const int p = PAIRS[k][0], q = PAIRS[k][1];
#pragma GCC unroll 9
        for (int a = 0; a < 3; ++a)
            square[a][k] = at->n[a][p] * at->n[a][q];
        moduli[k] = tau[0] * square[0][k] + tau[1] * square[1][k] + tau[2] * square[2][k];
        M[0][k] = ROOT_HALF * (square[0][k] - square[1][k]);
        /* the three make 1 together */
        M[1][k] = 3.0 * ROOT_SIXTH * ((k < 3 ? all(1.0 / 3.0) : all(0.0)) - square[2][k]);
#pragma GCC unroll 9
        for (int i = 2; i < count; ++i) {
            const int a = PAIRS[i + 1][0], b = PAIRS[i + 1][1];
            M[i][k] = ROOT_HALF * (at->n[a][p] * at->n[b][q] + at->n[b][p] * at->n[a][q]);
        }
    }
#pragma GCC unroll 9
    for (int i = 0; i < count; ++i)
#pragma GCC unroll 9
        for (int k = 0; k < n; ++k) {
            along[i][k] = all(0.0);
#pragma GCC unroll 9
            for (int j = 0; j < count; ++j)
                if (CARRIED(space, j, k))
                    along[i][k] += c[count * i + j] * M[j][k];
            along[i][k] *= 2.0 * m->shear;
        }
#pragma GCC unroll 9
    for (int k = 0; k < n; ++k)
#pragma GCC unroll 9
        for (int l = 0; l < n; ++l) {
            const int i = PAIRS[k][0], j = PAIRS[k][1], p = PAIRS[l][0], q = PAIRS[l][1];
            vec sum = all(k < 3 && l < 3 ? m->bulk : 0.0);
#pragma GCC unroll 9
            for (int of = 0; of < count; ++of)
                if (CARRIED(space, of, k))
                    sum += M[of][k] * along[of][l];
            if (i == p)
                sum -= 0.5 * moduli[NUMBER[j][q]];
            if (i == q)
                sum -= 0.5 * moduli[NUMBER[j][p]];
            if (j == p)
                sum -= 0.5 * moduli[NUMBER[i][q]];
            if (j == q)
                sum -= 0.5 * moduli[NUMBER[i][p]];
            to[n * k + l] = sum;
        }
}

/* C_p^-1, C_pi and alpha at the end of the step. */
INLINE void turned_state(int space, const Material *m, const Axes *at, const Turned *t,
                         const vec *F, const vec *state, vec *end)
{
    const int count = space ? 6 : 4;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    tensor H = {}, E2, square, part;
    whole_of(space, t->at.E2, E2);
    cofactors(space, E2, square); /* exp(2 e) but for the volume */
    for (int p = 0; p < (space ? 9 : 5); ++p)
        for (int a = 0; a < 3; ++a)
            if (COUPLED(space, a, place[p][0]))
                H[a][place[p][1]] += at->n[a][place[p][0]] * F[p];
    for (int k = -1; k < m->branches; ++k) {
        tensor K, transposed, whole, unused;
        const vec(*to)[3] = k < 0 ? at->G : H;
        EACH(space, a, b) transposed[b][a] = to[a][b];
        whole_of(space, k < 0 ? square : t->k[k].K, K);
        multiply(space, K, to, part);
        multiply(space, transposed, part, whole);
        vec scale = k < 0 ? t->at.volume : inverse_cube_root_of_ratio(cofactors(space, whole, unused));
        for (int i = 0; i < count; ++i)
            end[count * (k + 1) + i] = whole[PAIRS[i][0]][PAIRS[i][1]] * scale;
    }
    const int alpha = count * (1 + m->branches);
    end[alpha] = state[alpha] + t->step;
}

/* Moduli at the end of a step that an update has led to. */
INLINE void moduli_turning(int space, const Material *m, const vec *F, const vec *state, const vec *end,
                           vec *moduli, ivec *good)
{
    const int size = space ? 6 : 4, alpha = size * (int)(1 + m->branches), count = DEVIATORS(space);
    vec sum = all(0.0), c[25], tau[3];
    Ended t;
    Changes of;
#pragma GCC unroll 9
    for (int k = 0; k < count; ++k) {
        of.X[k] = of.rise[k] = sum;
#pragma GCC unroll 9
        for (int p = 0; p < (space ? 9 : 5); ++p)
            of.U[p][k] = sum;
    }
    end_of_step(space, F, state, end, alpha, &t);
    for (int k = 0; k < m->branches; ++k)
        add_branch(space, &t, m->backstress + 2 * k, 0.5 / m->shear, state + size * (1 + k), &of);
    turned_moduli(space, m, &t, &of, state[alpha], c);
    probe(c, count * count, &sum);
    for (int a = 0; a < 3; ++a)
        tau[a] = 2.0 * m->shear * t.values[a] + m->bulk * (t.at.logs[0] + t.at.logs[1] + t.at.logs[2]);
    probe(tau, 3, &sum);
    by_place(space, m, &t.at, tau, c, moduli);
    *good &= t.at.good & is_finite(sum);
}

/* The update of a step. */
INLINE void return_turning(int space, const Material *m, const vec *F, const vec *state, vec *P, vec *end,
                           vec *energies, ivec *good)
{
    const int count = space ? 9 : 5, alpha = (space ? 6 : 4) * (int)(1 + m->branches);
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    vec sum = all(0.0);
    tensor tau, half, whole, transposed;
    Axes at;
    Turned t;
    axes(space, F, state, &at);
    for (int k = 0; k <= alpha; ++k)
        at.good &= is_finite(state[k]);
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i)
            at.G[a][i] = choose(at.good, at.G[a][i], all(a == i));
    flow_turning(space, m, &at, state, &t);
    vec volume = at.logs[0] + at.logs[1] + at.logs[2];
    vec stored = 0.5 * m->bulk * volume * volume;
    stored += m->shear * contract(space, t.at.e, t.at.e);
    UPPER(space, a, b) tau[a][b] = 2.0 * m->shear * t.at.e[a][b] + (a == b ? m->bulk * volume : all(0.0));
    mirror(space, tau);
    EACH(space, a, b) transposed[b][a] = at.n[a][b];
    multiply(space, tau, at.G, half);
    multiply(space, transposed, half, whole);
    for (int p = 0; p < count; ++p)
        P[p] = whole[place[p][0]][place[p][1]];
    probe(P, count, &sum);
    *good = at.good & t.good & is_finite(t.step) & is_finite(sum);
    if (!end)
        return;
    for (int k = 0; k < m->branches; ++k)
        stored += 0.5 / 3.0 * t.k[k].modulus * (trace(t.k[k].B) - 3.0);
    energies[0] = stored;
    energies[1] = (t.stress + t.recovered) * t.step;
    energies[2] = t.numerical;
    ivec moved = *good & (ivec)(t.step > 0.0);
    turned_state(space, m, &at, &t, F, state, end);
    for (int k = 0; k <= alpha; ++k)
        end[k] = choose(moved, end[k], state[k]);
}

/* `update` where the material hardens kinematically. */
INLINE void update_turning(int space, const Material *m, const vec *F, const vec *state, vec *P,
                           vec *end, vec *moduli, vec *energies, ivec *good)
{
    vec found[6 * (1 + MOST) + 1], P_there[9], unused[ENERGIES];
    *good = ~(ivec){};
    if (!moduli || !end)
        return_turning(space, m, F, state, moduli ? P_there : P, moduli ? found : end,
                       moduli ? unused : energies, good);
    if (moduli)
        moduli_turning(space, m, F, state, end ? end : found, moduli, good);
}

KERNEL(plastic_plane, 0, update)
KERNEL(plastic_space, 1, update)
KERNEL(turning_plane, 0, update_turning)
KERNEL(turning_space, 1, update_turning)
