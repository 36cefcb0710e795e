/* Material points of elastic bodies in plane strain and in half sections of bodies of revolution, several
 * at a time; those in space are in space_kernel.c.
 *
 * With I = |F|^2 and J = det F of the in-plane F and the stretch s across it the invariants of energies.h
 * are I + s^2, I s^2 + J^2 and J s. The stress is P = 2 W_I F + W_J cof F, and W_s across.
 */

#include "point_lanes.h"

#include "energies.h"

/* Derivatives of an energy: p = 2 W_I, q = W_J, s = W_s; II = 4 W_II, IJ = 2 W_IJ, Is = 2 W_Is, JJ, Js,
 * ss. */
typedef struct {
    vec p, q, s, II, IJ, Is, JJ, Js, ss;
} PlaneSlopes;

/* Derivatives by I, J and s from those by the invariants. */
INLINE void by_chain(const Slopes *a, int second, vec I, vec J, vec s, PlaneSlopes *w)
{
    const vec ss = s * s, sI = 2.0 * s * I;
    vec W_I = a->I1 + a->I2 * ss, same = 2.0 * (a->I1 + a->I2 * I);
    w->p = 2.0 * W_I;
    w->q = a->J * s + 2.0 * J * a->I2;
    w->s = a->J * J + same * s;
    if (!second)
        return;
    vec J_I = a->J1 + a->J2 * ss, I1_I = a->I11 + a->I12 * ss, I2_I = a->I12 + a->I22 * ss;
    vec J_J = a->JJ * s + 2.0 * J * a->J2, I1_J = a->J1 * s + 2.0 * J * a->I12;
    vec I2_J = a->J2 * s + 2.0 * J * a->I22;
    vec J_s = a->JJ * J + 2.0 * s * a->J1 + sI * a->J2, I1_s = a->J1 * J + 2.0 * s * a->I11 + sI * a->I12;
    vec I2_s = a->J2 * J + 2.0 * s * a->I12 + sI * a->I22;
    w->II = 4.0 * (I1_I + ss * I2_I);
    w->IJ = 2.0 * (J_I * s + 2.0 * J * I2_I);
    w->Is = 2.0 * (J_I * J + 2.0 * s * I1_I + sI * I2_I + 2.0 * s * a->I2);
    w->JJ = J_J * s + 2.0 * (J * I2_J + a->I2);
    w->Js = J_J * J + 2.0 * s * I1_J + sI * I2_J + a->J;
    w->ss = J_s * J + 2.0 * s * I1_s + sI * I2_s + same;
}

/* cosh of the root of z >= 0, less one, and its first two derivatives; a series up to .25. */
INLINE void cosh_of_root(vec z, vec *value, vec *slope, vec *curvature)
{
    vec v = all(0.0), d = v, dd = v;
    double factor = 1.0;
    for (int n = 1; n <= 8; ++n)
        factor *= (2 * n - 1) * (2 * n);
    for (int n = 8; n >= 1; --n) {
        v = (v + 1.0 / factor) * z; /* the sum from z^n on, over z^(n - 1) */
        d = d * z + n / factor;
        if (n > 1)
            dd = dd * z + n * (n - 1) / factor;
        factor /= (2 * n - 1) * (2 * n);
    }
    *value = v, *slope = d, *curvature = dd;
    ivec large = (ivec)(z > 0.25);
    if (any(large)) {
        vec safe = choose(large, z, all(0.25)), root = square_root(safe), e = exponential(root);
        vec up = 0.5 * (e + 1.0 / e), by = 0.5 * (e - 1.0 / e) / root;
        *value = choose(large, up - 1.0, *value);
        *slope = choose(large, 0.5 * by, *slope);
        *curvature = choose(large, 0.25 * (up - by) / safe, *curvature);
    }
}

/* Derivatives by m and y of energies in principal stretches, see `by_stretches`. */
typedef struct {
    vec m, y, mm, my, yy;
} StretchSlopes;

