/* Forces and tangent of a contact pair in the plane, the tangent added where it belongs in a sparse
 * matrix.
 *
 * The same operations as forms/contact/kinematics.py and forms/contact/tangent.py, where the
 * formulas are; of the master only the shares of its nodes in the points' places are known, so that
 * it may be a tool as well.
 *
 * Letters: q points, a nodes of a slave facet, m nodes that move a master facet or control points
 * of a tool, n nodes of the pair, k vertices of a slave facet, i and j the plane. Generalised
 * coordinates z of a point: a, b, c, d and, along rays, the slave's chords e_A and e_B.
 */

#include <math.h>
#include <stddef.h>
#include <string.h>

#define DIM 2
#include "matrix_entries.h"

#define CORNERS 4 /* nodes of a slave facet, at most */
#define MOVERS 4  /* nodes that move a master facet, at most */
#define NODES (CORNERS + 2 * MOVERS + 4)
#define KINDS 6 /* a, b, c, d, e_A, e_B */
#define ALL (DIM * KINDS)

enum { A, B, C, D, CHORD };

typedef struct {
    int64_t corners, movers, first_master, vertices;
    /* Slave points: (q), (q, a), rows (q, a) of the pair's nodes; of the vertices of their facets
     * (q, k) the numbers and shape functions, and of each vertex (v + 1) where the entries
     * 2 q + k of its points begin; nodes of the vertices around (q, 4). */
    const double *weight, *shape;
    const int64_t *slave_rows, *of_point;
    const double *vertex_shape;
    const int64_t *around_start, *around, *chain_rows;
    /* Master: nodes (f, m) that move facets; signs (n, i) of the pair's displacements and forces,
     * or none; of a tool dy/d(theta L) (m, i) and the second derivative, or none. */
    const int32_t *stencil;
    const double *signs, *turn, *bend;
    /* Projection: (q); shares (q, m) of nodes and their slopes; (q, i); (q); (q, i) or none. */
    const int32_t *facet;
    const double *share_of, *slope_of, *normal, *tangents, *distance, *curvature;
    const uint8_t *clamped;
    /* Along rays (q, e, i, j), or none; at the end of a master (q), (q), (q, i), (q, i), or none. */
    const double *chords, *share, *share_slope, *share_turn, *per_share;
    /* Contact: (q, i) positions and closest points; (q) felt gap, t_N and, point by point, its
     * change with the gap, or none; (q, i) traction and the law's derivatives. */
    const double *position, *foot, *gap, *spring, *pressure_slope, *traction, *by_slip, *by_elastic;
    const double *by_pressure;
    const uint8_t *closed;
    /* State of the last step: (q), shares (q, m) of the place opposite and of the elastic slip, (q, i),
     * (q, i), (q). */
    const int32_t *facet_before;
    const double *share_before, *slope_before, *anchor, *image, *slip_length;
    /* Vertices: whether they have rows (v), areas (v), mean gap (v) of those whose area is what the
     * master has below them; vectors d (q, k, i) of L. None point by point. */
    const uint8_t *needs;
    const double *area, *grown, *left;
} Pair;

int64_t tribox_plane_pair_size(void)
{
    return (int64_t)sizeof(Pair);
}

/* What a point leaves for the vertices: its nodes, of which the first `lead` feel its force, the
 * rows a (i, n) and those of the changes of its gap and of its share over the master. */
typedef struct {
    int64_t count, lead, node[NODES];
    double a[DIM][DIM * NODES], gap[DIM * NODES], share[DIM * NODES];
} Kept;

int64_t tribox_plane_kept_size(void)
{
    return (int64_t)sizeof(Kept);
}

/* -- variation of one point ------------------------------------------------------------------ */

INLINE double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1];
}

/* Changes with z, all of them: of xi, normal, gap, share, and the traction. */
typedef struct {
    double xi[ALL], n[DIM][ALL], gap[ALL], share[ALL], t[DIM][ALL];
} Change;

