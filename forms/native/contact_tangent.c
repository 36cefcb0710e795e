/* The tangent of a contact pair in space, added where it belongs in a sparse matrix.
 *
 * The same operations as forms/contact/kinematics.py and forms/contact/tangent.py, where the
 * formulas are. Points that touch the same facets, now and at the last step, make up a group: their
 * blocks are added up before they are put into the matrix.
 *
 * Letters: q points, a nodes of a slave facet, m nodes that move a master facet, n both together, k
 * vertices of a slave facet, i and j space. Generalised coordinates of a point: a, b_1, b_2, c, d,
 * each with three components.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define DIM 3
#include "matrix_entries.h"

#define SHAPES 16 /* shape functions of a master facet, at most */
#define MOVERS 64 /* nodes that move a master facet, at most */
#define CORNERS 9 /* nodes of a slave facet, at most */
#define WIDTH (DIM * (CORNERS + 2 * MOVERS))
#define NOW 9     /* coordinates that the present projection depends on: a, b_1, b_2 */
#define ALL 15

typedef struct {
    int64_t shapes, movers, corners, first_master, vertices;
    /* Master: powers (c, 2) of monomials and coefficients (c, c); control points from nodes
     * (f, c, m) or none; nodes that move the facets (f, m). */
    const int32_t *powers;
    const double *coefficients, *extraction;
    const int32_t *stencil;
    /* Signs (n, i) of displacements and forces of the pair's nodes, or none. */
    const double *signs;
    /* Slave points: (q), (q, a), rows (q, a) of the pair's nodes. */
    const double *weight, *shape;
    const int64_t *slave_rows;
    /* Projection: (q), (q, 2), (q, i), (q, 2, i), (q), (q, 2, 2, i) or none, (q), (q, 2). */
    const int32_t *facet;
    const double *xi, *normal, *tangents, *gap, *curvature;
    const uint8_t *clamped;
    const double *along;
    /* Contact: (q, i) positions and closest points; (q) t_N and its change with the own gap, or
     * none; (q, i) traction and the law's derivatives, (q, i, j) and (q, i). */
    const double *position, *foot, *spring, *pressure_slope, *traction, *by_slip, *by_elastic;
    const double *by_pressure;
    /* State of the last step: (q), (q, 2), (q, 2), (q, 2), (q, i), (q, i), (q). */
    const int32_t *facet_before;
    const double *xi_before, *ahead, *components, *anchor, *image, *slip_length;
} Pair;

int64_t tribox_tangent_pair_size(void)
{
    return (int64_t)sizeof(Pair);
}

/* -- master facets -------------------------------------------------------------------------- */

/* Shares w (m) of the nodes of a facet's stencil in the place xi, and their slopes (2, m). */
INLINE void shares(const Pair *p, int64_t shapes, int64_t movers, int32_t facet, const double *xi,
                   double *w, double s[2][MOVERS])
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
static EXPORT void shares_at(const Pair *p, int32_t facet, const double *xi, double *w,
                             double s[2][MOVERS])
{
    if (p->shapes == 4 && p->movers == 4)
        shares(p, 4, 4, facet, xi, w, s);
    else if (p->shapes == 16 && p->movers == 16)
        shares(p, 16, 16, facet, xi, w, s);
    else
        shares(p, p->shapes, p->movers, facet, xi, w, s);
}

/* -- variation of one point ------------------------------------------------------------------ */

INLINE double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

INLINE void invert(double a, double b, double c, double inverse[2][2])
{
    double over = a * c - b * b;
    inverse[0][0] = c / over, inverse[1][1] = a / over;
    inverse[0][1] = inverse[1][0] = -b / over;
}

