/* Sums of powers of the isochoric principal stretches in space, smooth where stretches coincide.
 *
 * The sum of lambda^alpha is tr exp(alpha/2 ln C): the logarithm by square roots, the series of artanh
 * Z, Z = (A - 1)(A + 1)^-1 of the small A, and Newton's identities; the exponential by a series with
 * A^3 = (t_2/2) A + (t_3/3) 1 for its traces, and squarings, by which I1 becomes I1^2 - 2 I2 and I2
 * becomes I2^2 - 2 I1. All of it is done on invariants. Value and both derivatives are right to 1e-12
 * while the stretches or their inverses are at most 4 and |alpha| at most 10, to 1e-9 up to 8; at
 * |alpha| = 20 to 1e-10 up to 3. */

/* A function of two variables at a point, with its first and second derivatives. */
typedef struct {
    vec value, x, y, xx, xy, yy;
} Jet;

INLINE Jet constant(vec value)
{
    return (Jet){.value = value};
}

INLINE Jet weighted_sum(double a, Jet f, double b, Jet g)
{
    return (Jet){a * f.value + b * g.value, a * f.x + b * g.x,    a * f.y + b * g.y,
                 a * f.xx + b * g.xx,       a * f.xy + b * g.xy, a * f.yy + b * g.yy};
}

INLINE Jet product(Jet f, Jet g)
{
    return (Jet){f.value * g.value,
                 f.x * g.value + f.value * g.x,
                 f.y * g.value + f.value * g.y,
                 f.xx * g.value + 2.0 * f.x * g.x + f.value * g.xx,
                 f.xy * g.value + f.x * g.y + f.y * g.x + f.value * g.xy,
                 f.yy * g.value + 2.0 * f.y * g.y + f.value * g.yy};
}

/* f(u, v) of functions u, v, at whose values f was taken. */
INLINE Jet compose(Jet f, Jet u, Jet v)
{
    return (Jet){f.value,
                 f.x * u.x + f.y * v.x,
                 f.x * u.y + f.y * v.y,
                 f.x * u.xx + f.y * v.xx + f.xx * u.x * u.x + 2.0 * f.xy * u.x * v.x + f.yy * v.x * v.x,
                 f.x * u.xy + f.y * v.xy + f.xx * u.x * u.y + f.xy * (u.x * v.y + u.y * v.x) +
                     f.yy * v.x * v.y,
                 f.x * u.yy + f.y * v.yy + f.xx * u.y * u.y + 2.0 * f.xy * u.y * v.y + f.yy * v.y * v.y};
}

/* i1 - 3 and i2 - 3 of the root of a tensor of determinant 1, from u = I1 - 3 and v = I2 - 3 of this:
 * p (p + 6) = u + 2 q and q (q + 6) = v + 2 p, by Newton's method; derivatives by differentiating. */
INLINE void root_excess(Jet *u, Jet *v)
{
    const vec x = u->value, y = v->value;
    vec q = square_root(y + 3.0 + 2.0 * square_root(x + 3.0 + 2.0 * square_root(y + 3.0 + 2.0 * square_root(x + 9.0))));
    vec p = square_root(x + 3.0 + 2.0 * q) - 3.0;
    q -= 3.0;
#pragma GCC unroll 1
    for (int step = 0; step < 3; ++step) {
        vec f = p * (p + 6.0) - 2.0 * q - x, g = q * (q + 6.0) - 2.0 * p - y;
        vec d = 0.5 / ((p + 3.0) * (q + 3.0) - 1.0), change = (q + 3.0) * f + g;
        q -= (f + (p + 3.0) * g) * d;
        p -= change * d;
    }
    const vec d = 1.0 / ((p + 3.0) * (q + 3.0) - 1.0), a = p + 3.0, b = q + 3.0;
    Jet P = {p, 0.5 * d * b, 0.5 * d}, Q = {q, 0.5 * d, 0.5 * d * a};
    vec pp = P.x * P.x, qq = Q.x * Q.x;
    P.xx = -d * (b * pp + qq), Q.xx = -d * (pp + a * qq);
    pp = P.x * P.y, qq = Q.x * Q.y;
    P.xy = -d * (b * pp + qq), Q.xy = -d * (pp + a * qq);
    pp = P.y * P.y, qq = Q.y * Q.y;
    P.yy = -d * (b * pp + qq), Q.yy = -d * (pp + a * qq);
    P = compose(P, *u, *v);
    Q = compose(Q, *u, *v);
    *u = P, *v = Q;
}

enum { ROOTS = 3, HIGHEST = 20, DOUBLINGS = 4, EXPONENTIAL_TERMS = 16 };