static void vary_inside(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q;
    double gap = p->distance[q], metric = dot(tau, tau), over = 1.0 / metric, bend = 0.0;
    if (p->curvature) {
        bend = dot(p->curvature + 2 * q, n);
        over = 1.0 / (metric - gap * bend);
    }
    for (int j = 0; j < DIM; ++j) {
        d->gap[j] = n[j];
        d->xi[j] = over * tau[j], d->xi[2 + j] = over * gap * n[j];
        for (int i = 0; i < DIM; ++i)
            d->n[i][2 + j] = -tau[i] / metric * n[j];
    }
    for (int i = 0; p->curvature && i < DIM; ++i)
        for (int r = 0; r < 4; ++r)
            d->n[i][r] -= tau[i] / metric * bend * d->xi[r];
}

/* At a corner; on the corner itself the direction is undefined, and held. */
static void vary_clamped(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q;
    double gap = p->distance[q];
    double over = fabs(gap) > 1e-12 * sqrt(dot(tau, tau)) ? 1.0 / gap : 0.0;
    for (int j = 0; j < DIM; ++j) {
        d->gap[j] = n[j];
        for (int i = 0; i < DIM; ++i)
            d->n[i][j] = over * ((i == j) - n[i] * n[j]);
    }
}

static void vary_along_ray(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q, *change = p->chords + 8 * q;
    const double along[DIM] = {n[1], -n[0]};
    for (int e = 0; e < 2; ++e)
        for (int i = 0; i < DIM; ++i)
            for (int j = 0; j < DIM; ++j)
                d->n[i][2 * (CHORD + e) + j] = change[4 * e + 2 * i + j];
    for (int r = 0; r < ALL; ++r) {
        d->xi[r] = -p->distance[q] * (along[0] * d->n[0][r] + along[1] * d->n[1][r]);
        d->xi[r] = (d->xi[r] + (r < 2 ? along[r] : 0.0)) / dot(along, tau);
        d->gap[r] = (r < 2 ? n[r] : 0.0) - dot(n, tau) * d->xi[r];
    }
}

/* The share of a point beside the end of a master, or where its ray hardly faces it. */
static void vary_share(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q;
    for (int r = 0; r < ALL; ++r)
        d->share[r] = p->share_slope[q] * d->xi[r];
    if (!p->share_turn)
        return;
    const double *turn = p->share_turn + 2 * q;
    double over = (turn[1] * n[0] - turn[0] * n[1]) / dot(tau, tau);
    for (int r = 0; r < ALL; ++r)
        d->share[r] += turn[0] * d->n[0][r] + turn[1] * d->n[1][r];
    d->share[2] += over * tau[1], d->share[3] -= over * tau[0];
}

/* The part of the variation of (I - n n) v that comes from the normal. */
INLINE void vary_in_plane(const double *n, const double *v, const Change *d, double out[DIM][ALL])
{
    double across = dot(n, v);
    for (int r = 0; r < ALL; ++r) {
        double along = v[0] * d->n[0][r] + v[1] * d->n[1][r];
        for (int i = 0; i < DIM; ++i)
            out[i][r] = -across * d->n[i][r] - n[i] * along;
    }
}