/* Of a point inside a facet: d_xi (2, NOW) and d_normal (i, NOW). */
INLINE void vary_inside(const Pair *p, int64_t q, double d_xi[2][NOW], double d_n[DIM][NOW])
{
    const double *n = p->normal + DIM * q, *tau[2] = {p->tangents + 6 * q, p->tangents + 6 * q + 3};
    double gap = p->gap[q], inverse[2][2], up[2][DIM], bend[2][2] = {{0.0}};
    double a = dot(tau[0], tau[0]), b = dot(tau[0], tau[1]), c = dot(tau[1], tau[1]);
    invert(a, b, c, inverse);
    for (int e = 0; e < 2; ++e)
        for (int i = 0; i < DIM; ++i)
            up[e][i] = inverse[e][0] * tau[0][i] + inverse[e][1] * tau[1][i];
    if (p->curvature) {
        for (int e = 0; e < 2; ++e)
            for (int f = 0; f < 2; ++f)
                bend[e][f] = dot(p->curvature + 12 * q + 6 * e + 3 * f, n);
        invert(a - gap * bend[0][0], b - gap * bend[0][1], c - gap * bend[1][1], inverse);
    }
    for (int e = 0; e < 2; ++e)
        for (int i = 0; i < DIM; ++i) {
            d_xi[e][i] = inverse[e][0] * tau[0][i] + inverse[e][1] * tau[1][i];
            d_xi[e][3 + i] = inverse[e][0] * gap * n[i];
            d_xi[e][6 + i] = inverse[e][1] * gap * n[i];
        }
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j) {
            d_n[i][j] = 0.0;
            d_n[i][3 + j] = -up[0][i] * n[j];
            d_n[i][6 + j] = -up[1][i] * n[j];
        }
    if (!p->curvature)
        return;
    for (int r = 0; r < NOW; ++r) {
        double one = bend[0][0] * d_xi[0][r] + bend[0][1] * d_xi[1][r];
        double two = bend[1][0] * d_xi[0][r] + bend[1][1] * d_xi[1][r];
        for (int i = 0; i < DIM; ++i)
            d_n[i][r] -= up[0][i] * one + up[1][i] * two;
    }
}

/* The same of a point on a side or at a corner. */
INLINE void vary_clamped(const Pair *p, int64_t q, double d_xi[2][NOW], double d_n[DIM][NOW])
{
    const double *n = p->normal + DIM * q, *tau[2] = {p->tangents + 6 * q, p->tangents + 6 * q + 3};
    const double *e = p->along + 2 * q;
    double gap = p->gap[q], t[DIM], stiffness, d_apart[DIM][NOW];
    for (int i = 0; i < DIM; ++i)
        t[i] = e[0] * tau[0][i] + e[1] * tau[1][i];
    stiffness = dot(t, t);
    if (p->curvature) {
        double change = 0.0;
        for (int b = 0; b < 2; ++b)
            for (int c = 0; c < 2; ++c)
                change += e[b] * e[c] * dot(p->curvature + 12 * q + 6 * b + 3 * c, n);
        stiffness -= gap * change;
    }
    for (int b = 0; b < 2; ++b) {
        double over = stiffness != 0.0 ? e[b] / stiffness : 0.0;
        for (int i = 0; i < DIM; ++i) {
            d_xi[b][i] = over * t[i];
            d_xi[b][3 + i] = over * e[0] * gap * n[i];
            d_xi[b][6 + i] = over * e[1] * gap * n[i];
        }
    }
    for (int i = 0; i < DIM; ++i)
        for (int r = 0; r < NOW; ++r)
            d_apart[i][r] = (r == i) - tau[0][i] * d_xi[0][r] - tau[1][i] * d_xi[1][r];
    /* On the edge itself the direction is undefined; the normal is then held. */
    double length = sqrt(fmax(dot(tau[0], tau[0]), dot(tau[1], tau[1])));
    double over = fabs(gap) > 1e-12 * length ? 1.0 / gap : 0.0;
    for (int r = 0; r < NOW; ++r) {
        double across = 0.0;
        for (int i = 0; i < DIM; ++i)
            across += n[i] * d_apart[i][r];
        for (int i = 0; i < DIM; ++i)
            d_n[i][r] = over * (d_apart[i][r] - n[i] * across);
    }
}

