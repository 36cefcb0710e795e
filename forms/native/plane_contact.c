/* The geometry and the loads of a contact pair in the plane, point by point.
 *
 * The same operations as geometry/surfaces/projection.py and forms/contact/explicit.py, in two
 * passes. The first finds the closest points on the candidate segments and adds the gaps up at the
 * slave's vertices. From the sums of all ranks the caller finds the vertices' pressures. The second
 * gives pressure, slip against the material point of the last step and transport of the elastic
 * slip. The nodal loads follow the friction law, which is not here.
 */

#include <math.h>
#include <stdint.h>

typedef struct {
    /* Sizes and numbers. */
    int64_t points, corners, candidates, nodes, first_master, vertices, averaged;
    double touching, roundoff, slack, tie;
    /* Slave points: (q), (q, a), (q, 2); rows (q, a) of the pair's nodes. */
    const double *weight, *shape, *slope, *reference, *direction;
    const int64_t *rows;
    /* Master: (n, 2) positions, (f, 2) nodes, facets that end and start at a node. */
    const double *master;
    const int32_t *facets, *previous, *next;
    /* Penalty (q) of points, where the pressure is not averaged; where it is, the way (q) up to the
     * open end of the master over which a point fades. */
    const double *penalty, *reach;
    /* Vertices of the slave facets: (q, 2) numbers and shape functions; the sums (2, v) of gaps and
     * of covered area that the first pass makes; (v) what the second pass is given. */
    const int64_t *of_point;
    const double *vertex_shape;
    double *sums;
    const double *nodal_pressure;
    const uint8_t *active;
    /* Search: candidates (q, k), and where points and nodes were then. */
    const int32_t *candidate;
    const double *searched_points, *searched_nodes;
    /* Nodal values gathered, and nodal loads to add, (m, 2). */
    const double *values;
    double *load;
    /* State of the last step, (q). */
    const int32_t *facet_before;
    const double *xi_before, *component_before, *length_before;
    /* Results: current nodes (n, 2), then per point. */
    double *current, *position, *area_ratio, *xi, *foot, *normal, *tangent, *gap, *slip, *elastic;
    double *pressure, *traction, *component, *length, *gap_after, *friction, *viscous, *work;
    double *share;
    int32_t *facet;
    uint8_t *clamped, *on_surface, *closed;
    /* Film: traction (q, 2), viscosity (q), friction without it (q, 2), compliance (q). */
    double *tau, *film, *dry;
    const double *compliance;
} Pair;

/* For the caller to compare with the structure that it lays out itself. */
int64_t tribox_pair_size(void)
{
    return (int64_t)sizeof(Pair);
}

typedef struct {
    double x, y;
} Vector;

static inline Vector at(const double *a, int64_t k)
{
    return (Vector){a[2 * k], a[2 * k + 1]};
}

static inline void put(double *a, int64_t k, Vector v)
{
    a[2 * k] = v.x;
    a[2 * k + 1] = v.y;
}

static inline Vector less(Vector a, Vector b)
{
    return (Vector){a.x - b.x, a.y - b.y};
}

static inline Vector plus(Vector a, double s, Vector b)
{
    return (Vector){a.x + s * b.x, a.y + s * b.y};
}

static inline double dot(Vector a, Vector b)
{
    return a.x * b.x + a.y * b.y;
}

static inline Vector in_plane(Vector n, Vector v)
{
    return plus(v, -dot(n, v), n);
}

static inline Vector normal_of(Vector tau)
{
    double length = sqrt(dot(tau, tau));
    return (Vector){-tau.y / length, tau.x / length};
}

static inline Vector edge(const Pair *p, int32_t facet, Vector *start)
{
    *start = at(p->current, p->facets[2 * facet]);
    return less(at(p->current, p->facets[2 * facet + 1]), *start);
}

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
        Vector u = {0.0, 0.0}, du = at(p->direction, q);
        for (int64_t a = q * p->corners; a < (q + 1) * p->corners; ++a) {
            u = plus(u, p->shape[a], at(p->values, p->rows[a]));
            du = plus(du, p->slope[a], at(p->values, p->rows[a]));
        }
        Vector x = plus(at(p->reference, q), 1.0, u), moved = less(x, at(p->searched_points, q));
        put(p->position, q, x);
        p->area_ratio[q] = sqrt(dot(du, du));
        points = fmax(points, dot(moved, moved));
    }
    return sqrt(points) + sqrt(nodes);
}

