/* A contact pair of an explicit step, point by point: what is the same in the plane and in space.
 *
 * The source that includes this says how many dimensions there are, DIM, and how a point is
 * projected. The operations are those of forms/contact/explicit.py, in two passes. The first finds
 * the closest points on the candidate facets and adds the gaps up at the slave's vertices. From the
 * sums of all ranks the caller finds the vertices' pressures. The second gives pressure, slip
 * against the material point of the last step and transport of the elastic slip. The nodal loads
 * follow the friction law, which is not here. Steps are so short that closest points serve as the
 * places that open points are opposite.
 */

#include <math.h>
#include <stdint.h>

#define ALONG (DIM - 1) /* directions along a surface, alpha */

typedef struct {
    /* Sizes and numbers. */
    int64_t points, corners, candidates, nodes, first_master, vertices, averaged;
    int64_t facet_count, facet_nodes, facet_vertices, around_most;
    double touching, roundoff, slack, tie;
    double moved; /* m, how far nodes have moved since the search, at most */
    /* Slave points: (q), (q, a), (q, alpha, a), (q, i), (q, alpha, i); rows (q, a) of the pair's
     * nodes. */
    const double *weight, *shape, *slope, *reference, *direction;
    const int64_t *rows;
    /* Master: (n, i) positions, (f, a) nodes. */
    const double *master;
    const int32_t *facets;
    /* In the plane the facets that end and start at a node (n). */
    const int32_t *previous, *next;
    /* In space facets around a node and which of their corners it is (n, v), facets across each
     * side and which of their sides it is (f, s), -1 where there is none; (n) nodes at an open
     * end; what the projection notes of facets (f, 10) and of far points (q, 13). */
    const int32_t *around, *around_corner, *across, *across_side;
    const uint8_t *open;
    double *facet_notes, *far_notes;
    /* Penalty (q) of points, where the pressure is not averaged; where it is, in the plane, the way
     * (q) up to the open end of the master over which a point fades. Pressure (q) of the dashpots
     * of points that are closed, likewise not averaged. */
    const double *penalty, *reach, *damping;
    /* Vertices of the slave facets: (q, k) numbers and shape functions; the sums (2, v) of gaps and
     * of covered area that the first pass makes; (v) what the second pass is given. */
    const int64_t *of_point;
    const double *vertex_shape;
    double *sums;
    const double *nodal_pressure;
    const uint8_t *active;
    /* Search: candidates (q, k), and where points and nodes were then. */
    const int32_t *candidate;
    const double *searched_points, *searched_nodes;
    /* Nodal values gathered, and nodal loads to add, (m, i). */
    const double *values;
    double *load;
    /* State of the last step, (q), (q, alpha). */
    const int32_t *facet_before;
    const double *xi_before, *component_before, *length_before, *share_before, *sunk_before;
    /* Results: current nodes (n, i), then per point. */
    double *current, *position, *area_ratio, *xi, *foot, *normal, *tangent, *gap, *slip, *way, *elastic;
    double *pressure, *traction, *component, *length, *gap_after, *friction, *viscous, *work;
    double *share, *present, *sunk, *lost;
    int32_t *facet;
    uint8_t *clamped, *on_surface, *closed;
    /* Film: traction (q, i), viscosity (q), friction without it (q, i), compliance (q). */
    double *tau, *film, *dry;
    const double *compliance;
} Pair;

/* For the caller to compare with the structure that it lays out itself. */
int64_t tribox_pair_size(void)
{
    return (int64_t)sizeof(Pair);
}

/* -- vectors ------------------------------------------------------------------------------- */

typedef struct {
    double c[DIM];
} Vector;

static inline Vector at(const double *a, int64_t k)
{
    Vector v;
    for (int i = 0; i < DIM; ++i)
        v.c[i] = a[DIM * k + i];
    return v;
}

static inline void put(double *a, int64_t k, Vector v)
{
    for (int i = 0; i < DIM; ++i)
        a[DIM * k + i] = v.c[i];
}

static inline Vector less(Vector a, Vector b)
{
    for (int i = 0; i < DIM; ++i)
        a.c[i] -= b.c[i];
    return a;
}

static inline Vector plus(Vector a, double s, Vector b)
{
    for (int i = 0; i < DIM; ++i)
        a.c[i] += s * b.c[i];
    return a;
}