/* The part of the variation (i, NOW) of (I - n n) v that comes from the normal. */
INLINE void vary_in_plane(const double *n, const double *v, double d_n[DIM][NOW],
                          double out[DIM][ALL])
{
    double across = dot(n, v);
    for (int r = 0; r < NOW; ++r) {
        double along = v[0] * d_n[0][r] + v[1] * d_n[1][r] + v[2] * d_n[2][r];
        for (int i = 0; i < DIM; ++i)
            out[i][r] = -across * d_n[i][r] - n[i] * along;
    }
    for (int i = 0; i < DIM; ++i)
        for (int r = NOW; r < ALL; ++r)
            out[i][r] = 0.0;
}

/* The slip's image in the tangent plane becomes as long as the way on a curved master, as in
 * kinematics.py: its variation (i, ALL) from that of the image. */
INLINE void vary_arc(const Pair *p, int64_t q, const double *apart, double d_n[DIM][NOW],
                     double slip[DIM][ALL])
{
    const double *n = p->normal + DIM * q;
    double across = dot(n, apart), sunk = across - p->gap[q], along[DIM];
    for (int i = 0; i < DIM; ++i)
        along[i] = apart[i] - across * n[i];
    double length = sqrt(dot(along, along));
    if (p->clamped[q] || !(fabs(sunk) < 0.5 * length))
        return;
    for (int i = 0; i < DIM; ++i)
        along[i] /= length;
    double slope = sunk / length, stretch = sqrt(1.0 + 4.0 / 3.0 * slope * slope);
    for (int r = 0; r < ALL; ++r) {
        double grown = 0.0;
        for (int i = 0; i < DIM; ++i)
            grown -= slope * along[i] * slip[i][r];
        if (r < NOW)
            grown += apart[0] * d_n[0][r] + apart[1] * d_n[1][r] + apart[2] * d_n[2][r];
        if (r < DIM)
            grown -= n[r];
        else if (r >= NOW && r < NOW + DIM)
            grown += n[r - NOW];
        grown *= 4.0 / 3.0 * slope / stretch;
        for (int i = 0; i < DIM; ++i)
            slip[i][r] = stretch * slip[i][r] + along[i] * grown;
    }
}

/* Weight times the variation of the traction (i, ALL), and d_xi (2, NOW). */
static EXPORT void vary_traction(const Pair *p, int64_t q, double out[DIM][ALL],
                                 double d_xi[2][NOW])
{
    const double *n = p->normal + DIM * q, *tau[2] = {p->tangents + 6 * q, p->tangents + 6 * q + 3};
    const double *image = p->image + DIM * q, *anchor = p->anchor + DIM * q;
    double d_n[DIM][NOW], slip[DIM][ALL], elastic[DIM][ALL], plane[DIM][DIM], apart[DIM], v[DIM];
    const double *here = p->clamped[q] ? p->foot + DIM * q : p->position + DIM * q;
    if (p->clamped[q])
        vary_clamped(p, q, d_xi, d_n);
    else
        vary_inside(p, q, d_xi, d_n);
    double across = dot(n, image);
    for (int i = 0; i < DIM; ++i) {
        apart[i] = here[i] - anchor[i];
        v[i] = image[i] - across * n[i];
        for (int j = 0; j < DIM; ++j)
            plane[i][j] = (i == j) - n[i] * n[j];
    }
    vary_in_plane(n, apart, d_n, slip);
    vary_in_plane(n, image, d_n, elastic);
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j)
            slip[i][9 + j] += plane[i][j], elastic[i][12 + j] += plane[i][j];
    if (p->clamped[q])
        for (int r = 0; r < NOW; ++r) {
            double foot[DIM];
            for (int i = 0; i < DIM; ++i)
                foot[i] = tau[0][i] * d_xi[0][r] + tau[1][i] * d_xi[1][r] - (r == i);
            for (int i = 0; i < DIM; ++i)
                slip[i][r] += dot(plane[i], foot);
        }
    vary_arc(p, q, apart, d_n, slip);
    /* The elastic slip keeps its length. */
    double length = sqrt(dot(v, v)), kept = p->slip_length[q];
    double scale = length > 0.0 && kept > 0.0 ? kept / length : 0.0;
    double safe = scale > 0.0 ? 1.0 / length : 1.0;
    const double way[DIM] = {v[0] * safe, v[1] * safe, v[2] * safe};
    for (int r = 0; r < ALL; ++r) {
        double along = way[0] * elastic[0][r] + way[1] * elastic[1][r] + way[2] * elastic[2][r];
        for (int i = 0; i < DIM; ++i)
            elastic[i][r] = scale * (elastic[i][r] - way[i] * along);
    }
    for (int i = 0; i < DIM; ++i) {
        const double *by_slip = p->by_slip + 9 * q + 3 * i;
        const double *by_elastic = p->by_elastic + 9 * q + 3 * i;
        for (int r = 0; r < ALL; ++r) {
            double sum = r < NOW ? p->spring[q] * d_n[i][r] : 0.0;
            for (int j = 0; j < DIM; ++j)
                sum -= by_slip[j] * slip[j][r] + by_elastic[j] * elastic[j][r];
            out[i][r] = p->weight[q] * sum;
        }
        if (p->pressure_slope) {
            double by = p->weight[q] * p->pressure_slope[q] * (n[i] - p->by_pressure[DIM * q + i]);
            for (int j = 0; j < DIM; ++j)
                out[i][j] += by * n[j];
        }
    }
}