/* The slip's variation, as long as the way on a curved master: see _Arc of kinematics.py. */
static void vary_slip(const Pair *p, int64_t q, const Change *d, double slip[DIM][ALL])
{
    const double *n = p->normal + 2 * q, *tau = p->tangents + 2 * q, *anchor = p->anchor + 2 * q;
    const double *x = p->position + 2 * q, *here = p->clamped[q] ? p->foot + 2 * q : x;
    double apart[DIM] = {here[0] - anchor[0], here[1] - anchor[1]}, plane[DIM][DIM];
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j)
            plane[i][j] = (i == j) - n[i] * n[j];
    vary_in_plane(n, apart, d, slip);
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j)
            slip[i][2 * C + j] += plane[i][j];
    if (p->clamped[q]) {
        for (int r = 0; r < ALL; ++r)
            for (int i = 0; i < DIM; ++i)
                slip[i][r] += plane[i][0] * (tau[0] * d->xi[r] - (r == 0))
                    + plane[i][1] * (tau[1] * d->xi[r] - (r == 1));
        return;
    }
    double across = dot(n, apart), sunk = across - p->distance[q];
    double along[DIM] = {apart[0] - across * n[0], apart[1] - across * n[1]};
    double length = sqrt(dot(along, along));
    if (!(fabs(sunk) < 0.5 * length))
        return;
    double slope = sunk / length, stretch = sqrt(1.0 + 4.0 / 3.0 * slope * slope);
    along[0] /= length, along[1] /= length;
    for (int r = 0; r < ALL; ++r) {
        double grown = apart[0] * d->n[0][r] + apart[1] * d->n[1][r] - d->gap[r];
        if (r / 2 == C)
            grown += n[r % 2];
        grown -= slope * (along[0] * slip[0][r] + along[1] * slip[1][r]);
        grown *= 4.0 / 3.0 * slope / stretch;
        for (int i = 0; i < DIM; ++i)
            slip[i][r] = stretch * slip[i][r] + along[i] * grown;
    }
}

/* That of the elastic slip, which keeps its length. */
static void vary_elastic(const Pair *p, int64_t q, const Change *d, double elastic[DIM][ALL])
{
    const double *n = p->normal + 2 * q, *image = p->image + 2 * q;
    double across = dot(n, image), kept = p->slip_length[q];
    double v[DIM] = {image[0] - across * n[0], image[1] - across * n[1]};
    double length = sqrt(dot(v, v)), scale = length > 0.0 && kept > 0.0 ? kept / length : 0.0;
    double safe = scale > 0.0 ? 1.0 / length : 1.0;
    vary_in_plane(n, image, d, elastic);
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j)
            elastic[i][2 * D + j] += (i == j) - n[i] * n[j];
    for (int r = 0; r < ALL; ++r) {
        double along = safe * safe * (v[0] * elastic[0][r] + v[1] * elastic[1][r]);
        for (int i = 0; i < DIM; ++i)
            elastic[i][r] = scale * (elastic[i][r] - v[i] * along);
    }
}

static void vary_traction(const Pair *p, int64_t q, Change *d)
{
    const double *n = p->normal + 2 * q;
    double slip[DIM][ALL], elastic[DIM][ALL];
    vary_slip(p, q, d, slip);
    vary_elastic(p, q, d, elastic);
    for (int i = 0; i < DIM; ++i) {
        const double *one = p->by_slip + 4 * q + 2 * i, *two = p->by_elastic + 4 * q + 2 * i;
        double by_pressure = n[i] - p->by_pressure[2 * q + i];
        for (int r = 0; r < ALL; ++r) {
            d->t[i][r] = p->spring[q] * d->n[i][r] - one[0] * slip[0][r] - one[1] * slip[1][r]
                - two[0] * elastic[0][r] - two[1] * elastic[1][r];
            if (p->pressure_slope)
                d->t[i][r] += by_pressure * p->pressure_slope[q] * d->gap[r];
            if (p->share_slope)
                d->t[i][r] += p->per_share[2 * q + i] * d->share[r];
        }
    }
}

/* -- the unknowns that move a point ----------------------------------------------------------- */

/* Vectors z, (KINDS, i), by the unknowns of nodes. */
typedef struct {
    int64_t count, lead, node[NODES];
    double z[KINDS][DIM][DIM * NODES];
} Rows;

INLINE int64_t add_node(Rows *g, int64_t node)
{
    g->node[g->count] = node;
    for (int kind = 0; kind < KINDS; ++kind)
        for (int i = 0; i < DIM; ++i)
            for (int j = 0; j < DIM; ++j)
                g->z[kind][i][2 * g->count + j] = 0.0;
    return g->count++;
}

