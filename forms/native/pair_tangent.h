/* Slip, forces and tangent of a contact pair, the tangent added where it belongs in a sparse matrix:
 * what is the same in the plane and in space.
 *
 * The source that includes this says how many dimensions there are, DIM, and how many nodes facets
 * have room for. What the tangent is made of is in forms/contact/tangent.py. Of the master only the
 * shares are needed that its nodes have in the points' places, so that it may be a tool: those of
 * meshes in space are found here, others are given.
 *
 * Points that touch the same facets, now and at the last step, make up a group: their blocks are
 * added up before they are put into the matrix.
 *
 * Letters: q points, a nodes of a slave facet, m nodes that move a master facet or control points of
 * a tool, n nodes of the pair, k vertices of a slave facet, i and j space, b directions along the
 * surface. Generalised coordinates z of a point, DIM of each: a, b_1 (b_2), c, d and, along rays in
 * the plane, the slave's chords e_A and e_B.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "matrix_entries.h"

#define ALONG (DIM - 1)
#define CHORDS (DIM == 2 ? 4 : 0) /* nodes of the chords of a slave facet */
#define NODES (CORNERS + 2 * MOVERS + CHORDS)
#define WIDTH (DIM * NODES)
#define TOOL 2 /* nodes that hold the motion of a tool: displacement, and angle times a length */

/* First of the coordinates; those up to NOW the present projection depends on. */
#define A 0
#define B DIM
#define C (DIM * DIM)
#define D (C + DIM)
#define E (D + DIM)
#define ALL (DIM == 2 ? E + 2 * DIM : E)
#define NOW (DIM == 2 ? ALL : C)

typedef struct {
    int64_t corners, movers, shapes, first_master, vertices;
    /* Slave points: (q), (q, a), rows (q, a) of the pair's nodes; vertices (q, k) of their facets
     * and the functions that gaps are averaged with; nodes of the chords (q, 4), or none. */
    const double *weight, *shape;
    const int64_t *slave_rows, *of_point;
    const double *vertex_shape;
    const int64_t *chain_rows;
    /* Master: nodes (f, m) that move facets; signs (n, i) of the pair's displacements and forces,
     * or none; of a tool dy/d(theta L) (m, i) and the second derivative, or none. In space powers
     * (c, 2) of monomials and coefficients (c, c) of shape functions, control points from nodes
     * (f, c, m) or none; none where shares are given. */
    const int32_t *stencil;
    const double *signs, *turn, *bend;
    const int32_t *powers;
    const double *coefficients, *extraction;
    /* Projection: (q), (q, b); given shares (q, m) and slopes (q, b, m); (q, i), (q, b, i), (q),
     * (q, b, b, i) or none, (q), (q, b) or none. */
    const int32_t *facet;
    const double *xi, *share_of, *slope_of, *normal, *tangents, *distance, *curvature;
    const uint8_t *clamped;
    const double *along;
    /* Along rays (q, e, i, j), or none; at the end of a master (q), (q, b), (q, i), (q, i), none. */
    const double *chords, *share, *share_slope, *share_turn, *per_share;
    /* Contact: (q, i) positions and closest points; (q) felt gap, t_N and, point by point, its
     * change with the gap, or none; (q, i) traction and the law's derivatives; (q) what the gradient
     * of a film draws, turned with the normal, or none. */
    const double *position, *foot, *gap, *spring, *pressure_slope, *traction, *by_slip, *by_elastic;
    const double *by_pressure, *drawn;
    const uint8_t *closed;
    /* State of the last step: (q), (q, b), (q, b); given shares (q, m) of the place opposite and
     * slopes (q, b, m); components (q, b) of the elastic slip; (q, i), (q, i), (q). */
    const int32_t *facet_before;
    const double *xi_before, *ahead, *share_before, *slope_before, *components;
    const double *anchor, *image, *slip_length;
} Pair;

int64_t tribox_pair_size(void)
{
    return (int64_t)sizeof(Pair);
}

/* -- vectors ---------------------------------------------------------------------------------- */

INLINE double dot(const double *a, const double *b)
{
    double sum = a[0] * b[0];
    for (int i = 1; i < DIM; ++i)
        sum += a[i] * b[i];
    return sum;
}

INLINE void in_plane(const double *n, const double *v, double *out)
{
    const double across = dot(n, v);
    for (int i = 0; i < DIM; ++i)
        out[i] = v[i] - across * n[i];
}

/* -- places on the master --------------------------------------------------------------------- */

#if DIM == 3
/* Shares w (m) of the nodes of a facet's stencil in the place xi, and their slopes (b, m). */
INLINE void polynomials(const Pair *p, int64_t shapes, int64_t movers, int32_t facet,
                        const double *xi, double *w, double s[ALONG][MOVERS])
{
    double x[2][4], dx[2][4], value[3][SHAPES] = {{0.0}};
    for (int b = 0; b < 2; ++b) {
        x[b][0] = 1.0, dx[b][0] = 0.0;
        for (int e = 1; e < 4; ++e)
            x[b][e] = x[b][e - 1] * xi[b], dx[b][e] = e * x[b][e - 1];
    }
    for (int64_t k = 0; k < shapes; ++k) {
        const int e = p->powers[2 * k], f = p->powers[2 * k + 1];
        double plain = x[0][e] * x[1][f], one = dx[0][e] * x[1][f], two = x[0][e] * dx[1][f];
        const double *c = p->coefficients + k * shapes;
        for (int64_t a = 0; a < shapes; ++a) {
            value[0][a] += plain * c[a];
            value[1][a] += one * c[a];
            value[2][a] += two * c[a];
        }
    }
    if (!p->extraction) {
        for (int64_t m = 0; m < movers; ++m)
            w[m] = value[0][m], s[0][m] = value[1][m], s[1][m] = value[2][m];
        return;
    }
    for (int64_t m = 0; m < movers; ++m)
        w[m] = s[0][m] = s[1][m] = 0.0;
    for (int64_t a = 0; a < shapes; ++a) {
        const double *e = p->extraction + (facet * shapes + a) * movers;
        for (int64_t m = 0; m < movers; ++m) {
            w[m] += value[0][a] * e[m];
            s[0][m] += value[1][a] * e[m];
            s[1][m] += value[2][a] * e[m];
        }
    }
}