/* Those of the distortional part; the logarithm m, and x = y - 1. */
INLINE void distort_stretches(const Law *law, vec m, vec x, StretchSlopes *w)
{
    const double *c = law->c;
    vec value, slope;
    squared_arcosh(x, &value, &slope);
    vec curvature = curvature_of_squared_arcosh(x, slope);
    if (law->material == HENCKY) {
        w->m = 12.0 * c[0] * m;
        w->mm = all(12.0 * c[0]);
        w->y = 0.5 * c[0] * slope;
        w->yy = 0.5 * c[0] * curvature;
        return;
    }
#pragma GCC unroll 1
    for (int p = 0; p < (int)c[1]; ++p) {
        const double mu = c[2 * p + 2], alpha = c[2 * p + 3], a = 0.25 * alpha * alpha;
        vec C, C1, C2, in = (2.0 * mu / alpha) * exponential(alpha * m);
        vec across = (2.0 * mu / alpha) * exponential(-2.0 * alpha * m);
        cosh_of_root(a * value, &C, &C1, &C2);
        w->m += alpha * (in * (C + 1.0) - across);
        w->mm += alpha * alpha * (in * (C + 1.0) + 2.0 * across);
        w->y += in * C1 * a * slope;
        w->my += alpha * in * C1 * a * slope;
        w->yy += in * a * (C2 * a * slope * slope + C1 * curvature);
    }
}

/* Derivatives of energies in principal stretches (Hencky's, Ogden's). With y = I/(2 J), the hyperbolic
 * cosine of the difference of the in-plane logarithmic stretches, and m = (ln J - 2 ln s)/6, their mean
 * less a third of all, the isochoric ones are m +- arcosh(y)/2 and -2 m. */
INLINE void by_stretches(const Law *law, vec I, vec J, vec s, PlaneSlopes *w)
{
    const double *c = law->c;
    vec r = 1.0 / (J * s), of_J = r * s, of_s = r * J, across = logarithm(s), plane = logarithm(J);
    if (law->part != DISTORTION) {
        vec l = across + plane, whole = J * s, first, second;
        if (law->material == HENCKY) {
            first = c[1] * l * r;
            second = c[1] * (1.0 - l) * r * r;
        } else {
            first = 0.5 * c[0] * (whole - r);
            second = 0.5 * c[0] * (1.0 + r * r);
        }
        w->q = first * s;
        w->s = first * J;
        w->JJ = second * s * s;
        w->Js = second * whole + first;
        w->ss = second * J * J;
    }
    if (law->part == VOLUME)
        return;
    StretchSlopes by = {};
    vec y = 0.5 * I * of_J, square = of_J * of_J;
    distort_stretches(law, (1.0 / 6.0) * (plane - 2.0 * across), y - 1.0, &by);
    w->p = by.y * of_J;
    w->q += ((1.0 / 6.0) * by.m - by.y * y) * of_J;
    w->s -= (1.0 / 3.0) * by.m * of_s;
    w->II = by.yy * square;
    w->IJ = ((1.0 / 6.0) * by.my - by.yy * y - by.y) * square;
    w->Is = (-1.0 / 3.0) * by.my * of_J * of_s;
    w->JJ += ((by.yy * y - (1.0 / 3.0) * by.my + 2.0 * by.y) * y + (1.0 / 36.0) * by.mm -
              (1.0 / 6.0) * by.m) * square;
    w->Js += (1.0 / 3.0) * (by.my * y - (1.0 / 6.0) * by.mm) * of_J * of_s;
    w->ss += ((1.0 / 9.0) * by.mm + (1.0 / 3.0) * by.m) * of_s * of_s;
}

/* The energy from H = F - 1: with x = J - 1 = tr H + det H and a = I - 2 J, a sum of squares, small
 * strains keep their digits. */
INLINE vec stored_in_plane(const Law *law, const vec *F, vec J, vec s)
{
    const double *c = law->c;
    const int d = law->part != VOLUME;
    vec H = F[0] - 1.0, V = F[3] - 1.0, x = H + V + (H * V - F[1] * F[2]), y = s - 1.0;
    vec a = (H - V) * (H - V) + (F[1] + F[2]) * (F[1] + F[2]);
    if (law->material != HENCKY && law->material != OGDEN) {
        vec ss = y * (y + 2.0), JJ = x * (x + 2.0), I = a + 2.0 * x;
        return stored(law->material, law->part, c, I + ss, I * (1.0 + ss) + 2.0 * ss + JJ,
                      JJ + ss + JJ * ss);
    }
    vec plane, across, rest, rest_across, value, slope, w = all(0.0);
    logarithm_of_sum(x, &plane, &rest);
    logarithm_of_sum(y, &across, &rest_across);
    vec l = plane + across, m = (1.0 / 6.0) * (plane - 2.0 * across);
    if (law->part != DISTORTION && law->material == HENCKY) {
        w = 0.5 * c[1] * l * l;
    } else if (law->part != DISTORTION) { /* J^2 - 1 - 2 ln J = e^2 + 2 (e - ln(1 + e)) */
        vec e = x + y + x * y;
        logarithm_of_sum(e, &l, &rest);
        w = 0.25 * c[0] * (e * e + 2.0 * rest);
    }
    if (!d)
        return w;
    squared_arcosh(0.5 * a / J, &value, &slope);
    if (law->material == HENCKY)
        return w + c[0] * (0.5 * value + 6.0 * m * m);
#pragma GCC unroll 1
    for (int p = 0; p < (int)c[1]; ++p) {
        const double mu = c[2 * p + 2], alpha = c[2 * p + 3];
        vec C, C1, C2, in = exponential_from_one(alpha * m);
        cosh_of_root(0.25 * alpha * alpha * value, &C, &C1, &C2);
        w += mu / alpha * (2.0 * (in + C + in * C) + exponential_from_one(-2.0 * alpha * m));
    }
    return w;
}