INLINE void add_share(const Pair *p, Rows *g, int64_t at, int kind, double share)
{
    for (int i = 0; i < DIM; ++i)
        g->z[kind][i][2 * at + i] += p->signs ? p->signs[2 * g->node[at] + i] * share : share;
}

/* The master's part of two kinds: shares -w (m) of one, s (m) of the other, of a facet's nodes from
 * `at` on, or of the control points of a tool, whose displacement and angle are there. */
INLINE void add_master(const Pair *p, Rows *g, int64_t at, int kind, const double *w,
                       const double *s)
{
    for (int64_t m = 0; m < p->movers; ++m) {
        const int64_t node = p->turn ? at : at + m;
        add_share(p, g, node, kind, -w[m]);
        add_share(p, g, node, kind + 1, s[m]);
        for (int i = 0; p->turn && i < DIM; ++i) {
            g->z[kind][i][2 * at + 2] -= w[m] * p->turn[2 * m + i];
            g->z[kind + 1][i][2 * at + 2] += s[m] * p->turn[2 * m + i];
        }
    }
}

static void rows_of(const Pair *p, int64_t q, Rows *g)
{
    const double *shape = p->shape + p->corners * q;
    const int64_t m = p->movers, master = p->turn ? 2 : m;
    const int32_t now = p->facet[q], last = p->facet_before[q];
    g->count = 0;
    for (int64_t a = 0; a < p->corners; ++a) {
        int64_t at = add_node(g, p->slave_rows[p->corners * q + a]);
        add_share(p, g, at, A, shape[a]);
        add_share(p, g, at, C, shape[a]);
    }
    int64_t first = g->count, before = first;
    for (int64_t k = 0; k < master; ++k)
        add_node(g, p->first_master + (p->turn ? k : p->stencil[m * now + k]));
    g->lead = g->count;
    if (!p->turn && now != last) {
        before = g->count;
        for (int64_t k = 0; k < m; ++k)
            add_node(g, p->first_master + p->stencil[m * last + k]);
    }
    add_master(p, g, first, A, p->share_of + m * q, p->slope_of + m * q);
    add_master(p, g, before, C, p->share_before + m * q, p->slope_before + m * q);
    for (int k = 0; p->chords && k < 4; ++k) { /* e_A and e_B end at the second next vertex */
        int64_t at = add_node(g, p->chain_rows[4 * q + k]);
        add_share(p, g, at, CHORD + k % 2, k < 2 ? -1.0 : 1.0);
    }
}

/* Row of the unknowns (2 n) of a change by z, times those of z. */
INLINE void by_unknowns(const Pair *p, const Rows *g, const double *change, double *out)
{
    const int kinds = p->chords ? KINDS : CHORD;
    memset(out, 0, sizeof(double) * 2 * g->count);
    for (int kind = 0; kind < kinds; ++kind)
        for (int i = 0; i < DIM; ++i) {
            const double by = change[2 * kind + i], *z = g->z[kind][i];
            for (int64_t l = 0; by != 0.0 && l < 2 * g->count; ++l)
                out[l] += by * z[l];
        }
}

/* -- blocks of points -------------------------------------------------------------------------- */

typedef struct {
    int64_t count, lead, node[NODES];
    double value[DIM * NODES][DIM * NODES];
} Block;

/* Add a block to the matrix; returns 1 where it has no room. */
static int flush(const Entries *e, const Block *b)
{
    int64_t sorted[NODES];
    sort_columns(e, b->node, 0, b->count, sorted);
    for (int64_t n = 0; n < b->lead; ++n) {
        const int32_t row = e->row_first[b->node[n]];
        int32_t from = e->indptr[row];
        for (int64_t l = 0; l < b->count; ++l) {
            const int64_t k = sorted[l];
            from = add_numbers(e, row, e->column_first[b->node[k]], from,
                               &b->value[2 * n][2 * k], DIM * NODES);
            if (from < 0)
                return 1;
        }
    }
    return 0;
}