/* The same, with sizes that the compiler knows where they are common. */
static EXPORT void found(const Pair *p, int32_t facet, const double *xi, double *w,
                         double s[ALONG][MOVERS])
{
    if (p->shapes == 4 && p->movers == 4)
        polynomials(p, 4, 4, facet, xi, w, s);
    else if (p->shapes == 16 && p->movers == 16)
        polynomials(p, 16, 16, facet, xi, w, s);
    else
        polynomials(p, p->shapes, p->movers, facet, xi, w, s);
}
#endif

/* Shares of a point's place now, and slopes, which are left alone where they are not given. */
INLINE void now_at(const Pair *p, int64_t q, double *w, double s[ALONG][MOVERS])
{
    const int64_t m = p->movers;
#if DIM == 3
    if (p->powers) {
        found(p, p->facet[q], p->xi + ALONG * q, w, s);
        return;
    }
#endif
    for (int64_t k = 0; k < m; ++k)
        w[k] = p->share_of[m * q + k];
    for (int b = 0; p->slope_of && b < ALONG; ++b)
        for (int64_t k = 0; k < m; ++k)
            s[b][k] = p->slope_of[m * (ALONG * q + b) + k];
}

/* Shares w of the place that the point was on or opposite at the last step, and those of the
 * advected elastic slip with some components (b). */
INLINE void last_at(const Pair *p, int64_t q, const double *parts, double *w, double *slip)
{
    const int64_t m = p->movers;
    double s[ALONG][MOVERS];
#if DIM == 3
    if (p->powers) {
        const double *ahead = p->ahead + ALONG * q;
        found(p, p->facet_before[q], p->xi_before + ALONG * q, w, s);
        for (int64_t k = 0; k < m; ++k) {
            w[k] += ahead[0] * s[0][k] + ahead[1] * s[1][k];
            slip[k] = parts[0] * s[0][k] + parts[1] * s[1][k];
        }
        return;
    }
#endif
    for (int64_t k = 0; k < m; ++k)
        w[k] = p->share_before[m * q + k], slip[k] = 0.0;
    for (int b = 0; b < ALONG; ++b)
        for (int64_t k = 0; k < m; ++k) {
            s[b][k] = p->slope_before[m * (ALONG * q + b) + k];
            slip[k] += parts[b] * s[b][k];
        }
}

/* -- slip ------------------------------------------------------------------------------------- */

/* How much longer the way on a curved master is than its image v in the tangent plane: with the
 * depth nu of the last step's place below that plane the arc has the length sqrt(v^2 + 4 nu^2/3), up
 * to the fifth power of the angle that it turns by. A roll of radius R that turns by dtheta rubs over
 * R dtheta, of which the image is R sin dtheta. nu/v is tan(dtheta/2): a half of it is a turn by 53
 * degrees in a step, beyond which there is a corner. Across one, or clamped to an end, the image
 * stays. */
INLINE int is_bent(const Pair *p, int64_t q, double length, double sunk)
{
    return !p->clamped[q] && fabs(sunk) < 0.5 * length;
}

INLINE double stretch_of(double slope)
{
    return sqrt(1.0 + 4.0 / 3.0 * slope * slope);
}

/* Where the places of the last step are now, on a master with the nodes x (n, i), and the elastic
 * slip carried along with the components, beside what came over from other masters, `more` (q, i) or
 * none: found already where there is no x. The slip that points have if they are closed, and elastic
 * slip, which keeps its length. */
void tribox_pair_relate(const Pair *p, int64_t points, const double *x, const double *more,
                        double *anchor, double *image, double *way, double *elastic)
{
    for (int64_t q = 0; q < points; ++q) {
        const double *n = p->normal + DIM * q;
        const double *here = (p->clamped[q] ? p->foot : p->position) + DIM * q;
        const int32_t *node = p->stencil + p->movers * p->facet_before[q];
        double w[MOVERS], along[MOVERS], *foot = anchor + DIM * q, *v = image + DIM * q;
        double apart[DIM], s[DIM], e[DIM];
        if (x)
            last_at(p, q, p->components + ALONG * q, w, along);
        for (int i = 0; i < DIM; ++i) {
            if (x)
                foot[i] = 0.0, v[i] = more ? more[DIM * q + i] : 0.0;
            for (int64_t m = 0; x && m < p->movers; ++m) {
                foot[i] += w[m] * x[DIM * node[m] + i];
                v[i] += along[m] * x[DIM * node[m] + i];
            }
            apart[i] = here[i] - foot[i];
        }
        in_plane(n, apart, s);
        in_plane(n, v, e);
        const double length = sqrt(dot(s, s)), size = sqrt(dot(e, e));
        const double sunk = dot(n, apart) - p->distance[q];
        const double stretch = is_bent(p, q, length, sunk) ? stretch_of(sunk / length) : 1.0;
        const double scale = size > 0.0 && p->slip_length[q] > 0.0 ? p->slip_length[q] / size : 0.0;
        for (int i = 0; i < DIM; ++i) {
            way[DIM * q + i] = stretch * s[i];
            elastic[DIM * q + i] = scale * e[i];
        }
    }
}

/* -- variation of one point ------------------------------------------------------------------- */

/* Changes with z: of xi, normal, gap and share. */
typedef struct {
    double xi[ALONG][NOW], n[DIM][NOW], gap[NOW], share[NOW];
} Change;

INLINE void invert(double m[ALONG][ALONG], double inverse[ALONG][ALONG])
{
#if DIM == 2
    inverse[0][0] = 1.0 / m[0][0];
#else
    const double over = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    inverse[0][0] = m[1][1] / over, inverse[1][1] = m[0][0] / over;
    inverse[0][1] = -m[0][1] / over, inverse[1][0] = -m[1][0] / over;
#endif
}

/* Inside a facet H_bc dxi_c = tau_b.a + g n.b_b with H_bc = tau_b.tau_c - g n.y_,bc, and dn =
 * -(n.(b_b + y_,bc dxi_c)) tau^b. Two metrics: tau^b belong to tau_b.tau_c alone. */