/* -- blocks of groups of points -------------------------------------------------------------- */

/* Add -G^T C G of a point to the block (a + m, i, n, j) of its group, which has `width` nodes. */
INLINE void add_point_of(const Pair *p, int64_t q, int64_t a, int64_t m, int folded, double *block)
{
    const int64_t size = DIM * (a + m + (folded ? 0 : m)), now = DIM * (a + m);
    double w[MOVERS], s[2][MOVERS], before[MOVERS], slope[2][MOVERS];
    double dt[DIM][ALL], d_xi[2][NOW], v[DIM][WIDTH], e[2][WIDTH], f[WIDTH];
    const double *shape = p->shape + a * q, *parts = p->components + 2 * q;
    const double *ahead = p->ahead + 2 * q;
    vary_traction(p, q, dt, d_xi);
    shares_at(p, p->facet[q], p->xi + 2 * q, w, s);
    shares_at(p, p->facet_before[q], p->xi_before + 2 * q, before, slope);
    for (int64_t k = 0; k < m; ++k) {
        before[k] += ahead[0] * slope[0][k] + ahead[1] * slope[1][k];
        slope[0][k] = parts[0] * slope[0][k] + parts[1] * slope[1][k];
    }
    for (int i = 0; i < DIM; ++i) {
        const double *c = dt[i];
        for (int64_t k = 0; k < a; ++k)
            for (int j = 0; j < DIM; ++j)
                v[i][DIM * k + j] = shape[k] * (c[j] + c[9 + j]);
        for (int64_t k = 0; k < m; ++k)
            for (int j = 0; j < DIM; ++j)
                v[i][DIM * (a + k) + j] = s[0][k] * c[3 + j] + s[1][k] * c[6 + j] - w[k] * c[j];
        double *last = v[i] + (folded ? DIM * a : now);
        for (int64_t k = 0; k < m; ++k)
            for (int j = 0; j < DIM; ++j) {
                double more = slope[0][k] * c[12 + j] - before[k] * c[9 + j];
                last[DIM * k + j] = folded ? last[DIM * k + j] + more : more;
            }
    }
    for (int b = 0; b < 2; ++b) {
        const double *c = d_xi[b];
        for (int64_t k = 0; k < a; ++k)
            for (int j = 0; j < DIM; ++j)
                e[b][DIM * k + j] = shape[k] * c[j];
        for (int64_t k = 0; k < m; ++k)
            for (int j = 0; j < DIM; ++j)
                e[b][DIM * (a + k) + j] = s[0][k] * c[3 + j] + s[1][k] * c[6 + j] - w[k] * c[j];
    }
    for (int64_t k = 0; k < a; ++k)
        for (int i = 0; i < DIM; ++i) {
            double *row = block + (DIM * k + i) * size;
            for (int64_t l = 0; l < size; ++l)
                row[l] -= shape[k] * v[i][l];
        }
    for (int64_t k = 0; k < m; ++k) {
        for (int64_t l = 0; l < now; ++l)
            f[l] = s[0][k] * e[0][l] + s[1][k] * e[1][l];
        for (int i = 0; i < DIM; ++i) {
            double *row = block + (DIM * (a + k) + i) * size;
            double force = p->weight[q] * p->traction[DIM * q + i];
            for (int64_t l = 0; l < now; ++l)
                row[l] += w[k] * v[i][l] + force * f[l];
            for (int64_t l = now; l < size; ++l)
                row[l] += w[k] * v[i][l];
        }
    }
}