static inline Vector times(double s, Vector a)
{
    for (int i = 0; i < DIM; ++i)
        a.c[i] *= s;
    return a;
}

static inline double dot(Vector a, Vector b)
{
    double sum = a.c[0] * b.c[0];
    for (int i = 1; i < DIM; ++i)
        sum += a.c[i] * b.c[i];
    return sum;
}

static inline double norm(Vector a)
{
    return sqrt(dot(a, a));
}

static inline Vector in_plane(Vector n, Vector v)
{
    return plus(v, -dot(n, v), n);
}

/* -- what the including source defines ------------------------------------------------------ */

/* Length or area of the current slave tangents over that of the undeformed ones. */
static double stretch(const Vector *tangents);
/* Unit normal of tangents. */
static Vector normal_of(const Vector *tangents);
/* Shape functions of the master facets. */
static void shape_at(const Pair *p, const double *xi, double *values);
/* Place and tangents at xi on a facet, as the master is now. */
static Vector place_on(const Pair *p, int32_t facet, const double *xi, Vector *tangents);
/* The closest point of one point, with its normal and gap. */
static void project(Pair *p, int64_t q);
/* What the projections of all points start from. */
static void prepare(Pair *p);
/* How much a point over the surface counts: less than 1 beside an open end only. */
static double share_of(const Pair *p, int64_t q);

/* -- first pass ----------------------------------------------------------------------------- */

/* Where points and nodes are now; returns how far both have moved since the search. */
static double place(Pair *p)
{
    double points = 0.0, nodes = 0.0;
    for (int64_t n = 0; n < p->nodes; ++n) {
        Vector x = plus(at(p->master, n), 1.0, at(p->values, p->first_master + n));
        Vector moved = less(x, at(p->searched_nodes, n));
        put(p->current, n, x);
        nodes = fmax(nodes, dot(moved, moved));
    }
    for (int64_t q = 0; q < p->points; ++q) {
        Vector u = {{0.0}}, tangents[ALONG];
        const double *slope = p->slope + q * ALONG * p->corners;
        for (int b = 0; b < ALONG; ++b)
            tangents[b] = at(p->direction, ALONG * q + b);
        for (int64_t a = 0; a < p->corners; ++a) {
            Vector moved = at(p->values, p->rows[q * p->corners + a]);
            u = plus(u, p->shape[q * p->corners + a], moved);
            for (int b = 0; b < ALONG; ++b)
                tangents[b] = plus(tangents[b], slope[b * p->corners + a], moved);
        }
        Vector x = plus(at(p->reference, q), 1.0, u), moved = less(x, at(p->searched_points, q));
        put(p->position, q, x);
        p->area_ratio[q] = stretch(tangents);
        points = fmax(points, dot(moved, moved));
    }
    p->moved = sqrt(nodes);
    return sqrt(points) + p->moved;
}

/* Add the gap of a point with a master below it, and its area, to its facet's vertices. */
static void add_to_vertices(Pair *p, int64_t q)
{
    p->share[q] = 1.0;
    if (!p->on_surface[q])
        return;
    p->share[q] = share_of(p, q);
    double area = p->share[q] * p->weight[q], gap = area * p->gap[q];
    for (int64_t k = q * p->facet_vertices; k < (q + 1) * p->facet_vertices; ++k) {
        p->sums[p->of_point[k]] += p->vertex_shape[k] * gap;
        p->sums[p->vertices + p->of_point[k]] += p->vertex_shape[k] * area;
    }
}

/* Projections of all points, and the sums at the vertices; returns 1 and leaves them alone if a
 * search is due. */
int tribox_pair_project(Pair *p)
{
    if (!(place(p) <= p->slack))
        return 1;
    for (int64_t v = 0; v < 2 * p->vertices; ++v)
        p->sums[v] = 0.0;
    prepare(p);
    for (int64_t q = 0; q < p->points; ++q) {
        project(p, q);
        if (p->averaged)
            add_to_vertices(p, q);
    }
    return 0;
}

/* -- second pass ---------------------------------------------------------------------------- */