INLINE void vary_inside(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + DIM * q, *tau = p->tangents + ALONG * DIM * q;
    double gap = p->distance[q], metric[ALONG][ALONG], inverse[ALONG][ALONG], bend[ALONG][ALONG];
    double up[ALONG][DIM];
    for (int b = 0; b < ALONG; ++b)
        for (int c = 0; c < ALONG; ++c)
            metric[b][c] = dot(tau + DIM * b, tau + DIM * c);
    invert(metric, inverse);
    for (int b = 0; b < ALONG; ++b)
        for (int i = 0; i < DIM; ++i) {
            up[b][i] = 0.0;
            for (int c = 0; c < ALONG; ++c)
                up[b][i] += inverse[b][c] * tau[DIM * c + i];
        }
    if (p->curvature) {
        for (int b = 0; b < ALONG; ++b)
            for (int c = 0; c < ALONG; ++c) {
                bend[b][c] = dot(p->curvature + DIM * (ALONG * (ALONG * q + b) + c), n);
                metric[b][c] -= gap * bend[b][c];
            }
        invert(metric, inverse);
    }
    for (int i = 0; i < DIM; ++i)
        for (int b = 0; b < ALONG; ++b) {
            for (int c = 0; c < ALONG; ++c) {
                d->xi[b][A + i] += inverse[b][c] * tau[DIM * c + i];
                d->xi[b][B + DIM * c + i] = inverse[b][c] * gap * n[i];
            }
            for (int j = 0; j < DIM; ++j)
                d->n[i][B + DIM * b + j] = -up[b][i] * n[j];
        }
    for (int b = 0; p->curvature && b < ALONG; ++b)
        for (int r = 0; r < C; ++r) {
            double turned = 0.0;
            for (int c = 0; c < ALONG; ++c)
                turned += bend[b][c] * d->xi[c][r];
            for (int i = 0; i < DIM; ++i)
                d->n[i][r] -= up[b][i] * turned;
        }
}

/* On a side of a facet, along which it moves, xi = xi_0 + s e with t = e_b tau_b: (t.t - g n.t_,s) ds =
 * t.a + g n.e_b b_b and dxi_b = e_b ds; at a corner dxi = 0. As n lies along x - y, dn = (I - n n)
 * (a - tau_b dxi_b)/g. */
INLINE void vary_clamped(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + DIM * q, *tau = p->tangents + ALONG * DIM * q;
    double gap = p->distance[q], length = 0.0, slant = 0.0, d_apart[DIM][C];
    if (p->along) {
        const double *e = p->along + ALONG * q;
        double t[DIM] = {0.0}, stiffness, change = 0.0;
        for (int b = 0; b < ALONG; ++b)
            for (int i = 0; i < DIM; ++i)
                t[i] += e[b] * tau[DIM * b + i];
        for (int b = 0; p->curvature && b < ALONG; ++b)
            for (int c = 0; c < ALONG; ++c)
                change += e[b] * e[c] * dot(p->curvature + DIM * (ALONG * (ALONG * q + b) + c), n);
        stiffness = dot(t, t) - gap * change;
        for (int b = 0; b < ALONG; ++b) {
            double over = stiffness != 0.0 ? e[b] / stiffness : 0.0;
            for (int i = 0; i < DIM; ++i) {
                d->xi[b][A + i] = over * t[i];
                for (int c = 0; c < ALONG; ++c)
                    d->xi[b][B + DIM * c + i] = over * e[c] * gap * n[i];
            }
        }
    }
    for (int i = 0; i < DIM; ++i)
        for (int r = 0; r < C; ++r) {
            d_apart[i][r] = r == A + i;
            for (int b = 0; b < ALONG; ++b)
                d_apart[i][r] -= tau[DIM * b + i] * d->xi[b][r];
        }
    /* On the edge itself the direction is undefined; the normal is then held. So it is within 1e-7 of
     * the facet beside one, as on an edge that is nearly flat: a step that matters leaves that, and
     * would be held by the stiffness of the penalty. */
    for (int b = 0; b < ALONG; ++b) {
        const double size = sqrt(dot(tau + DIM * b, tau + DIM * b));
        length = fmax(length, size);
        slant = fmax(slant, fabs(dot(n, tau + DIM * b)) / size);
    }
    double over = fabs(gap) * slant > 1e-7 * length ? 1.0 / gap : 0.0;
    for (int r = 0; r < C; ++r) {
        double across = 0.0;
        for (int i = 0; i < DIM; ++i)
            across += n[i] * d_apart[i][r];
        for (int i = 0; i < DIM; ++i)
            d->n[i][r] = over * (d_apart[i][r] - n[i] * across);
    }
}

#if DIM == 2
/* With x = y(xi) + g n and t = n turned to the right: dxi = (t.a - g t.dn)/(t.tau), dg = n.a - n.tau
 * dxi. */
static void vary_along_ray(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q, *change = p->chords + 8 * q;
    const double along[DIM] = {n[1], -n[0]};
    for (int e = 0; e < 2; ++e)
        for (int i = 0; i < DIM; ++i)
            for (int j = 0; j < DIM; ++j)
                d->n[i][E + 2 * e + j] = change[4 * e + 2 * i + j];
    for (int r = 0; r < NOW; ++r) {
        d->xi[0][r] = -p->distance[q] * (along[0] * d->n[0][r] + along[1] * d->n[1][r]);
        d->xi[0][r] = (d->xi[0][r] + (r < 2 ? along[r] : 0.0)) / dot(along, tau);
        d->gap[r] = (r < 2 ? n[r] : 0.0) - dot(n, tau) * d->xi[0][r];
    }
}
#endif

/* The share of a point beside the end of a master, or where its ray hardly faces it. What depends on
 * the ray's normal does so relative to the master, which turns by b.m/|tau|, with m its own normal:
 * dsigma = sigma_xi dxi + sigma_n.(dn - J n b.m/|tau|), J a turn to the left. */
INLINE void vary_share(const Pair *p, int64_t q, Change *d)
{
    for (int b = 0; b < ALONG; ++b)
        for (int r = 0; r < NOW; ++r)
            d->share[r] += p->share_slope[ALONG * q + b] * d->xi[b][r];
#if DIM == 2
    if (!p->share_turn)
        return;
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q, *turn = p->share_turn + 2 * q;
    double over = (turn[1] * n[0] - turn[0] * n[1]) / dot(tau, tau);
    for (int r = 0; r < NOW; ++r)
        d->share[r] += turn[0] * d->n[0][r] + turn[1] * d->n[1][r];
    d->share[B] += over * tau[1], d->share[B + 1] -= over * tau[0];
#endif
}