/* Begin a block of the same nodes as g, unless it is at hand; returns as `flush`. */
static int begin(const Entries *e, const Rows *g, Block *b)
{
    if (g && b->count == g->count
        && !memcmp(b->node, g->node, sizeof(g->node[0]) * (size_t)g->count))
        return 0;
    if (b->count && flush(e, b))
        return 1;
    b->count = g ? g->count : 0;
    if (!g)
        return 0;
    b->lead = g->lead;
    memcpy(b->node, g->node, sizeof(g->node));
    for (int64_t k = 0; k < 2 * b->lead; ++k)
        memset(b->value[k], 0, sizeof(b->value[k]));
    return 0;
}

/* Add -G^T C G of a point; the place moves under the load: -t (du_2,xi) dxi. */
static void add_point(const Pair *p, int64_t q, const Rows *g, const Change *d, Block *b)
{
    double t[DIM][DIM * NODES], xi[DIM * NODES];
    const double weight = p->weight[q], *traction = p->traction + 2 * q;
    for (int i = 0; i < DIM; ++i)
        by_unknowns(p, g, d->t[i], t[i]);
    by_unknowns(p, g, d->xi, xi);
    for (int64_t k = 0; k < 2 * g->lead; ++k) {
        double one = weight * g->z[A][0][k], two = weight * g->z[A][1][k];
        double moved = weight * (traction[0] * g->z[B][0][k] + traction[1] * g->z[B][1][k]);
        for (int64_t l = 0; l < 2 * g->count; ++l)
            b->value[k][l] += moved * xi[l] - one * t[0][l] - two * t[1][l];
    }
}

/* Second derivative of a tool's control points by its angle, times the force on them. */
static double bending(const Pair *p, int64_t q)
{
    double sum = 0.0;
    for (int64_t m = 0; m < p->movers; ++m)
        sum += p->share_of[p->movers * q + m] * dot(p->bend + 2 * m, p->traction + 2 * q);
    return p->weight[q] * sum;
}

/* Add the tangent of points `take` (count), those that are closed or whose gaps count, but for what
 * goes through the vertices; `kept` (count) is for `tribox_plane_vertices`. Returns 1 where the
 * matrix has no room. */
int tribox_plane_points(const Pair *p, const Entries *e, int64_t count, const int64_t *take,
                        Kept *kept)
{
    Block block = {0};
    Rows g;
    double bent = 0.0;
    for (int64_t c = 0; c < count; ++c) {
        const int64_t q = take[c];
        Change d = {{0.0}};
        rows_of(p, q, &g);
        if (p->chords)
            vary_along_ray(p, q, &d);
        else if (p->clamped[q])
            vary_clamped(p, q, &d);
        else
            vary_inside(p, q, &d);
        if (p->share_slope)
            vary_share(p, q, &d);
        if (p->closed[q]) {
            vary_traction(p, q, &d);
            if (begin(e, &g, &block))
                return 1;
            add_point(p, q, &g, &d, &block);
            bent += p->turn ? bending(p, q) : 0.0;
        }
        if (!p->needs)
            continue;
        Kept *k = kept + c;
        const double share = p->share ? p->share[q] : 1.0;
        for (int r = 0; r < ALL; ++r)
            d.gap[r] = share * d.gap[r] + p->gap[q] * d.share[r];
        k->count = g.count, k->lead = g.lead;
        memcpy(k->node, g.node, sizeof(g.node));
        memcpy(k->a, g.z[A], sizeof(k->a));
        by_unknowns(p, &g, d.gap, k->gap);
        if (p->grown)
            by_unknowns(p, &g, d.share, k->share);
    }
    if (begin(e, NULL, &block))
        return 1;
    if (!p->turn)
        return 0;
    const double angle[DIM * DIM] = {bent};
    const int64_t node = p->first_master + 1;
    const int32_t row = e->row_first[node];
    return add_numbers(e, row, e->column_first[node], e->indptr[row], angle, DIM) < 0;
}