/* The closest point on a vertex: the normal points to it, on the side of the mean normal. */
static void at_vertex(Pair *p, int64_t q, Vector x, double free, Vector tau)
{
    int32_t vertex = p->facets[2 * p->facet[q] + (free > 1.0)];
    int32_t sides[2] = {p->previous[vertex], p->next[vertex]};
    Vector outward = {0.0, 0.0}, start;
    for (int s = 0; s < 2; ++s)
        if (sides[s] >= 0)
            outward = plus(outward, 1.0, normal_of(edge(p, sides[s], &start)));
    double size = sqrt(dot(outward, outward));
    outward = (Vector){outward.x / size, outward.y / size};
    Vector apart = less(x, at(p->foot, q));
    double distance = sqrt(dot(apart, apart)), sign = dot(apart, outward) < 0.0 ? -1.0 : 1.0;
    p->on_surface[q] = sides[0] >= 0 && sides[1] >= 0;
    if (distance > 1e-12 * sqrt(dot(tau, tau)))
        outward = (Vector){sign * apart.x / distance, sign * apart.y / distance};
    put(p->normal, q, outward);
    p->gap[q] = sign * distance;
}

/* Squared distance of x from a facet, and the coordinate of its foot on the facet's line. */
static double to_facet(const Pair *p, Vector x, int32_t facet, double *free)
{
    Vector start, tau = edge(p, facet, &start);
    *free = dot(less(x, start), tau) / dot(tau, tau);
    Vector apart = plus(less(x, start), -fmin(fmax(*free, 0.0), 1.0), tau);
    return dot(apart, apart);
}

static void project(Pair *p, int64_t q)
{
    Vector x = at(p->position, q), start, tau;
    double best = INFINITY, free = 0.0;
    for (int64_t k = q * p->candidates; k < (q + 1) * p->candidates; ++k)
        best = fmin(best, sqrt(to_facet(p, x, p->candidate[k], &free)));
    /* Of facets equally close, the first that has the foot inside, or else the first. */
    int found = 0;
    for (int64_t k = q * p->candidates; k < (q + 1) * p->candidates; ++k) {
        double f, distance = sqrt(to_facet(p, x, p->candidate[k], &f));
        int rank = f < 0.0 || f > 1.0 ? 1 : 2;
        if (distance <= best + p->tie && rank > found) {
            found = rank;
            free = f;
            p->facet[q] = p->candidate[k];
        }
    }
    tau = edge(p, p->facet[q], &start);
    p->xi[q] = fmin(fmax(free, 0.0), 1.0);
    p->clamped[q] = free < 0.0 || free > 1.0;
    p->on_surface[q] = 1;
    put(p->tangent, q, tau);
    put(p->foot, q, plus(start, p->xi[q], tau));
    put(p->normal, q, normal_of(tau));
    p->gap[q] = dot(less(x, at(p->foot, q)), at(p->normal, q));
    if (p->clamped[q])
        at_vertex(p, q, x, free, tau);
}

/* How much a point counts: less than 1 right beside the open end of the master only. */
static double share_of(const Pair *p, int64_t q)
{
    const int32_t *ends = p->facets + 2 * p->facet[q];
    int start_open = p->previous[ends[0]] < 0, end_open = p->next[ends[1]] < 0;
    if (!start_open && !end_open)
        return 1.0;
    Vector along = less(at(p->master, ends[1]), at(p->master, ends[0]));
    double length = sqrt(dot(along, along)), steep = length / fmin(p->reach[q], length), share = 1.0;
    if (start_open)
        share = fmin(share, p->xi[q] * steep);
    if (end_open)
        share = fmin(share, (1.0 - p->xi[q]) * steep);
    return share;
}

/* Add the gap of a point with a master below it, and its area, to its facet's vertices. */
static void add_to_vertices(Pair *p, int64_t q)
{
    p->share[q] = 1.0;
    if (!p->on_surface[q])
        return;
    p->share[q] = share_of(p, q);
    double area = p->share[q] * p->weight[q], gap = area * p->gap[q];
    for (int64_t k = 2 * q; k < 2 * q + 2; ++k) {
        p->sums[p->of_point[k]] += p->vertex_shape[k] * gap;
        p->sums[p->vertices + p->of_point[k]] += p->vertex_shape[k] * area;
    }
}

/* Whether the point is closed, and its pressure: of the vertices, or of its own gap. */
static void press(Pair *p, int64_t q)
{
    double pressure = 0.0;
    if (p->averaged) {
        const int64_t *vertex = p->of_point + 2 * q;
        const double *shape = p->vertex_shape + 2 * q;
        p->closed[q] = p->on_surface[q] && (p->active[vertex[0]] || p->active[vertex[1]]);
        if (p->closed[q])
            pressure = p->share[q] * (shape[0] * p->nodal_pressure[vertex[0]]
                                      + shape[1] * p->nodal_pressure[vertex[1]]);
    } else {
        Vector tau = at(p->tangent, q);
        double gap = p->gap[q], size = sqrt(dot(tau, tau));
        p->closed[q] = p->on_surface[q] && gap <= p->touching * size;
        if (p->closed[q] && -gap > p->roundoff * size)
            pressure = -p->penalty[q] * gap;
    }
    p->pressure[q] = pressure;
}