INLINE void vary_projection(const Pair *p, int64_t q, Change *d)
{
    memset(d, 0, sizeof(*d));
#if DIM == 2
    if (p->chords)
        vary_along_ray(p, q, d);
    else
#endif
    {
        if (p->clamped[q])
            vary_clamped(p, q, d);
        else
            vary_inside(p, q, d);
        for (int j = 0; j < DIM; ++j)
            d->gap[A + j] = p->normal[DIM * q + j];
    }
    if (p->share_slope)
        vary_share(p, q, d);
}

/* The part of the variation (i, ALL) of (I - n n) v that comes from the normal. */
INLINE void vary_in_plane(const double *n, const double *v, const Change *d, double out[DIM][ALL])
{
    double across = dot(n, v);
    for (int r = 0; r < NOW; ++r) {
        double along = 0.0;
        for (int i = 0; i < DIM; ++i)
            along += v[i] * d->n[i][r];
        for (int i = 0; i < DIM; ++i)
            out[i][r] = -across * d->n[i][r] - n[i] * along;
    }
    for (int i = 0; i < DIM; ++i)
        for (int r = NOW; r < ALL; ++r)
            out[i][r] = 0.0;
}

/* The slip's variation; clamped to a side it is measured from the foot. */
INLINE void vary_slip(const Pair *p, int64_t q, const Change *d, double slip[DIM][ALL])
{
    const double *n = p->normal + DIM * q, *tau = p->tangents + ALONG * DIM * q;
    const double *here = (p->clamped[q] ? p->foot : p->position) + DIM * q;
    double apart[DIM], way[DIM];
    for (int i = 0; i < DIM; ++i)
        apart[i] = here[i] - p->anchor[DIM * q + i];
    vary_in_plane(n, apart, d, slip);
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j)
            slip[i][C + j] += (i == j) - n[i] * n[j];
    for (int r = 0; p->clamped[q] && r < NOW; ++r) {
        double foot[DIM], moved[DIM];
        for (int i = 0; i < DIM; ++i) {
            foot[i] = -(r == A + i);
            for (int b = 0; b < ALONG; ++b)
                foot[i] += tau[DIM * b + i] * d->xi[b][r];
        }
        in_plane(n, foot, moved);
        for (int i = 0; i < DIM; ++i)
            slip[i][r] += moved[i];
    }
    in_plane(n, apart, way);
    const double length = sqrt(dot(way, way)), sunk = dot(n, apart) - p->distance[q];
    if (!is_bent(p, q, length, sunk))
        return;
    const double slope = sunk / length, stretch = stretch_of(slope);
    for (int i = 0; i < DIM; ++i)
        way[i] /= length;
    for (int r = 0; r < ALL; ++r) {
        double grown = r >= C && r < D ? n[r - C] : 0.0;
        for (int i = 0; i < DIM; ++i)
            grown -= slope * way[i] * slip[i][r];
        if (r < NOW) {
            grown -= d->gap[r];
            for (int i = 0; i < DIM; ++i)
                grown += apart[i] * d->n[i][r];
        }
        grown *= 4.0 / 3.0 * slope / stretch;
        for (int i = 0; i < DIM; ++i)
            slip[i][r] = stretch * slip[i][r] + way[i] * grown;
    }
}

/* That of the elastic slip: its length is kept, so that only the direction varies. */
INLINE void vary_elastic(const Pair *p, int64_t q, const Change *d, double elastic[DIM][ALL])
{
    const double *n = p->normal + DIM * q, *image = p->image + DIM * q;
    double v[DIM];
    in_plane(n, image, v);
    const double length = sqrt(dot(v, v)), kept = p->slip_length[q];
    const double scale = length > 0.0 && kept > 0.0 ? kept / length : 0.0;
    vary_in_plane(n, image, d, elastic);
    for (int i = 0; i < DIM; ++i) {
        v[i] *= scale > 0.0 ? 1.0 / length : 1.0;
        for (int j = 0; j < DIM; ++j)
            elastic[i][D + j] += (i == j) - n[i] * n[j];
    }
    for (int r = 0; r < ALL; ++r) {
        double along = 0.0;
        for (int i = 0; i < DIM; ++i)
            along += v[i] * elastic[i][r];
        for (int i = 0; i < DIM; ++i)
            elastic[i][r] = scale * (elastic[i][r] - v[i] * along);
    }
}

/* Weight times the variation of the traction (i, ALL), and the changes of the projection. */
static EXPORT void vary_traction(const Pair *p, int64_t q, double out[DIM][ALL], Change *d)
{
    const double *n = p->normal + DIM * q, weight = p->weight[q];
    double slip[DIM][ALL], elastic[DIM][ALL];
    vary_projection(p, q, d);
    vary_slip(p, q, d, slip);
    vary_elastic(p, q, d, elastic);
    for (int i = 0; i < DIM; ++i) {
        const double *by_slip = p->by_slip + DIM * (DIM * q + i);
        const double *by_elastic = p->by_elastic + DIM * (DIM * q + i);
        for (int r = 0; r < ALL; ++r) {
            double sum = r < NOW ? p->spring[q] * d->n[i][r] : 0.0;
            for (int j = 0; j < DIM; ++j)
                sum -= by_slip[j] * slip[j][r] + by_elastic[j] * elastic[j][r];
            out[i][r] = weight * sum;
        }
        if (p->pressure_slope) {
            double by = weight * p->pressure_slope[q] * (n[i] - p->by_pressure[DIM * q + i]);
            for (int r = 0; r < NOW; ++r)
                out[i][r] += by * d->gap[r];
        }
        for (int r = 0; p->share_slope && r < NOW; ++r)
            out[i][r] += weight * p->per_share[DIM * q + i] * d->share[r];
        for (int r = 0; DIM == 2 && p->drawn && r < NOW; ++r)
            out[i][r] += weight * p->drawn[q] * (i ? d->n[0][r] : -d->n[1][r]);
    }
}

/* -- blocks of groups of points --------------------------------------------------------------- */

/* Add -G^T C G of a point to the block (a + m, i, n, j) of its group; the place moves under the load:
 * -t (du_2,b) dxi_b. Columns: the slave facet, the master's, that of the last step where it is not
 * `folded` into it, chords. */