/* The same, with sizes that the compiler knows where they are common. */
static EXPORT void add_point(const Pair *p, int64_t q, int64_t width, double *block)
{
    const int64_t a = p->corners, m = p->movers;
    if (a == 4 && m == 4 && width == 8)
        add_point_of(p, q, 4, 4, 1, block);
    else if (a == 4 && m == 16 && width == 20)
        add_point_of(p, q, 4, 16, 1, block);
    else
        add_point_of(p, q, a, m, width == a + m, block);
}

/* Add rows [low, high) of a block, columns of the nodes in `sorted` (count), with their signs. */
INLINE int add_rows(const Entries *e, const double *signs, const int64_t *nodes, int64_t low,
                    int64_t high, const int64_t *sorted, int64_t count, const double *block,
                    int64_t width)
{
    for (int64_t k = low; k < high; ++k) {
        const int32_t row = e->row_first[nodes[k]];
        int32_t from = e->indptr[row];
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
            from = add_numbers(e, row, e->column_first[nodes[n]], from, x, step);
            if (from < 0)
                return 1;
        }
    }
    return 0;
}

/* The blocks of groups of points: group g has the points order[start[g]] ..., of one slave facet,
 * one present master facet and one of the last step. What couples the nodes of the master is added
 * when the last of the groups with the same two facets, one after the other, is done. `block` is
 * scratch. Returns 1 where the matrix has no room. */
int tribox_add_point_blocks(const Pair *p, const Entries *e, int64_t groups,
                                   const int64_t *start, const int64_t *order, double *block)
{
    const int64_t a = p->corners, rows = a + p->movers;
    int64_t nodes[CORNERS + 2 * MOVERS], sorted[CORNERS + 2 * MOVERS], every[CORNERS + 2 * MOVERS];
    int32_t now = -1, last = -1;
    for (int64_t g = 0; g < groups; ++g) {
        const int64_t q = order[start[g]];
        const int new = p->facet[q] != now || p->facet_before[q] != last;
        now = p->facet[q], last = p->facet_before[q];
        const int64_t width = rows + (now == last ? 0 : p->movers), size = DIM * width;
        for (int64_t k = 0; k < a; ++k)
            nodes[k] = p->slave_rows[a * q + k];
        if (new) {
            memset(block, 0, sizeof(double) * DIM * rows * size);
            for (int64_t k = 0; k < p->movers; ++k) {
                nodes[a + k] = p->first_master + p->stencil[p->movers * now + k];
                nodes[rows + k] = p->first_master + p->stencil[p->movers * last + k];
            }
            sort_columns(e, nodes, a, width, sorted);
        } else {
            memset(block, 0, sizeof(double) * DIM * a * size);
            for (int64_t k = DIM * a; k < DIM * rows; ++k)
                memset(block + k * size, 0, sizeof(double) * DIM * a);
        }
        for (int64_t k = start[g]; k < start[g + 1]; ++k)
            add_point(p, order[k], width, block);
        sort_columns(e, nodes, 0, width, every);
        if (add_rows(e, p->signs, nodes, 0, a, every, width, block, width))
            return 1;
        sort_columns(e, nodes, 0, a, every);
        if (add_rows(e, p->signs, nodes, a, rows, every, a, block, width))
            return 1;
        const int64_t next = g + 1 < groups ? order[start[g + 1]] : -1;
        if (next >= 0 && p->facet[next] == now && p->facet_before[next] == last)
            continue;
        if (add_rows(e, p->signs, nodes, a, rows, sorted, width - a, block, width))
            return 1;
    }
    return 0;
}