/* Whether the point is closed, and its pressure: of the vertices, or of its own gap. */
static void press(Pair *p, int64_t q)
{
    double pressure = 0.0, full = 0.0;
    if (p->averaged) {
        const int64_t *vertex = p->of_point + p->facet_vertices * q;
        const double *shape = p->vertex_shape + p->facet_vertices * q;
        int active = 0;
        for (int64_t k = 0; k < p->facet_vertices; ++k) {
            active |= p->active[vertex[k]];
            full += shape[k] * p->nodal_pressure[vertex[k]];
        }
        p->closed[q] = p->on_surface[q] && active;
        if (p->closed[q])
            pressure = p->share[q] * full;
    } else {
        double gap = p->gap[q], size = 0.0;
        for (int b = 0; b < ALONG; ++b)
            size = fmax(size, norm(at(p->tangent, ALONG * q + b)));
        p->closed[q] = p->on_surface[q] && gap <= p->touching * size;
        double begins = 2.0 * (-gap - p->roundoff * size);
        if (p->closed[q] && begins > 0.0)
            pressure = p->penalty[q] * fmin(begins, -gap) + p->damping[q];
    }
    p->pressure[q] = pressure;
    /* What is given up at the end of the master, see forms/contact/pressure.py. */
    double before = p->share_before[q], sunk_before = p->sunk_before[q];
    double share = p->on_surface[q] ? p->share[q] : 0.0;
    double sunk = p->on_surface[q] ? full * fmin(p->gap[q], 0.0) : 0.0;
    double mean = before > 0.0 ? 0.5 * (sunk + sunk_before) : sunk;
    p->present[q] = share;
    p->sunk[q] = sunk;
    p->lost[q] = (share > 0.0 ? mean : sunk_before) * (share - before);
}

/* Slip of a closed point that was at the anchor: as long as the way on a curved master, see
 * stretch_of in pair_tangent.h. */
static Vector slip_of(const Pair *p, int64_t q, Vector anchor)
{
    Vector n = at(p->normal, q);
    if (p->clamped[q])
        return in_plane(n, less(at(p->foot, q), anchor));
    Vector apart = less(at(p->position, q), anchor), image = in_plane(n, apart);
    double length = norm(image), sunk = dot(n, apart) - p->gap[q];
    if (!(fabs(sunk) < 0.5 * length))
        return image;
    return times(sqrt(1.0 + 4.0 / 3.0 * (sunk / length) * (sunk / length)), image);
}

/* Slip, of closed points and of all, and elastic slip. */
static void relate(Pair *p, int64_t q)
{
    Vector n = at(p->normal, q), tangents[ALONG], image = {{0.0}};
    p->gap_after[q] = p->on_surface[q] ? p->gap[q] : INFINITY;
    Vector anchor = place_on(p, p->facet_before[q], p->xi_before + ALONG * q, tangents);
    Vector way = slip_of(p, q, anchor);
    put(p->way, q, way);
    put(p->slip, q, times(p->closed[q] ? 1.0 : 0.0, way));
    for (int b = 0; b < ALONG; ++b)
        image = plus(image, p->component_before[ALONG * q + b], tangents[b]);
    image = in_plane(n, image);
    double length = norm(image), scale = length > 0.0 ? p->length_before[q] / length : 0.0;
    put(p->elastic, q, times(scale, image));
}

/* Pressure, slip and elastic slip of all points. */
void tribox_pair_relate(Pair *p)
{
    for (int64_t q = 0; q < p->points; ++q) {
        press(p, q);
        relate(p, q);
    }
}

/* -- loads ---------------------------------------------------------------------------------- */

static void clear(Pair *p)
{
    for (int64_t k = 0; k < DIM * (p->first_master + p->nodes); ++k)
        p->load[k] = 0.0;
}

static inline int64_t master_row(const Pair *p, int64_t q, int64_t a)
{
    return p->first_master + p->facets[p->facet_nodes * p->facet[q] + a];
}

/* Add -G^T (w t) of one point to the nodal loads. */
static inline void spread(Pair *p, int64_t q, Vector t)
{
    double shape[4] = {0.0};
    Vector force = times(-p->weight[q], t);
    for (int64_t a = q * p->corners; a < (q + 1) * p->corners; ++a)
        put(p->load, p->rows[a], plus(at(p->load, p->rows[a]), p->shape[a], force));
    shape_at(p, p->xi + ALONG * q, shape);
    for (int64_t a = 0; a < p->facet_nodes; ++a) {
        int64_t row = master_row(p, q, a);
        put(p->load, row, plus(at(p->load, row), -shape[a], force));
    }
}