/* -- what goes through the vertices ------------------------------------------------------------ */

/* Numbers of nodes at a vertex: nodes (n), their sums (n, i), and where nodes of the pair stand. */
typedef struct {
    int64_t count, *node, *place;
    double *sum;
} Side;

INLINE double *at_node(Side *s, int64_t node)
{
    if (s->place[node] < 0) {
        s->place[node] = s->count;
        s->node[s->count] = node;
        s->sum[2 * s->count] = s->sum[2 * s->count + 1] = 0.0;
        ++s->count;
    }
    return s->sum + 2 * s->place[node];
}

INLINE void clear(Side *s)
{
    for (int64_t n = 0; n < s->count; ++n)
        s->place[s->node[n]] = -1;
    s->count = 0;
}

static void add_to_sides(const Pair *p, int64_t q, int64_t k, const Kept *point, double mean,
                         Side *left, Side *right)
{
    const double weight = p->weight[q], *d = p->left + 4 * q + 2 * k;
    const double share = weight * p->vertex_shape[2 * q + k];
    for (int64_t n = 0; p->closed[q] && n < point->lead; ++n) {
        double *sum = at_node(left, point->node[n]);
        for (int j = 0; j < DIM; ++j)
            sum[j] += weight * (point->a[0][2 * n + j] * d[0] + point->a[1][2 * n + j] * d[1]);
    }
    for (int64_t n = 0; n < point->count; ++n) {
        double *sum = at_node(right, point->node[n]);
        for (int j = 0; j < DIM; ++j) {
            sum[j] += share * point->gap[2 * n + j];
            if (mean != 0.0)
                sum[j] -= share * mean * point->share[2 * n + j];
        }
    }
}

/* Add L_A R_A^T / m_A of a vertex; returns 1 where the matrix has no room. */
static int add_product(const Entries *e, const Side *left, const Side *right, double area,
                       int64_t *sorted)
{
    sort_columns(e, right->node, 0, right->count, sorted);
    for (int64_t n = 0; n < left->count; ++n) {
        const int32_t row = e->row_first[left->node[n]];
        const double one = left->sum[2 * n] / area, two = left->sum[2 * n + 1] / area;
        int32_t from = e->indptr[row];
        for (int64_t l = 0; l < right->count; ++l) {
            const double *r = right->sum + 2 * sorted[l];
            const double x[] = {one * r[0], one * r[1], two * r[0], two * r[1]};
            from = add_numbers(e, row, e->column_first[right->node[sorted[l]]], from, x, DIM);
            if (from < 0)
                return 1;
        }
    }
    return 0;
}

/* Add sum_A L_A R_A^T / m_A. `slot` (q) says where points stand in `kept`, -1 where they do not.
 * Scratch: places (2, nodes), all -1; numbers (3, room) and sums (2, room, i) for as many nodes as
 * a vertex may have. Returns 1 where the matrix has no room. */
int tribox_plane_vertices(const Pair *p, const Entries *e, const int32_t *slot, const Kept *kept,
                          int64_t nodes, int64_t room, int64_t *places, int64_t *numbers,
                          double *sums)
{
    Side left = {0, numbers, places, sums};
    Side right = {0, numbers + room, places + nodes, sums + 2 * room};
    for (int64_t v = 0; v < p->vertices; ++v) {
        if (!p->needs[v])
            continue;
        for (int64_t at = p->around_start[v]; at < p->around_start[v + 1]; ++at) {
            const int64_t q = p->around[at] / 2, k = p->around[at] % 2;
            if (slot[q] >= 0)
                add_to_sides(p, q, k, kept + slot[q], p->grown ? p->grown[v] : 0.0, &left, &right);
        }
        const int failed = add_product(e, &left, &right, p->area[v], numbers + 2 * room);
        clear(&left);
        clear(&right);
        if (failed)
            return 1;
    }
    return 0;
}

/* -- slip -------------------------------------------------------------------------------------- */