/* Add the blocks of groups of points, each with `width` nodes, to (g, width, i, width, j). */
void tribox_point_blocks(const Pair *p, int64_t groups, const int64_t *start,
                         const int64_t *order, int64_t width, double *blocks)
{
    for (int64_t g = 0; g < groups; ++g)
        for (int64_t k = start[g]; k < start[g + 1]; ++k)
            add_point(p, order[k], width, blocks + g * DIM * width * DIM * width);
}

/* -- rows of the vertices -------------------------------------------------------------------- */

/* Rows of the vertices against nodes, one entry for each pair that occurs in a group of points.
 *
 * Args: groups (g) by a point of theirs; vertices (q, k) of points and whether they have a row (v);
 * how many; `mark` (nodes) scratch, `of_vertex` (v + 1) and `member` (g k) too. Results: indptr
 * (v + 1), nodes of the entries, and place (g, k, a + m) of each, -1 without a row. */
void tribox_vertex_places(const Pair *p, int64_t groups, const int64_t *point,
                          const int64_t *of_point, const uint8_t *needs, int64_t count,
                          int64_t nodes, int64_t *mark, int64_t *of_vertex, int64_t *member,
                          int64_t *indptr, int64_t *node, int32_t *place)
{
    const int64_t k = p->vertices, size = p->corners + p->movers;
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
    int64_t found = 0, begin = 0;
    for (int64_t v = 0; v < count; ++v) {
        const int64_t first = found, end = of_vertex[v];
        indptr[v] = first;
        for (int64_t at = begin; at < end; ++at) {
            const int64_t q = point[member[at] / k];
            int32_t *places = place + member[at] * size;
            for (int64_t n = 0; n < size; ++n) {
                const int64_t number = n < p->corners ? p->slave_rows[p->corners * q + n]
                    : p->first_master + p->stencil[p->movers * p->facet[q] + n - p->corners];
                if (needs[v] && mark[number] < first) {
                    mark[number] = found;
                    node[found++] = number;
                }
                places[n] = needs[v] ? (int32_t)mark[number] : -1;
            }
        }
        begin = end;
    }
    indptr[count] = found;
}

/* Add w G_a^T d_k of points, with vectors d (p, k, i), to the entries (…, i) of the vertices. */
void tribox_vertex_rows(const Pair *p, int64_t points, const int64_t *take,
                               const int64_t *group, const int32_t *place, const double *along,
                               double *data)
{
    const int64_t k = p->vertices, a = p->corners, size = a + p->movers;
    for (int64_t c = 0; c < points; ++c) {
        const int64_t q = take[c];
        double w[MOVERS], s[2][MOVERS], share[CORNERS + MOVERS];
        shares_at(p, p->facet[q], p->xi + 2 * q, w, s);
        for (int64_t n = 0; n < size; ++n)
            share[n] = p->weight[q] * (n < a ? p->shape[a * q + n] : -w[n - a]);
        for (int64_t l = 0; l < k; ++l) {
            const int32_t *places = place + (group[c] * k + l) * size;
            const double *d = along + (c * k + l) * DIM;
            if (places[0] < 0)
                continue;
            for (int64_t n = 0; n < size; ++n)
                for (int i = 0; i < DIM; ++i)
                    data[DIM * places[n] + i] += share[n] * d[i];
        }
    }
}