INLINE void add_point_of(const Pair *p, int64_t q, int64_t a, int64_t m, int folded, int rays,
                         double *block)
{
    const int64_t now = DIM * (a + m), last = folded ? DIM * a : now;
    const int64_t chords = folded ? now : now + DIM * m, size = chords + (rays ? DIM * CHORDS : 0);
    const int64_t reach = rays ? size : now;
    double w[MOVERS], s[ALONG][MOVERS], before[MOVERS], slip[MOVERS];
    double dt[DIM][ALL], v[DIM][WIDTH], e[ALONG][WIDTH], f[WIDTH];
    const double *shape = p->shape + a * q;
    Change d;
    vary_traction(p, q, dt, &d);
    now_at(p, q, w, s);
    last_at(p, q, p->components + ALONG * q, before, slip);
    for (int i = 0; i < DIM; ++i) {
        const double *c = dt[i];
        for (int64_t k = 0; k < a; ++k)
            for (int j = 0; j < DIM; ++j)
                v[i][DIM * k + j] = shape[k] * (c[A + j] + c[C + j]);
        for (int64_t k = 0; k < m; ++k)
            for (int j = 0; j < DIM; ++j) {
                double sum = -w[k] * c[A + j];
                for (int b = 0; b < ALONG; ++b)
                    sum += s[b][k] * c[B + DIM * b + j];
                v[i][DIM * (a + k) + j] = sum;
            }
        for (int64_t k = 0; k < m; ++k)
            for (int j = 0; j < DIM; ++j) {
                double more = slip[k] * c[D + j] - before[k] * c[C + j];
                v[i][last + DIM * k + j] = folded ? v[i][last + DIM * k + j] + more : more;
            }
        for (int64_t k = 0; rays && k < CHORDS; ++k) /* they end at the second next vertex */
            for (int j = 0; j < DIM; ++j)
                v[i][chords + DIM * k + j] = (k < 2 ? -1.0 : 1.0) * c[E + DIM * (k % 2) + j];
    }
    for (int b = 0; b < ALONG; ++b) {
        const double *c = d.xi[b];
        for (int64_t k = 0; k < a; ++k)
            for (int j = 0; j < DIM; ++j)
                e[b][DIM * k + j] = shape[k] * c[A + j];
        for (int64_t k = 0; k < m; ++k)
            for (int j = 0; j < DIM; ++j) {
                double sum = -w[k] * c[A + j];
                for (int g = 0; g < ALONG; ++g)
                    sum += s[g][k] * c[B + DIM * g + j];
                e[b][DIM * (a + k) + j] = sum;
            }
        for (int64_t l = now; l < reach; ++l)
            e[b][l] = 0.0;
        for (int64_t k = 0; rays && k < CHORDS; ++k)
            for (int j = 0; j < DIM; ++j)
                e[b][chords + DIM * k + j] = (k < 2 ? -1.0 : 1.0) * c[E + DIM * (k % 2) + j];
    }
    for (int64_t k = 0; k < a; ++k)
        for (int i = 0; i < DIM; ++i) {
            double *row = block + (DIM * k + i) * size;
            for (int64_t l = 0; l < size; ++l)
                row[l] -= shape[k] * v[i][l];
        }
    for (int64_t k = 0; k < m; ++k) {
        for (int64_t l = 0; l < reach; ++l) {
            f[l] = s[0][k] * e[0][l];
            for (int b = 1; b < ALONG; ++b)
                f[l] += s[b][k] * e[b][l];
        }
        for (int i = 0; i < DIM; ++i) {
            double *row = block + (DIM * (a + k) + i) * size;
            double force = p->weight[q] * p->traction[DIM * q + i];
            for (int64_t l = 0; l < reach; ++l)
                row[l] += w[k] * v[i][l] + force * f[l];
            for (int64_t l = reach; l < size; ++l)
                row[l] += w[k] * v[i][l];
        }
    }
}

/* The same, with sizes that the compiler knows where they are common. */
static EXPORT void add_point(const Pair *p, int64_t q, int folded, double *block)
{
    const int64_t a = p->corners, m = p->movers, usual = DIM == 2 ? 2 : 4;
    if (a == usual && m == usual && folded && !p->chords)
        add_point_of(p, q, usual, usual, 1, 0, block);
    else if (DIM == 3 && a == 4 && m == 16 && folded)
        add_point_of(p, q, 4, 16 < MOVERS ? 16 : MOVERS, 1, 0, block);
    else
        add_point_of(p, q, a, m, folded, p->chords != NULL, block);
}

/* Take the control points of a tool in rows and columns (nodes a and after) of a block with so many
 * nodes in its columns to its displacement and angle, y_a = c + ...; the angle is the first unknown of
 * the second node. */
static void carry(const Pair *p, const double *block, int64_t width, double *out)
{
    const int64_t a = p->corners, m = p->movers, made = width - m + TOOL;
    double half[DIM * (CORNERS + DIM + 1) * DIM * (CORNERS + TOOL + CHORDS)];
    memset(half, 0, sizeof(double) * DIM * (a + m) * DIM * made);
    memset(out, 0, sizeof(double) * DIM * (a + TOOL) * DIM * made);
    for (int64_t r = 0; r < DIM * (a + m); ++r) {
        const double *from = block + r * DIM * width;
        double *to = half + r * DIM * made;
        for (int64_t n = 0; n < width; ++n)
            for (int j = 0; j < DIM; ++j) {
                const double x = from[DIM * n + j];
                if (n < a || n >= a + m) {
                    to[DIM * (n < a ? n : n - m + TOOL) + j] = x;
                    continue;
                }
                to[DIM * a + j] += x;
                to[DIM * (a + 1)] += x * p->turn[DIM * (n - a) + j];
            }
    }
    for (int64_t n = 0; n < a + m; ++n)
        for (int i = 0; i < DIM; ++i) {
            const double *from = half + (DIM * n + i) * DIM * made;
            double *to = out + (DIM * (n < a ? n : a) + i) * DIM * made;
            double *turned = out + DIM * (a + 1) * DIM * made;
            for (int64_t l = 0; l < DIM * made; ++l) {
                to[l] += from[l];
                if (n >= a)
                    turned[l] += p->turn[DIM * (n - a) + i] * from[l];
            }
        }
}