/* Slip and elastic slip. */
static void relate(Pair *p, int64_t q)
{
    Vector n = at(p->normal, q), start;
    p->gap_after[q] = p->on_surface[q] ? p->gap[q] : INFINITY;
    Vector old = edge(p, p->facet_before[q], &start);
    Vector anchor = plus(start, p->xi_before[q], old);
    Vector here = p->clamped[q] ? at(p->foot, q) : at(p->position, q);
    put(p->slip, q, in_plane(n, less(here, anchor)));
    double c = p->component_before[q];
    Vector image = in_plane(n, (Vector){c * old.x, c * old.y});
    double length = sqrt(dot(image, image)), scale = length > 0.0 ? p->length_before[q] / length : 0.0;
    put(p->elastic, q, (Vector){scale * image.x, scale * image.y});
}

/* Projections of all points, and the sums at the vertices; returns 1 and leaves them alone if a
 * search is due. */
int tribox_pair_project(Pair *p)
{
    if (!(place(p) <= p->slack))
        return 1;
    for (int64_t v = 0; v < 2 * p->vertices; ++v)
        p->sums[v] = 0.0;
    for (int64_t q = 0; q < p->points; ++q) {
        project(p, q);
        if (p->averaged)
            add_to_vertices(p, q);
    }
    return 0;
}

/* Pressure, slip and elastic slip of all points. */
void tribox_pair_relate(Pair *p)
{
    for (int64_t q = 0; q < p->points; ++q) {
        press(p, q);
        relate(p, q);
    }
}

static void clear(Pair *p)
{
    for (int64_t k = 0; k < 2 * (p->first_master + p->nodes); ++k)
        p->load[k] = 0.0;
}

/* Add -G^T (w t) of one point to the nodal loads. */
static inline void spread(Pair *p, int64_t q, Vector t)
{
    Vector force = {-p->weight[q] * t.x, -p->weight[q] * t.y};
    for (int64_t a = q * p->corners; a < (q + 1) * p->corners; ++a)
        put(p->load, p->rows[a], plus(at(p->load, p->rows[a]), p->shape[a], force));
    for (int side = 0; side < 2; ++side) {
        int64_t row = p->first_master + p->facets[2 * p->facet[q] + side];
        double shape = side ? p->xi[q] : 1.0 - p->xi[q];
        put(p->load, row, plus(at(p->load, row), -shape, force));
    }
}

/* Loads of the pressure and of the friction in `dry`. */
void tribox_pair_load(Pair *p)
{
    clear(p);
    for (int64_t q = 0; q < p->points; ++q) {
        Vector n = at(p->normal, q), friction = at(p->dry, q);
        put(p->traction, q, (Vector){p->pressure[q] * n.x - friction.x, p->pressure[q] * n.y - friction.y});
        spread(p, q, at(p->traction, q));
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
        Vector t = {p->pressure[q] * n.x - friction.x - tau.x, p->pressure[q] * n.y - friction.y - tau.y};
        put(p->traction, q, t);
        spread(p, q, t);
    }
}

/* Correct the film's traction for the nodal velocities in `values`; the loads are its change. */
void tribox_pair_correct_film(Pair *p, double dt)
{
    clear(p);
    for (int64_t q = 0; q < p->points; ++q) {
        Vector n = at(p->normal, q), jump = {0.0, 0.0}, tau = at(p->tau, q);
        for (int64_t a = q * p->corners; a < (q + 1) * p->corners; ++a)
            jump = plus(jump, p->shape[a], at(p->values, p->rows[a]));
        for (int side = 0; side < 2; ++side) {
            int64_t row = p->first_master + p->facets[2 * p->facet[q] + side];
            jump = plus(jump, side ? -p->xi[q] : p->xi[q] - 1.0, at(p->values, row));
        }
        jump = in_plane(n, jump);
        double c = p->film[q], share = 1.0 / (1.0 + dt * c * p->compliance[q]);
        Vector change = {share * (c * jump.x - tau.x), share * (c * jump.y - tau.y)};
        tau = plus(tau, 1.0, change);
        put(p->tau, q, tau);
        put(p->friction, q, plus(at(p->dry, q), 1.0, tau));
        put(p->traction, q, less(at(p->traction, q), change));
        p->viscous[q] = c > 0.0 ? dot(tau, tau) * dt / c : 0.0;
        p->work[q] = dot(tau, at(p->slip, q)) - p->viscous[q];
        spread(p, q, (Vector){-change.x, -change.y});
    }
}

/* What the next step needs of the elastic slip (q, 2): its component on the facet, its length. */
void tribox_pair_commit(Pair *p, const double *elastic)
{
    for (int64_t q = 0; q < p->points; ++q) {
        Vector g = at(elastic, q), tau = at(p->tangent, q), on = g;
        if (p->clamped[q]) { /* the vector on the facet whose image across n is g */
            Vector n = at(p->normal, q), facet = normal_of(tau);
            double between = dot(n, facet);
            on = plus(g, fabs(between) > 0.1 ? -dot(g, facet) / between : 0.0, n);
        }
        p->component[q] = dot(on, tau) / dot(tau, tau);
        p->length[q] = sqrt(dot(g, g));
    }
}