typedef double four __attribute__((vector_size(32), aligned(8)));

/* Add sum_A L_A R_A^T / m_A. L and R have rows of vertices A with entries (…, i) at nodes, R with
 * a zero after each three; `area` (v); `node_of` the columns of the matrix, -1 but for the first of
 * a node; `by_node` (rows + 1), `vertex` and `entry` (entries of L) scratch, and of the columns
 * `seen` and sums (i, j and a zero). Nodes that are not in the matrix are left out. Returns 1 where
 * it has no room. */
EXPORT int tribox_add_product(const Entries *e, int64_t vertices, const double *area,
                              int64_t rows, const int64_t *left, const int64_t *left_node,
                              const double *left_data, int64_t columns, const int64_t *right,
                              const int64_t *right_node, const double *right_data,
                              int64_t *by_node, int64_t *vertex, int64_t *entry, int64_t *seen,
                              const int32_t *node_of, double *sum)
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
        int64_t count = 0;
        if (row < 0)
            continue;
        for (int64_t at = begin; at < by_node[n]; ++at) {
            const int64_t v = vertex[at];
            const double *l = left_data + DIM * entry[at], over = 1.0 / area[v];
            const double one = over * l[0], two = over * l[1], three = over * l[2];
            for (int64_t k = right[v]; k < right[v + 1]; ++k) {
                const int64_t column = right_node[k];
                if (seen[column] != n) {
                    seen[column] = n;
                    count += e->column_first[column] >= 0;
                    memset(sum + 4 * DIM * column, 0, sizeof(double) * 4 * DIM);
                }
            }
            for (int64_t k = right[v]; k < right[v + 1]; ++k) {
                const four r = *(const four *)(right_data + 4 * k);
                four *x = (four *)(sum + 4 * DIM * right_node[k]);
                x[0] += one * r, x[1] += two * r, x[2] += three * r;
            }
        }
        /* So many columns are touched that going along the row is faster than searching it. */
        for (int32_t place = e->indptr[row]; count && place < e->indptr[row + 1]; ++place) {
            const int32_t column = e->indices[place], node = node_of[column];
            if (node < 0 || seen[node] != n)
                continue;
            if (!add_at(e, row, column, place, sum + 4 * DIM * node, 4))
                return 1;
            --count;
        }
        if (count)
            return 1;
    }
    return 0;
}

/* -- forces ---------------------------------------------------------------------------------- */

/* Add the residual -G^T (w t) of all points to the pair's nodes (…, i); returns the sum of the
 * squares of what each point adds. */
double tribox_nodal_forces(const Pair *p, int64_t points, double *out)
{
    double squared = 0.0;
    for (int64_t q = 0; q < points; ++q) {
        const double *t = p->traction + DIM * q, weight = p->weight[q];
        double w[MOVERS], s[2][MOVERS], shares = 0.0;
        if (t[0] == 0.0 && t[1] == 0.0 && t[2] == 0.0)
            continue;
        shares_at(p, p->facet[q], p->xi + 2 * q, w, s);
        const int32_t *movers = p->stencil + p->movers * p->facet[q];
        for (int64_t k = 0; k < p->corners; ++k) {
            const double share = p->shape[p->corners * q + k];
            double *x = out + DIM * p->slave_rows[p->corners * q + k];
            shares += share * share;
            for (int i = 0; i < DIM; ++i)
                x[i] -= share * weight * t[i];
        }
        for (int64_t m = 0; m < p->movers; ++m) {
            double *x = out + DIM * (p->first_master + movers[m]);
            shares += w[m] * w[m];
            for (int i = 0; i < DIM; ++i)
                x[i] += w[m] * weight * t[i];
        }
        squared += shares * weight * weight * dot(t, t);
    }
    return squared;
}