/* Loads of the pressure and of the friction in `dry`. */
void tribox_pair_load(Pair *p)
{
    clear(p);
    for (int64_t q = 0; q < p->points; ++q) {
        Vector t = less(times(p->pressure[q], at(p->normal, q)), at(p->dry, q));
        put(p->traction, q, t);
        spread(p, q, t);
    }
}

/* Take the viscous part out of the friction in `dry`, whose dissipation is `viscous`, and put the
 * film's traction of the step before in its place. */
void tribox_pair_hold_film(Pair *p, double dt, const double *viscous)
{
    clear(p);
    for (int64_t q = 0; q < p->points; ++q) {
        Vector n = at(p->normal, q), slip = at(p->slip, q), friction = at(p->dry, q);
        double squared = dot(slip, slip), resistance = squared > 0.0 ? viscous[q] / squared : 0.0;
        if (squared > 0.0 || !(p->pressure[q] > 0.0))
            p->film[q] = resistance * dt;
        friction = plus(friction, -resistance, slip);
        Vector tau = in_plane(n, at(p->tau, q));
        put(p->dry, q, friction);
        put(p->tau, q, tau);
        Vector t = less(less(times(p->pressure[q], n), friction), tau);
        put(p->traction, q, t);
        spread(p, q, t);
    }
}

/* Correct the film's traction for the nodal velocities in `values`; the loads are its change. */
void tribox_pair_correct_film(Pair *p, double dt)
{
    clear(p);
    for (int64_t q = 0; q < p->points; ++q) {
        double shape[4] = {0.0};
        Vector n = at(p->normal, q), jump = {{0.0}}, tau = at(p->tau, q);
        for (int64_t a = q * p->corners; a < (q + 1) * p->corners; ++a)
            jump = plus(jump, p->shape[a], at(p->values, p->rows[a]));
        shape_at(p, p->xi + ALONG * q, shape);
        for (int64_t a = 0; a < p->facet_nodes; ++a)
            jump = plus(jump, -shape[a], at(p->values, master_row(p, q, a)));
        jump = in_plane(n, jump);
        double c = p->film[q], share = 1.0 / (1.0 + dt * c * p->compliance[q]);
        Vector change = times(share, less(times(c, jump), tau));
        tau = plus(tau, 1.0, change);
        put(p->tau, q, tau);
        put(p->friction, q, plus(at(p->dry, q), 1.0, tau));
        put(p->traction, q, less(at(p->traction, q), change));
        p->viscous[q] = c > 0.0 ? dot(tau, tau) * dt / c : 0.0;
        p->work[q] = dot(tau, at(p->slip, q)) - p->viscous[q];
        spread(p, q, times(-1.0, change));
    }
}

/* -- history -------------------------------------------------------------------------------- */

/* Components (alpha) of the vector along tangents. */
static inline void components(const Vector *tau, Vector v, double *out)
{
    double a = dot(tau[0], tau[0]), r = dot(tau[0], v);
    if (ALONG == 1) {
        out[0] = r / a;
        return;
    }
    double b = dot(tau[0], tau[ALONG - 1]), c = dot(tau[ALONG - 1], tau[ALONG - 1]);
    double s = dot(tau[ALONG - 1], v), over = 1.0 / (a * c - b * b);
    out[0] = (c * r - b * s) * over;
    out[ALONG - 1] = (a * s - b * r) * over;
}

/* What the next step needs of the elastic slip (q, i): its components on the facet, its length. */
void tribox_pair_commit(Pair *p, const double *elastic)
{
    for (int64_t q = 0; q < p->points; ++q) {
        Vector g = at(elastic, q), on = g, tau[ALONG];
        for (int b = 0; b < ALONG; ++b)
            tau[b] = at(p->tangent, ALONG * q + b);
        if (p->clamped[q]) { /* the vector on the facet whose image across n is g */
            Vector n = at(p->normal, q), facet = normal_of(tau);
            double between = dot(n, facet);
            on = plus(g, fabs(between) > 0.1 ? -dot(g, facet) / between : 0.0, n);
        }
        components(tau, on, p->component + ALONG * q);
        p->length[q] = norm(g);
    }
}