/* Where the place of the last step is now, on a master with the nodes x (n, i), and the elastic slip
 * carried along with the components (q), beside what `image` has from other masters; slip and
 * elastic slip, as forms/contact/kinematics.py. */
void tribox_plane_relate(const Pair *p, int64_t points, const double *x, const double *components,
                         double *anchor, double *image, double *slip, double *elastic)
{
    for (int64_t q = 0; q < points; ++q) {
        const double *n = p->normal + 2 * q, *here = (p->clamped[q] ? p->foot : p->position) + 2 * q;
        const int32_t *node = p->stencil + p->movers * p->facet_before[q];
        double foot[DIM] = {0.0}, v[DIM] = {0.0}, s[DIM];
        for (int64_t m = 0; m < p->movers; ++m)
            for (int i = 0; i < DIM; ++i) {
                foot[i] += p->share_before[p->movers * q + m] * x[2 * node[m] + i];
                v[i] += p->slope_before[p->movers * q + m] * x[2 * node[m] + i];
            }
        for (int i = 0; i < DIM; ++i) {
            v[i] = components[q] * v[i] + (p->image ? p->image[2 * q + i] : 0.0);
            anchor[2 * q + i] = foot[i], image[2 * q + i] = v[i];
            s[i] = here[i] - foot[i];
        }
        double across = dot(n, s), along = dot(n, v), stretch = 1.0;
        s[0] -= across * n[0], s[1] -= across * n[1], v[0] -= along * n[0], v[1] -= along * n[1];
        double length = sqrt(dot(s, s)), size = sqrt(dot(v, v)), sunk = across - p->distance[q];
        if (!p->clamped[q] && fabs(sunk) < 0.5 * length)
            stretch = sqrt(1.0 + 4.0 / 3.0 * (sunk / length) * (sunk / length));
        double scale = size > 0.0 && p->slip_length[q] > 0.0 ? p->slip_length[q] / size : 0.0;
        for (int i = 0; i < DIM; ++i) {
            slip[2 * q + i] = p->closed[q] ? stretch * s[i] : 0.0;
            elastic[2 * q + i] = scale * v[i];
        }
    }
}

/* -- forces ------------------------------------------------------------------------------------ */

/* Add the residual -G^T (w t) of all points to the pair's nodes (n, i); returns the sum of the
 * squares of what each point adds, but for moments on a tool. */
double tribox_plane_forces(const Pair *p, int64_t points, double *out)
{
    const int64_t m = p->movers;
    double squared = 0.0;
    for (int64_t q = 0; q < points; ++q) {
        const double *t = p->traction + 2 * q, f[DIM] = {p->weight[q] * t[0], p->weight[q] * t[1]};
        if (t[0] == 0.0 && t[1] == 0.0)
            continue;
        for (int64_t a = 0; a < p->corners; ++a)
            for (int i = 0; i < DIM; ++i) {
                double force = p->shape[p->corners * q + a] * f[i];
                out[2 * p->slave_rows[p->corners * q + a] + i] -= force;
                squared += force * force;
            }
        double moment = 0.0, whole[DIM] = {0.0};
        for (int64_t k = 0; k < m; ++k) {
            const double share = p->share_of[m * q + k];
            if (p->turn) {
                moment += share * dot(p->turn + 2 * k, f);
                whole[0] += share * f[0], whole[1] += share * f[1];
                continue;
            }
            const int64_t node = p->first_master + p->stencil[m * p->facet[q] + k];
            for (int i = 0; i < DIM; ++i) {
                /* What an image turns round comes from the plane, which bears it. */
                double force = share * f[i], turned = p->signs ? 1.0 - p->signs[2 * node + i] : 0.0;
                out[2 * node + i] += force;
                squared += (1.0 + turned * turned) * force * force;
            }
        }
        if (p->turn) {
            double *tool = out + 2 * p->first_master;
            tool[0] += whole[0], tool[1] += whole[1], tool[2] += moment;
            squared += dot(whole, whole);
        }
    }
    return squared;
}
