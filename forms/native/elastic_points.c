/* Material points of elastic bodies in plane strain and in half sections of bodies of revolution, eight
 * at a time; those in space are in space_kernel.c.
 *
 * With I = |F|^2 and J = det F of the in-plane F and the stretch s across it the invariants of energies.h
 * are I + s^2, I s^2 + J^2 and J s. Hencky's energy takes the logarithms of the in-plane stretches from
 * I and J (forms/bodies/materials.py). The stress is P = 2 W_I F + W_J cof F, and W_s across.
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

/* Those of Hencky's energy; c: G, K. */
INLINE void logarithmic(enum part part, const double *c, vec I, vec J, vec s, PlaneSlopes *w)
{
    const int d = part != VOLUME;
    const double k = (part != DISTORTION ? c[1] : 0.0) - (d ? 2.0 / 3.0 * c[0] : 0.0);
    vec r = 1.0 / (J * s), of_J = r * s, of_s = r * J, across = logarithm(s), plane = logarithm(J);
    vec l = across + plane, first = k * l * r, second = k * (1.0 - l) * r * r;
    w->q = first * s;
    w->s = first * J;
    w->JJ = second * s * s;
    w->Js = second * J * s + first;
    w->ss = second * J * J;
    if (!d)
        return;
    vec value, slope, y = 0.5 * I * of_J, half = 0.5 * c[0] * of_J * of_J;
    squared_arcosh(y - 1.0, &value, &slope);
    vec curvature = curvature_of_squared_arcosh(y - 1.0, slope);
    w->p = 0.5 * c[0] * slope * of_J;
    w->q += (c[0] * plane - 0.5 * c[0] * slope * y) * of_J;
    w->s += 2.0 * c[0] * across * of_s;
    w->II = half * curvature;
    w->IJ = -half * (curvature * y + slope);
    w->JJ += c[0] * (1.0 - plane) * of_J * of_J + half * (curvature * y + 2.0 * slope) * y;
    w->ss += 2.0 * c[0] * (1.0 - across) * of_s * of_s;
}

/* The energy from H = F - 1: with x = J - 1 = tr H + det H and a = I - 2 J, a sum of squares, small
 * strains keep their digits. */
INLINE vec stored_in_plane(const Law *law, const vec *F, vec J, vec s)
{
    const double *c = law->c;
    const int d = law->part != VOLUME;
    vec H = F[0] - 1.0, V = F[3] - 1.0, x = H + V + (H * V - F[1] * F[2]), y = s - 1.0;
    vec a = (H - V) * (H - V) + (F[1] + F[2]) * (F[1] + F[2]);
    if (law->material != HENCKY) {
        vec ss = y * (y + 2.0), JJ = x * (x + 2.0), I = a + 2.0 * x;
        return stored(law->material, law->part, c, I + ss, I * (1.0 + ss) + 2.0 * ss + JJ,
                      JJ + ss + JJ * ss);
    }
    vec plane, across, rest, value, slope, w = all(0.0);
    logarithm_of_sum(x, &plane, &rest);
    logarithm_of_sum(y, &across, &rest);
    vec l = plane + across;
    w += (0.5 * (law->part != DISTORTION ? c[1] : 0.0) - (d ? c[0] / 3.0 : 0.0)) * l * l;
    if (d) {
        squared_arcosh(0.5 * a / J, &value, &slope);
        w += c[0] * (0.5 * (value + plane * plane) + across * across);
    }
    return w;
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
    if (law->material == HENCKY) {
        logarithmic(law->part, law->c, I, J, s, &w);
    } else {
        Slopes of = {};
        slopes(law->material, law->part, law->c, J * s, I + s * s, I * s * s + J * J, moduli != 0, &of);
        by_chain(&of, moduli != 0, I, J, s, &w);
    }
    if (needs_volume(law->material, law->part)) { /* all bits set: not a number */
        w.q = (vec)((ivec)w.q | ~*good);
        w.JJ = (vec)((ivec)w.JJ | ~*good);
    }
    for (int k = 0; k < 4; ++k)
        P[k] = w.p * F[k] + w.q * cof[k];
    P[4] = w.s;
    if (!moduli)
        return;
    for (int k = 0; k < 4; ++k) {
        vec by_F = w.II * F[k] + w.IJ * cof[k], by_cof = w.IJ * F[k] + w.JJ * cof[k];
        for (int l = k; l < 4; ++l)
            moduli[5 * l + k] = moduli[5 * k + l] = by_F * F[l] + by_cof * cof[l];
        moduli[6 * k] += w.p;
        moduli[20 + k] = moduli[5 * k + 4] = w.Is * F[k] + w.Js * cof[k];
    }
    moduli[3] += w.q;
    moduli[15] += w.q;
    moduli[7] -= w.q;
    moduli[11] -= w.q;
    moduli[24] = w.ss;
}

KERNEL(elastic_strain, STRAIN, update)
KERNEL(elastic_ring, RING, update)