/* Add rows [low, high) of a block, columns of the nodes in `sorted` (count), with their signs. */
INLINE int add_rows(Entries *e, const double *signs, const int64_t *nodes, int64_t low, int64_t high,
                    const int64_t *sorted, int64_t count, const double *block, int64_t width)
{
    for (int64_t k = low; k < high; ++k) {
        int32_t from = start_of_row(e, nodes[k]);
        for (int64_t l = 0; l < count; ++l) {
            const int64_t n = sorted[l];
            const double *x = block + DIM * k * DIM * width + DIM * n;
            double turned[DIM * DIM];
            int64_t step = DIM * width;
            for (int i = 0; signs && i < DIM; ++i)
                for (int j = 0; j < DIM; ++j)
                    turned[DIM * i + j] = signs[DIM * nodes[k] + i] * x[i * step + j]
                        * signs[DIM * nodes[n] + j];
            if (signs)
                x = turned, step = DIM;
            from = put(e, nodes[k], nodes[n], from, x, step);
            if (from < 0)
                return 1;
        }
    }
    return 0;
}

/* Nodes of a group's block, in the order of its columns; returns how many. */
static int64_t nodes_of(const Pair *p, int64_t q, int folded, int64_t *node)
{
    const int64_t a = p->corners, m = p->movers;
    int64_t count = 0;
    for (int64_t k = 0; k < a; ++k)
        node[count++] = p->slave_rows[a * q + k];
    for (int64_t k = 0; k < (p->turn ? TOOL : m); ++k)
        node[count++] = p->first_master + (p->turn ? k : p->stencil[m * p->facet[q] + k]);
    for (int64_t k = 0; !folded && k < m; ++k)
        node[count++] = p->first_master + p->stencil[m * p->facet_before[q] + k];
    for (int64_t k = 0; p->chords && k < CHORDS; ++k)
        node[count++] = p->chain_rows[CHORDS * q + k];
    return count;
}

/* Add second derivatives of a tool's control points by its angle, times the forces on them. */
static int add_bending(const Pair *p, Entries *e, int64_t points, const int64_t *order)
{
    const int64_t angle = p->first_master + 1;
    double block[DIM * DIM] = {0.0}, s[ALONG][MOVERS];
    for (int64_t k = 0; k < points; ++k) {
        const int64_t q = order[k];
        double w[MOVERS];
        now_at(p, q, w, s);
        for (int64_t m = 0; m < p->movers; ++m)
            block[0] += p->weight[q] * w[m] * dot(p->bend + DIM * m, p->traction + DIM * q);
    }
    return put(e, angle, angle, start_of_row(e, angle), block, DIM) < 0;
}

/* Add the blocks of groups of closed points: group g has the points order[start[g]] ..., of one slave
 * facet, one present master facet and one of the last step, which a tool has one of. What couples the
 * nodes of the master is added when the last of the groups with the same two facets, one after the
 * other, is done. `block` is scratch, (a + m, i, n, j) of the most nodes. Returns 1 where the matrix
 * has no room. */
int tribox_pair_blocks(const Pair *p, Entries *e, int64_t groups, const int64_t *start,
                       const int64_t *order, double *block)
{
    const int64_t a = p->corners, m = p->movers, high = a + (p->turn ? TOOL : m);
    int64_t node[NODES], sorted[NODES];
    double carried[DIM * (CORNERS + TOOL) * DIM * (CORNERS + TOOL + CHORDS)];
    int32_t now = -1, last = -1;
    for (int64_t g = 0; g < groups; ++g) {
        const int64_t q = order[start[g]], next = g + 1 < groups ? order[start[g + 1]] : -1;
        const int first = now < 0 || (!p->turn && (p->facet[q] != now || p->facet_before[q] != last));
        now = p->facet[q], last = p->facet_before[q];
        const int folded = p->turn || now == last;
        const int64_t count = nodes_of(p, q, folded, node), width = count + m - (high - a);
        memset(block, 0, sizeof(double) * DIM * (first ? a + m : a) * DIM * width);
        for (int64_t k = DIM * a; !first && k < DIM * (a + m); ++k) {
            double *row = block + k * DIM * width;
            memset(row, 0, sizeof(double) * DIM * a);
            if (p->chords)
                memset(row + DIM * (width - CHORDS), 0, sizeof(double) * DIM * CHORDS);
        }
        for (int64_t k = start[g]; k < start[g + 1]; ++k)
            add_point(p, order[k], folded, block);
        const double *made = block;
        if (p->turn)
            carry(p, block, width, carried), made = carried;
        const int64_t own = p->chords ? count - CHORDS : count;
        sort_columns(e, node, 0, count, sorted);
        if (add_rows(e, p->signs, node, 0, a, sorted, count, made, count))
            return 1;
        sort_columns(e, node, 0, a, sorted);
        if (add_rows(e, p->signs, node, a, high, sorted, a, made, count))
            return 1;
        sort_columns(e, node, own, count, sorted);
        if (add_rows(e, p->signs, node, a, high, sorted, count - own, made, count))
            return 1;
        if (next >= 0 && (p->turn || (p->facet[next] == now && p->facet_before[next] == last)))
            continue;
        sort_columns(e, node, a, own, sorted);
        if (add_rows(e, p->signs, node, a, high, sorted, own - a, made, count))
            return 1;
    }
    return groups && p->turn ? add_bending(p, e, start[groups], order) : 0;
}

/* -- rows of the vertices --------------------------------------------------------------------- */

/* Row (n, i) of a change by z, up to NOW, with the nodes of `gap_nodes`; of one by a alone, without
 * slopes. */
INLINE void by_nodes(const Pair *p, int64_t q, const double *w, double s[ALONG][MOVERS],
                     const double *change, double *row)
{
    const int64_t a = p->corners, m = p->movers;
    for (int64_t k = 0; k < a; ++k)
        for (int j = 0; j < DIM; ++j)
            row[DIM * k + j] = p->shape[a * q + k] * change[A + j];
    for (int64_t l = 0; p->turn && l < DIM * TOOL; ++l)
        row[DIM * a + l] = 0.0;
    for (int64_t k = 0; k < m; ++k)
        for (int j = 0; j < DIM; ++j) {
            double x = -w[k] * change[A + j];
            for (int b = 0; s && b < ALONG; ++b)
                x += s[b][k] * change[B + DIM * b + j];
            if (p->turn) {
                row[DIM * a + j] += x;
                row[DIM * (a + 1)] += x * p->turn[DIM * k + j];
            } else {
                row[DIM * (a + k) + j] = x;
            }
        }
    const int64_t at = a + (p->turn ? TOOL : m);
    for (int64_t k = 0; p->chords && k < CHORDS; ++k)
        for (int j = 0; j < DIM; ++j)
            row[DIM * (at + k) + j] = s ? (k < 2 ? -1.0 : 1.0) * change[E + DIM * (k % 2) + j] : 0.0;
}