/* Taylor coefficients of artanh(z)^2 and artanh(z)^3. */
static const double ARTANH[2][HIGHEST] = {
    {0, 0, 1.0, 0, 2.0 / 3, 0, 23.0 / 45, 0, 44.0 / 105, 0, 563.0 / 1575, 0, 3254.0 / 10395, 0,
     88069.0 / 315315, 0, 11384.0 / 45045, 0, 1593269.0 / 6891885, 0},
    {0, 0, 0, 1.0, 0, 1.0, 0, 14.0 / 15, 0, 818.0 / 945, 0, 141.0 / 175, 0, 13063.0 / 17325, 0,
     16774564.0 / 23648625, 0, 1057052.0 / 1576575, 0, 4651811.0 / 7309575}};

/* Traces of H^2 and H^3, H = ln C, as functions of x = I1 - 3 and y = I2 - 3 of C. */
INLINE void logarithm_traces(vec x, vec y, Jet *square, Jet *cube)
{
    Jet u = {x, all(1.0)}, v = {y, all(0.0), all(1.0)}, trace[3];
#pragma GCC unroll 1
    for (int root = 0; root < ROOTS; ++root)
        root_excess(&u, &v);
    const double scale = 2 << ROOTS;
    const vec b = 1.0 / (u.value + v.value + 8.0), bb = -b * b, bbb = -2.0 * bb * b;
    const Jet reciprocal = compose((Jet){b, bb, bb, bbb, bbb, bbb}, u, v);
    const Jet e1 = product(weighted_sum(1.0, v, -1.0, u), reciprocal);
    const Jet e2 = product(weighted_sum(-1.0, u, -1.0, v), reciprocal);
    trace[0] = constant(all(3.0)), trace[1] = e1, trace[2] = weighted_sum(1.0, product(e1, e1), -2.0, e2);
    *square = weighted_sum(scale * scale, trace[2], 0.0, e1);
    *cube = constant(all(0.0));
#pragma GCC unroll 1
    for (int n = 3; n < HIGHEST; ++n) {
        Jet next = product(e1, weighted_sum(1.0, trace[2], -1.0, trace[0]));
        next = weighted_sum(1.0, next, -1.0, product(e2, trace[1]));
        trace[0] = trace[1], trace[1] = trace[2], trace[2] = next;
        *square = weighted_sum(1.0, *square, scale * scale * ARTANH[0][n], next);
        *cube = weighted_sum(1.0, *cube, scale * scale * scale * ARTANH[1][n], next);
    }
}

/* tr exp(H) - 3 of a traceless H as a function of tr H^2 and tr H^3. */
INLINE Jet exponential_trace(vec square, vec cube)
{
    const double scale = 1.0 / (1 << DOUBLINGS), second = scale * scale, third = second * scale;
    Jet t2 = {second * square, all(second)}, t3 = {third * cube, all(0.0), all(third)};
    Jet trace[3] = {constant(all(0.0)), t2, t3}, even = weighted_sum(0.5, t2, 0.0, t3);
    Jet odd = weighted_sum(0.0, t2, 1.0 / 6.0, t3);
    double factor = 6.0;
#pragma GCC unroll 1
    for (int n = 4; n <= EXPONENTIAL_TERMS; ++n) {
        Jet next = weighted_sum(0.5, product(t2, trace[1]), 1.0 / 3.0, product(t3, trace[0]));
        trace[0] = trace[1], trace[1] = trace[2], trace[2] = next;
        factor *= n;
        even = weighted_sum(1.0, even, n % 2 ? 0.0 : 1.0 / factor, next);
        odd = weighted_sum(1.0, odd, n % 2 ? 1.0 / factor : 0.0, next);
    }
    Jet x = weighted_sum(1.0, even, 1.0, odd), y = weighted_sum(1.0, even, -1.0, odd);
#pragma GCC unroll 1
    for (int doubling = 0; doubling < DOUBLINGS; ++doubling) {
        Jet squared = weighted_sum(1.0, product(x, x), 6.0, x), other = product(y, y);
        other = weighted_sum(1.0, weighted_sum(1.0, other, 6.0, y), -2.0, x);
        x = weighted_sum(1.0, squared, -2.0, y);
        y = other;
    }
    return x;
}

/* Sum over terms of c[2p]/c[2p + 1] (sum of stretches to the power c[2p + 1], less 3), as a function of
 * the isochoric I1 - 3 and I2 - 3. */
INLINE Jet power_sum(int terms, const double *c, vec x, vec y)
{
    Jet square, cube, total = constant(all(0.0));
    logarithm_traces(x, y, &square, &cube);
#pragma GCC unroll 1
    for (int p = 0; p < terms; ++p) {
        const double alpha = c[2 * p + 1], a = 0.25 * alpha * alpha, b = 0.125 * alpha * alpha * alpha;
        Jet s = weighted_sum(a, square, 0.0, cube), t = weighted_sum(0.0, square, b, cube);
        Jet part = compose(exponential_trace(s.value, t.value), s, t);
        total = weighted_sum(1.0, total, c[2 * p] / alpha, part);
    }
    return total;
}