/* Moduli, see MODULI of point_lanes.h, with b = F F^T of the plane. */
INLINE void by_place(enum section section, const PlaneSlopes *w, const vec *F, vec J, vec s, vec *moduli)
{
    const vec b[3] = {F[0] * F[0] + F[1] * F[1], F[2] * F[2] + F[3] * F[3], F[0] * F[2] + F[1] * F[3]};
    const vec q = J * w->q, IJ = J * w->IJ, JJ = J * (J * w->JJ) + q;
    const vec by[3] = {w->II * b[0] + IJ, w->II * b[1] + IJ, w->II * b[2]};
    vec *c = tangent_of(0, moduli);
    moduli[0] = w->p * b[0] + q;
    moduli[1] = w->p * b[1] + q;
    moduli[2] = s * w->s;
    moduli[3] = w->p * b[2];
    c[0] = by[0] * b[0] + (IJ * b[0] + JJ - 2.0 * q);
    c[1] = by[0] * b[1] + (IJ * b[0] + JJ);
    c[3] = by[0] * b[2];
    c[5] = by[1] * b[1] + (IJ * b[1] + JJ - 2.0 * q);
    c[7] = by[1] * b[2];
    c[15] = by[2] * b[2] - q;
    if (section == STRAIN)
        return;
    const vec Is = s * w->Is, Js = s * J * w->Js;
    c[2] = Is * b[0] + Js;
    c[6] = Is * b[1] + Js;
    c[11] = Is * b[2];
    c[10] = s * (s * w->ss) - moduli[2];
}

INLINE void update(enum section section, const Law *law, const vec *F, const vec *state, vec *P,
                   vec *end, vec *moduli, vec *energies, ivec *good)
{
    const vec J = F[0] * F[3] - F[1] * F[2], s = section == RING ? F[4] : all(1.0);
    const vec I = F[0] * F[0] + F[1] * F[1] + F[2] * F[2] + F[3] * F[3];
    const vec cof[4] = {F[3], -F[2], -F[1], F[0]};
    PlaneSlopes w = {};
    *good = (ivec)(J > 0.0) & (ivec)(s > 0.0);
    if (energies) {
        energies[0] = stored_in_plane(law, F, J, s);
        energies[1] = energies[2] = all(0.0);
    }
    Slopes of = {};
    if (law->material == HENCKY || law->material == OGDEN) {
        by_stretches(law, I, J, s, &w);
    } else if (law->material == NEO_HOOKEAN) { /* no product of J and I1, no I2: a third of the chain */
        slopes(NEO_HOOKEAN, law->part, law->c, J * s, I, J, moduli != 0, &of);
        w = (PlaneSlopes){.p = 2.0 * of.I1, .q = of.J * s, .s = of.J * J + 2.0 * of.I1 * s, .JJ = of.JJ * s * s,
                          .Js = of.JJ * J * s + of.J, .ss = of.JJ * J * J + 2.0 * of.I1};
    } else {
        slopes(law->material, law->part, law->c, J * s, I + s * s, I * s * s + J * J, moduli != 0, &of);
        by_chain(&of, moduli != 0, I, J, s, &w);
    }
    if (needs_volume(law->material, law->part)) { /* all bits set: not a number */
        w.q = (vec)((ivec)w.q | ~*good);
        w.JJ = (vec)((ivec)w.JJ | ~*good);
    }
    if (moduli) {
        by_place(section, &w, F, J, s, moduli);
        return;
    }
    for (int k = 0; k < 4; ++k)
        P[k] = w.p * F[k] + w.q * cof[k];
    P[4] = w.s;
}

KERNEL(elastic_strain, STRAIN, update)
KERNEL(elastic_ring, RING, update)