/* Number of nodes of a point's gap. */
INLINE int64_t gap_nodes(const Pair *p)
{
    return p->corners + (p->turn ? TOOL : p->movers) + (p->chords ? CHORDS : 0);
}

/* Rows of the vertices against nodes, one entry for each pair that occurs in a group of points.
 *
 * Args: groups (g) by a point of theirs; how many vertices k a point has, which (q, k), and whether
 * they have a row (v); how many there are; `mark` (nodes) scratch, `of_vertex` (v + 1) and `member`
 * (g k) too. Results: indptr (v + 1), nodes of the entries, and place (g, k, n) of each, -1 without a
 * row. */
void tribox_vertex_places(const Pair *p, int64_t groups, const int64_t *point, int64_t k,
                          const int64_t *of_point, const uint8_t *needs, int64_t count,
                          int64_t nodes, int64_t *mark, int64_t *of_vertex, int64_t *member,
                          int64_t *indptr, int64_t *node, int32_t *place)
{
    const int64_t size = gap_nodes(p);
    int64_t own[NODES], found = 0, begin = 0;
    memset(of_vertex, 0, sizeof(int64_t) * (count + 1));
    for (int64_t g = 0; g < groups; ++g)
        for (int64_t l = 0; l < k; ++l)
            ++of_vertex[of_point[k * point[g] + l] + 1];
    for (int64_t v = 0; v < count; ++v)
        of_vertex[v + 1] += of_vertex[v];
    for (int64_t g = 0; g < groups; ++g) /* afterwards of_vertex[v] is where the next one begins */
        for (int64_t l = 0; l < k; ++l)
            member[of_vertex[of_point[k * point[g] + l]]++] = k * g + l;
    for (int64_t n = 0; n < nodes; ++n)
        mark[n] = -1;
    for (int64_t v = 0; v < count; ++v) {
        const int64_t first = found, end = of_vertex[v];
        indptr[v] = first;
        for (int64_t at = begin; at < end; ++at) {
            int32_t *places = place + member[at] * size;
            nodes_of(p, point[member[at] / k], 1, own);
            for (int64_t n = 0; n < size; ++n) {
                if (needs[v] && mark[own[n]] < first) {
                    mark[own[n]] = found;
                    node[found++] = own[n];
                }
                places[n] = needs[v] ? (int32_t)mark[own[n]] : -1;
            }
        }
        begin = end;
    }
    indptr[count] = found;
}

/* Add a row (n, i) times a factor to the entries at its places. */
INLINE void add_row(const int32_t *place, int64_t size, double factor, const double *row, double *data)
{
    for (int64_t n = 0; n < size; ++n)
        for (int i = 0; i < DIM; ++i)
            data[DIM * place[n] + i] += factor * row[DIM * n + i];
}

/* Add w G_a^T d_k of points, with vectors d (p, k, i), to the entries (…, i) of the vertices. */
void tribox_vertex_rows(const Pair *p, int64_t points, const int64_t *take, const int64_t *group,
                        const int32_t *place, int64_t k, const double *along, double *data)
{
    const int64_t size = gap_nodes(p);
    double w[MOVERS], s[ALONG][MOVERS], row[WIDTH];
    for (int64_t c = 0; c < points; ++c) {
        now_at(p, take[c], w, s);
        for (int64_t l = 0; l < k; ++l) {
            const int32_t *places = place + (group[c] * k + l) * size;
            if (places[0] < 0)
                continue;
            by_nodes(p, take[c], w, NULL, along + (c * k + l) * DIM, row);
            add_row(places, size, p->weight[take[c]], row, data);
        }
    }
}

/* Add w N_A d(sigma g) of points to the entries of their vertices; of those whose area is what the
 * master has below them, with the mean gap `grown` (v), or none, less w N_A g_A dsigma. */
void tribox_gap_rows(const Pair *p, int64_t points, const int64_t *take, const int64_t *group,
                     const int32_t *place, const double *grown, double *data)
{
    const int64_t k = p->vertices, size = gap_nodes(p);
    double w[MOVERS], s[ALONG][MOVERS], row[WIDTH], of_share[WIDTH];
    const int varied = p->chords || p->share_slope;
    for (int64_t c = 0; c < points; ++c) {
        const int64_t q = take[c];
        now_at(p, q, w, s);
        if (varied) {
            Change d;
            vary_projection(p, q, &d);
            by_nodes(p, q, w, s, d.share, of_share);
            for (int r = 0; p->share && r < NOW; ++r)
                d.gap[r] = p->share[q] * d.gap[r] + p->gap[q] * d.share[r];
            by_nodes(p, q, w, s, d.gap, row);
        } else {
            by_nodes(p, q, w, NULL, p->normal + DIM * q, row);
        }
        for (int64_t l = 0; l < k; ++l) {
            const int32_t *places = place + (group[c] * k + l) * size;
            const double factor = p->weight[q] * p->vertex_shape[k * q + l];
            const double mean = grown && varied ? grown[p->of_point[k * q + l]] : 0.0;
            if (places[0] < 0)
                continue;
            add_row(places, size, factor, row, data);
            if (mean != 0.0)
                add_row(places, size, -factor * mean, of_share, data);
        }
    }
}

/* Rows (p, n, i) of the change of slips along some vectors (p, i), and their nodes (p, n), `width` of
 * them, of which those beyond the point's are left alone. */
void tribox_slip_rows(const Pair *p, int64_t points, const int64_t *take, const double *along,
                      int64_t width, int64_t *node, double *data)
{
    const int64_t m = p->movers, size = gap_nodes(p);
    for (int64_t c = 0; c < points; ++c) {
        const int64_t q = take[c];
        double w[MOVERS], s[ALONG][MOVERS], slip[DIM][ALL], change[ALL] = {0.0};
        double *row = data + c * width * DIM;
        Change d;
        now_at(p, q, w, s);
        vary_projection(p, q, &d);
        vary_slip(p, q, &d, slip);
        for (int r = 0; r < ALL; ++r)
            for (int i = 0; i < DIM; ++i)
                change[r] += along[DIM * c + i] * slip[i][r];
        by_nodes(p, q, w, s, change, row);
        nodes_of(p, q, 1, node + c * width);
        last_at(p, q, p->components + ALONG * q, w, s[0]);
        for (int64_t k = 0; k < p->corners; ++k)
            for (int j = 0; j < DIM; ++j)
                row[DIM * k + j] += p->shape[p->corners * q + k] * change[C + j];
        for (int64_t k = 0; k < m; ++k) {
            double *last = row + DIM * (p->turn ? p->corners : size + k);
            if (!p->turn)
                node[c * width + size + k] = p->first_master + p->stencil[m * p->facet_before[q] + k];
            for (int j = 0; j < DIM; ++j) {
                last[j] -= w[k] * change[C + j];
                if (p->turn)
                    last[DIM] -= w[k] * change[C + j] * p->turn[DIM * k + j];
            }
        }
    }
}

/* -- what goes through the vertices ----------------------------------------------------------- */

typedef double four __attribute__((vector_size(32), aligned(8)));

/* Add sum_A L_A R_A^T / m_A. L and R have rows of vertices A with entries (…, i) at nodes, R with
 * zeros up to four; `area` (v); `node_of` the columns of the matrix, -1 but for the first of a node;
 * `by_node` (rows + 1), `vertex` and `entry` (entries of L) scratch, and of the columns `seen`, `list`
 * and sums (i, four). Returns 1 where the matrix has no room. */
EXPORT int tribox_add_product(Entries *e, int64_t vertices, const double *area,
                              int64_t rows, const int64_t *left, const int64_t *left_node,
                              const double *left_data, int64_t columns, const int64_t *right,
                              const int64_t *right_node, const double *right_data,
                              int64_t *by_node, int64_t *vertex, int64_t *entry, int64_t *seen,
                              int64_t *list, const int32_t *node_of, double *sum)
{
    memset(by_node, 0, sizeof(int64_t) * (rows + 1));
    for (int64_t k = 0; k < left[vertices]; ++k)
        ++by_node[left_node[k] + 1];
    for (int64_t n = 0; n < rows; ++n)
        by_node[n + 1] += by_node[n];
    for (int64_t v = 0; v < vertices; ++v)
        for (int64_t k = left[v]; k < left[v + 1]; ++k) {
            const int64_t at = by_node[left_node[k]]++;
            vertex[at] = v, entry[at] = k;
        }
    for (int64_t n = 0; n < columns; ++n)
        seen[n] = -1;
    for (int64_t n = 0; n < rows; ++n) {
        const int32_t row = e->row_first[n];
        const int64_t begin = n ? by_node[n - 1] : 0;
        int64_t inside = 0, count = 0;
        for (int64_t at = begin; at < by_node[n]; ++at) {
            const int64_t v = vertex[at];
            const double *l = left_data + DIM * entry[at], over = 1.0 / area[v];
            for (int64_t k = right[v]; k < right[v + 1]; ++k) {
                const int64_t column = right_node[k];
                if (seen[column] == n)
                    continue;
                seen[column] = n;
                if (row >= 0 && e->column_first[column] >= 0)
                    ++inside;
                else
                    list[count++] = column;
                memset(sum + 4 * DIM * column, 0, sizeof(double) * 4 * DIM);
            }
            for (int64_t k = right[v]; k < right[v + 1]; ++k) {
                const four r = *(const four *)(right_data + 4 * k);
                four *x = (four *)(sum + 4 * DIM * right_node[k]);
                for (int i = 0; i < DIM; ++i)
                    x[i] += over * l[i] * r;
            }
        }
        for (int64_t k = 0; k < count; ++k)
            if (put_beside(e, n, list[k], sum + 4 * DIM * list[k], 4))
                return 1;
        /* So many columns are touched that going along the row is faster than searching it. */
        for (int32_t place = row < 0 ? 0 : e->indptr[row]; inside && place < e->indptr[row + 1];
             ++place) {
            const int32_t column = e->indices[place], node = node_of[column];
            if (node < 0 || seen[node] != n)
                continue;
            if (!add_at(e, row, column, place, sum + 4 * DIM * node, 4))
                return 1;
            --inside;
        }
        if (inside)
            return 1;
    }
    return 0;
}

/* -- forces ----------------------------------------------------------------------------------- */

/* Add the residual -G^T (w t) of all points to the pair's nodes (…, i); returns the sum of the squares
 * of what each point adds, but for moments on a tool. */
double tribox_pair_forces(const Pair *p, int64_t points, double *out)
{
    const int64_t m = p->movers;
    double squared = 0.0;
    for (int64_t q = 0; q < points; ++q) {
        const double *t = p->traction + DIM * q, size = dot(t, t);
        double w[MOVERS], s[ALONG][MOVERS], f[DIM], shares = 0.0, whole = 0.0;
        if (size == 0.0)
            continue;
        now_at(p, q, w, s);
        for (int i = 0; i < DIM; ++i)
            f[i] = p->weight[q] * t[i];
        for (int64_t k = 0; k < p->corners; ++k) {
            const double share = p->shape[p->corners * q + k];
            double *x = out + DIM * p->slave_rows[p->corners * q + k];
            shares += share * share;
            for (int i = 0; i < DIM; ++i)
                x[i] -= share * f[i];
        }
        for (int64_t k = 0; k < m; ++k) {
            if (p->turn) {
                double *tool = out + DIM * p->first_master;
                whole += w[k];
                tool[DIM] += w[k] * dot(p->turn + DIM * k, f);
                for (int i = 0; i < DIM; ++i)
                    tool[i] += w[k] * f[i];
                continue;
            }
            const int64_t node = p->first_master + p->stencil[m * p->facet[q] + k];
            shares += w[k] * w[k];
            for (int i = 0; i < DIM; ++i) {
                /* What an image turns round comes from the plane, which bears it. */
                const double force = w[k] * f[i], turned = p->signs ? 1.0 - p->signs[DIM * node + i] : 0.0;
                out[DIM * node + i] += force;
                squared += turned * turned * force * force;
            }
        }
        squared += (shares + whole * whole) * p->weight[q] * p->weight[q] * size;
    }
    return squared;
}
