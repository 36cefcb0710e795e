/* Closest points of facets: straight, triangular and quadrilateral ones of degree 1 to 3.
 *
 * The choice among facets of geometry/surfaces/projection.py, one point after another. A facet is a
 * polynomial, made when the first point asks for it: sum c_jk xi^j eta^k from its first node, if of
 * higher degree in xi - 1/2 and eta - 1/2. Facets whose box lies further away than a facet already
 * found are left out.
 * Vectors have three components, in the plane too.
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))

enum { INTERIOR = -1, CORNER = 8, STEPS = 40, HALVINGS = 12, FINE = 12 };
/* Height over length of a facet's hull from which it may have several points nearest to another. */
#define WAVED 0.2
#define SEAM 1e-11
#define LAST 1e-9

typedef struct {
    double x[3];
} Vector;

typedef struct {
    /* Surface directions; 1 for a triangle; degree; numbers of nodes and samples. */
    int64_t directions, triangle, degree, nodes, samples;
    /* Coefficients (k, a) of the products of powers, xi's the faster; points (b, a) whose hull holds the facet;
     * shape functions (s, a) at the samples, and these (s, alpha). */
    const double *powers, *hull, *sampled, *sample;
    /* Sides: nodes (e, a), begin and direction (e, alpha). */
    const int32_t *side_nodes;
    const double *side_origin, *side_direction;
    /* The same as above for a side. */
    int64_t edge_samples;
    const double *edge_powers, *edge_sampled, *edge_sample;
} Shape;

typedef struct {
    int64_t stamp; /* of the call that made it */
    Vector origin, node[16], power[16], sample[25];
    Vector axis[3], low, high; /* box: directions, and how far it goes along each */
    int64_t waved; /* whether to begin at many places */
} Facet;

typedef struct {
    const Shape *shape;
    int64_t facets, stamp;
    const double *controls; /* (f, a, i) */
    Facet *made;
} Surface;

/* Position from the facet's origin, first derivatives, second derivatives 11, 12, 22. */
typedef struct {
    Vector y, d[2], h[3];
} Place;

typedef struct {
    double xi[2], squared;
    int64_t entity;
} Closest;

/* What to look for: points, the facets that may hold their closest points, the results. */
typedef struct {
    int64_t count;
    const double *points; /* (q, i) */
    /* Facets of point q: from start[q] on, those with an excess up to `limit`; or `alone` (q), if
     * not negative; or `kept` (q), if its stationary point is at most `overrun` past an edge. */
    const int64_t *start;
    const int32_t *facet, *alone, *kept;
    const double *beyond;
    double limit, tie, overrun;
    /* Scratch, as long as the longest list of facets. */
    double *bound;
    Closest *tried;
    /* Results (q), (q, alpha), (q). */
    int32_t *found;
    double *xi;
    int32_t *entity;
} Task;

/* Geometry (q) at places xi of facets: position, tangents (q, alpha, i), second derivatives
 * (q, alpha, beta, i; may be NULL), and unless there are no points the normal and their gap along
 * it. */
typedef struct {
    int64_t count;
    const double *points;
    const int32_t *facet;
    const double *xi;
    double *foot, *tangents, *normal, *curvature, *gap;
} Geometry;

/* For the caller: bytes of the structures that it lays out or makes room for. */
void tribox_closest_sizes(int64_t *bytes)
{
    const size_t sizes[] = {sizeof(Shape), sizeof(Surface), sizeof(Task), sizeof(Geometry),
                            sizeof(Facet), sizeof(Closest)};
    for (int k = 0; k < 6; ++k)
        bytes[k] = (int64_t)sizes[k];
}

INLINE Vector vector(const double *a, int64_t dim)
{
    return (Vector){{a[0], a[1], dim == 3 ? a[2] : 0.0}};
}

INLINE void store(double *a, int64_t k, int64_t dim, Vector v)
{
    memcpy(a + k * dim, v.x, (size_t)dim * sizeof *a);
}

INLINE double dot(Vector a, Vector b)
{
    return a.x[0] * b.x[0] + a.x[1] * b.x[1] + a.x[2] * b.x[2];
}

INLINE Vector plus(Vector a, double s, Vector b)
{
    return (Vector){{a.x[0] + s * b.x[0], a.x[1] + s * b.x[1], a.x[2] + s * b.x[2]}};
}

INLINE Vector less(Vector a, Vector b)
{
    return (Vector){{a.x[0] - b.x[0], a.x[1] - b.x[1], a.x[2] - b.x[2]}};
}

INLINE Vector times(double s, Vector a)
{
    return (Vector){{s * a.x[0], s * a.x[1], s * a.x[2]}};
}

INLINE Vector cross(Vector a, Vector b)
{
    return (Vector){{a.x[1] * b.x[2] - a.x[2] * b.x[1], a.x[2] * b.x[0] - a.x[0] * b.x[2],
                     a.x[0] * b.x[1] - a.x[1] * b.x[0]}};
}

INLINE double squared_between(Vector a, Vector b)
{
    Vector apart = less(a, b);
    return dot(apart, apart);
}

static Vector unit(Vector v)
{
    double length = sqrt(dot(v, v));
    return times(length > 0.0 ? 1.0 / length : 0.0, v);
}

/* Evaluate the polynomial c with n powers in each direction by Horner's rule. */
INLINE void horner(const Vector *c, const int directions, const int n, const double *xi, Place *p)
{
    const double middle = n == 2 ? 0.0 : 0.5;
    const double s = xi[0] - middle, t = directions == 2 ? xi[1] - middle : 0.0;
    Place out = {0};
    for (int k = directions == 2 ? n - 1 : 0; k >= 0; --k) {
        Vector y = c[k * n + n - 1], d = {0}, h = {0};
        for (int j = n - 2; j >= 0; --j) {
            h = plus(d, s, h);
            d = plus(y, s, d);
            y = plus(c[k * n + j], s, y);
        }
        if (directions == 2) {
            out.h[2] = plus(out.d[1], t, out.h[2]);
            out.d[1] = plus(out.y, t, out.d[1]);
            out.h[1] = plus(out.d[0], t, out.h[1]);
        }
        out.y = plus(y, t, out.y);
        out.d[0] = plus(d, t, out.d[0]);
        out.h[0] = plus(h, t, out.h[0]);
    }
    out.h[0] = times(2.0, out.h[0]);
    out.h[2] = times(2.0, out.h[2]);
    *p = out;
}

static void place_at(const Vector *c, int directions, int degree, const double *xi, Place *p)
{
    switch (10 * directions + degree) {
    case 11:
        horner(c, 1, 2, xi, p);
        break;
    case 12:
        horner(c, 1, 3, xi, p);
        break;
    case 13:
        horner(c, 1, 4, xi, p);
        break;
    case 21:
        horner(c, 2, 2, xi, p);
        break;
    case 22:
        horner(c, 2, 3, xi, p);
        break;
    default:
        horner(c, 2, 4, xi, p);
    }
}

/* How far xi lies outside the reference domain; <= 0 inside. */
INLINE double excess(const double *xi, int directions, int triangle)
{
    if (directions == 1)
        return fmax(-xi[0], xi[0] - 1.0);
    double least = fmax(-xi[0], -xi[1]);
    return fmax(least, triangle ? xi[0] + xi[1] - 1.0 : fmax(xi[0], xi[1]) - 1.0);
}

/* Newton's step for the least distance of x; whether the Hessian is positive definite. */
static int newton_step(const Place *p, Vector x, int directions, double *step)
{
    Vector apart = less(x, p->y);
    double slope = dot(p->d[0], apart), m = dot(p->d[0], p->d[0]), h = m - dot(p->h[0], apart);
    if (directions == 1) {
        step[0] = slope / (h > 0.0 ? h : m);
        return h > 0.0;
    }
    double other = dot(p->d[1], apart), mixed = dot(p->d[0], p->d[1]), m2 = dot(p->d[1], p->d[1]);
    double h12 = mixed - dot(p->h[1], apart), h2 = m2 - dot(p->h[2], apart);
    double bent = h * h2 - h12 * h12, area = m * m2 - mixed * mixed;
    int convex = h > 0.0 && h2 > 0.0 && bent > 1e-8 * area;
    double a = convex ? h : m, b = convex ? h12 : mixed, c = convex ? h2 : m2;
    double over = 1.0 / (convex ? bent : area);
    step[0] = (c * slope - b * other) * over;
    step[1] = (a * other - b * slope) * over;
    return convex;
}

/* Where the distance of x from the polynomial c is least, beginning at xi; whether found. */
static int stationary(const Vector *c, Vector x, int directions, int triangle, int degree,
                      double *xi, double *squared)
{
    const int flat = degree == 1 && (directions == 1 || triangle);
    double step[2] = {0.0, 0.0}, next[2] = {0.0, 0.0};
    Place p;
    place_at(c, directions, degree, xi, &p);
    *squared = squared_between(x, p.y);
    for (int iteration = 0; iteration < STEPS; ++iteration) {
        int convex = newton_step(&p, x, directions, step);
        double size = fmax(fabs(step[0]), fabs(step[1])), limit = *squared * (1.0 + 1e-12);
        int last = flat || (size < LAST && convex), halved = 0;
        for (;; ++halved) { /* until the distance no longer grows; the last step is taken whole */
            next[0] = xi[0] + step[0];
            next[1] = xi[1] + step[1];
            place_at(c, directions, degree, next, &p);
            *squared = squared_between(x, p.y);
            if (last || !(*squared > limit) || halved == HALVINGS)
                break;
            step[0] *= 0.5;
            step[1] *= 0.5;
        }
        int moved = next[0] != xi[0] || next[1] != xi[1];
        xi[0] = next[0];
        xi[1] = next[1];
        if (flat)
            return 1;
        if (!(*squared < INFINITY))
            return 0;
        if (size < 1e-13 || last)
            return convex;
        /* Far outside the domain: the closest point is on a side. */
        if (!moved || !(excess(next, directions, triangle) < 0.3))
            return 0;
    }
    return 0;
}

/* Begin at the nearest of the samples with the coordinates (s, alpha). */
static void begin_at_sample(const Vector *places, const double *coordinates, int64_t samples,
                            Vector x, int directions, double *xi)
{
    double least = INFINITY;
    int64_t best = 0;
    for (int64_t s = 0; s < samples; ++s) {
        double squared = squared_between(x, places[s]);
        if (squared < least) {
            least = squared;
            best = s;
        }
    }
    xi[0] = coordinates[best * directions];
    xi[1] = directions == 2 ? coordinates[best * directions + 1] : 0.0;
}

/* The nearest stationary point in the domain: of searches that begin at each local minimum of the
 * distance on a lattice, and of `out` where it is `found`; whether there is one. */
static int nearest_of_several(const Vector *c, Vector x, int directions, int triangle, int degree,
                              int found, Closest *out)
{
    enum { N = FINE + 1 };
    double squared[N * N];
    const int rows = directions == 2 ? N : 1;
    Place p;
    for (int k = 0; k < rows * N; ++k) {
        double xi[2] = {(double)(k % N) / FINE, (double)(k / N) / FINE};
        place_at(c, directions, degree, xi, &p);
        squared[k] = excess(xi, directions, triangle) > SEAM ? INFINITY : squared_between(x, p.y);
    }
    found = found && excess(out->xi, directions, triangle) <= SEAM;
    for (int k = 0; k < rows * N; ++k) {
        int least = squared[k] < INFINITY, i = k % N, j = k / N;
        for (int m = j > 0 ? j - 1 : 0; least && m < rows && m <= j + 1; ++m)
            for (int n = i > 0 ? i - 1 : 0; n < N && n <= i + 1; ++n)
                least = least && !(squared[m * N + n] < squared[k]);
        Closest here = {{(double)i / FINE, (double)j / FINE}, 0.0, INTERIOR};
        if (least && stationary(c, x, directions, triangle, degree, here.xi, &here.squared)
            && excess(here.xi, directions, triangle) <= SEAM
            && (!found || here.squared < out->squared)) {
            *out = here;
            found = 1;
        }
    }
    return found;
}

/* out (r) = matrix (r, a) times nodes (a). */
static void combine(const double *matrix, const Vector *nodes, int64_t rows, int64_t count,
                    Vector *out)
{
    for (int64_t r = 0; r < rows; ++r) {
        Vector sum = {0};
        for (int64_t a = 0; a < count; ++a)
            sum = plus(sum, matrix[r * count + a], nodes[a]);
        out[r] = sum;
    }
}

/* A box along the facet and its normal that holds it. */
static void enclose(const Shape *shape, Facet *f)
{
    const Vector *y = f->node;
    Vector hull[16], along = less(y[1], y[0]), other = {{0.0, 0.0, 1.0}};
    if (shape->directions == 2) {
        other = less(y[2], y[0]);
        if (!shape->triangle) {
            along = plus(along, 1.0, less(y[3], y[2]));
            other = plus(other, 1.0, less(y[3], y[1]));
        }
    }
    f->axis[0] = unit(along);
    f->axis[1] = unit(cross(f->axis[0], other));
    f->axis[2] = cross(f->axis[0], f->axis[1]);
    combine(shape->hull, y, shape->nodes, shape->nodes, hull);
    for (int d = 0; d < 3; ++d) {
        f->low.x[d] = INFINITY;
        f->high.x[d] = -INFINITY;
        for (int64_t b = 0; b < shape->nodes; ++b) {
            double reach = dot(f->axis[d], hull[b]);
            f->low.x[d] = fmin(f->low.x[d], reach);
            f->high.x[d] = fmax(f->high.x[d], reach);
        }
    }
    double height = f->high.x[1] - f->low.x[1], length = f->high.x[0] - f->low.x[0];
    if (shape->directions == 2)
        length = fmin(length, f->high.x[2] - f->low.x[2]);
    f->waved = shape->degree > 1 && height > WAVED * length;
}

static const Facet *facet_of(const Surface *surface, int64_t number)
{
    const Shape *shape = surface->shape;
    const int64_t dim = shape->directions + 1, n = shape->degree + 1;
    Facet *f = surface->made + number;
    if (f->stamp == surface->stamp)
        return f;
    f->stamp = surface->stamp;
    const double *nodes = surface->controls + number * shape->nodes * dim;
    f->origin = vector(nodes, dim);
    for (int64_t a = 0; a < shape->nodes; ++a)
        f->node[a] = less(vector(nodes + a * dim, dim), f->origin);
    combine(shape->powers, f->node, dim == 3 ? n * n : n, shape->nodes, f->power);
    combine(shape->sampled, f->node, shape->samples, shape->nodes, f->sample);
    enclose(shape, f);
    return f;
}

/* Squared distance of x (from the facet's origin) from the facet's box: no more than from it. */
static double bound_of(const Facet *f, Vector x)
{
    double sum = 0.0;
    for (int d = 0; d < 3; ++d) {
        double along = dot(f->axis[d], x);
        double past = fmax(fmax(f->low.x[d] - along, along - f->high.x[d]), 0.0);
        sum += past * past;
    }
    return sum;
}

/* The closest point of the straight segment from a to b; the entity is that of an interval. */
static void on_segment(Vector a, Vector b, Vector x, Closest *out)
{
    Vector tau = less(b, a), apart = less(x, a);
    double free = dot(apart, tau) / dot(tau, tau);
    out->entity = free < 0.0 ? CORNER : free > 1.0 ? CORNER + 1 : INTERIOR;
    out->xi[0] = fmin(fmax(free, 0.0), 1.0);
    out->xi[1] = 0.0;
    apart = plus(apart, -out->xi[0], tau);
    out->squared = dot(apart, apart);
}

/* The nearer of two ends, where there is no nearer stationary point `found` between them. */
static void on_ends(Vector a, Vector b, Vector x, int found, Closest *out)
{
    double first = squared_between(x, a), second = squared_between(x, b);
    int end = second < first;
    double least = end ? second : first;
    if (!found || least < out->squared)
        *out = (Closest){{end, 0.0}, least, CORNER + end};
}

/* The closest point of one side of a face, in the coordinates of the face. */
static void on_side(const Shape *shape, const Facet *f, int side, Vector x, Closest *out)
{
    const int64_t n = shape->degree + 1;
    const int32_t *node = shape->side_nodes + side * n;
    const double *origin = shape->side_origin + 2 * side;
    const double *direction = shape->side_direction + 2 * side;
    Vector a = f->node[node[0]], b = f->node[node[1]];
    Closest here;
    if (n == 2) {
        on_segment(a, b, x, &here);
    } else {
        Vector nodes[4], power[4], sample[5];
        for (int64_t k = 0; k < n; ++k)
            nodes[k] = f->node[node[k]];
        combine(shape->edge_powers, nodes, n, n, power);
        combine(shape->edge_sampled, nodes, shape->edge_samples, n, sample);
        begin_at_sample(sample, shape->edge_sample, shape->edge_samples, x, 1, here.xi);
        here.entity = INTERIOR;
        int found = stationary(power, x, 1, 0, (int)shape->degree, here.xi, &here.squared);
        if (f->waved)
            found = nearest_of_several(power, x, 1, 0, (int)shape->degree, found, &here);
        found = found && excess(here.xi, 1, 0) <= SEAM;
        if (!found || f->waved)
            on_ends(a, b, x, found, &here);
    }
    for (int d = 0; d < 2; ++d)
        out->xi[d] = origin[d] + here.xi[0] * direction[d];
    out->squared = here.squared;
    out->entity = here.entity == INTERIOR ? side : CORNER + node[here.entity - CORNER];
}

/* The stationary point of a facet by the nearest sample, inside or near; whether there is one. */
static int inside(const Shape *shape, const Facet *f, Vector x, Closest *out)
{
    const int directions = (int)shape->directions, triangle = (int)shape->triangle;
    out->entity = INTERIOR;
    begin_at_sample(f->sample, shape->sample, shape->samples, x, directions, out->xi);
    return stationary(f->power, x, directions, triangle, (int)shape->degree, out->xi,
                      &out->squared);
}

/* The closest point of one facet to x, from its origin. */
static void closest(const Shape *shape, const Facet *f, Vector x, Closest *out)
{
    const int directions = (int)shape->directions, triangle = (int)shape->triangle;
    if (directions == 1 && shape->degree == 1) {
        on_segment(f->node[0], f->node[1], x, out);
        return;
    }
    int found = inside(shape, f, x, out);
    if (f->waved)
        found = nearest_of_several(f->power, x, directions, triangle, (int)shape->degree, found,
                                   out);
    found = found && excess(out->xi, directions, triangle) <= SEAM;
    if (found && !f->waved)
        return;
    if (directions == 1) {
        on_ends(f->node[0], f->node[1], x, found, out);
        return;
    }
    if (!found)
        out->squared = INFINITY;
    for (int side = 0; side < (triangle ? 3 : 4); ++side) {
        Closest there;
        on_side(shape, f, side, x, &there);
        if (there.squared < out->squared)
            *out = there;
    }
}

INLINE Vector from_origin(const Surface *s, const Facet *f, const double *points, int64_t q)
{
    const int64_t dim = s->shape->directions + 1;
    return less(vector(points + q * dim, dim), f->origin);
}

static void write(const Surface *s, const Task *t, int64_t q, int32_t facet, const Closest *at)
{
    t->found[q] = facet;
    t->entity[q] = (int32_t)at->entity;
    for (int64_t b = 0; b < s->shape->directions; ++b)
        t->xi[q * s->shape->directions + b] = at->xi[b];
}

/* Whether the facet that a point was on keeps it. */
static int stays(const Surface *s, const Task *t, int64_t q)
{
    const Shape *shape = s->shape;
    const Facet *f = facet_of(s, t->kept[q]);
    Closest at;
    if (!inside(shape, f, from_origin(s, f, t->points, q), &at)
        || !(excess(at.xi, (int)shape->directions, (int)shape->triangle) <= t->overrun))
        return 0;
    write(s, t, q, t->kept[q], &at);
    return 1;
}

/* Bounds on the distances of a point's facets, infinite where they are too far; the least one. */
static int64_t bounds(const Surface *s, const Task *t, int64_t q, const int32_t *facet,
                      const double *beyond, int64_t count)
{
    int64_t first = 0;
    for (int64_t k = 0; k < count; ++k) {
        t->bound[k] = INFINITY;
        if (beyond && !(beyond[k] <= t->limit))
            continue;
        const Facet *f = facet_of(s, facet[k]);
        t->bound[k] = sqrt(bound_of(f, from_origin(s, f, t->points, q)));
        if (t->bound[k] < t->bound[first])
            first = k;
    }
    return first;
}

/* Distance of one of a point's facets. */
static double attempt(const Surface *s, const Task *t, int64_t q, int32_t facet, Closest *out)
{
    const Facet *f = facet_of(s, facet);
    closest(s->shape, f, from_origin(s, f, t->points, q), out);
    return sqrt(out->squared);
}

/* The least distance of a point from its facets. The bounds of those that may be as close become
 * their distances, the others infinite; or with `kept` all bounds stay. */
static double nearest(const Surface *s, const Task *t, int64_t q, const int32_t *facet,
                      int64_t count, int64_t first, int kept)
{
    double least = attempt(s, t, q, facet[first], t->tried + first);
    if (!kept)
        t->bound[first] = least;
    for (int64_t k = 0; k < count; ++k) {
        if (k == first)
            continue;
        /* The bounds are rounded too. */
        int close = t->bound[k] <= (least + t->tie) * (1.0 + 1e-9);
        double distance = close ? attempt(s, t, q, facet[k], t->tried + k) : INFINITY;
        if (!kept)
            t->bound[k] = distance;
        least = fmin(least, distance);
    }
    return least;
}

/* Of facets equally close the first, one that holds the point inside before all others. */
static void choose(const Surface *s, const Task *t, int64_t q)
{
    const int32_t *facet = t->facet + t->start[q];
    const double *beyond = t->beyond + t->start[q];
    int64_t count = t->start[q + 1] - t->start[q];
    if (t->alone && t->alone[q] >= 0) {
        facet = t->alone + q;
        beyond = 0;
        count = 1;
    }
    const int64_t first = bounds(s, t, q, facet, beyond, count);
    const double least = nearest(s, t, q, facet, count, first, 0);
    int64_t best = first, best_rank = INT64_MAX;
    for (int64_t k = 0; k < count; ++k) {
        if (!(t->bound[k] <= least + t->tie))
            continue;
        int64_t rank = facet[k] + (t->tried[k].entity == INTERIOR ? 0 : s->facets);
        if (rank < best_rank) {
            best_rank = rank;
            best = k;
        }
    }
    write(s, t, q, facet[best], t->tried + best);
}

/* By how much the distance of each facet in a point's list exceeds the least one, at least. */
void tribox_beyond(const Surface *s, const Task *t, double *beyond)
{
    for (int64_t q = 0; q < t->count; ++q) {
        const int32_t *facet = t->facet + t->start[q];
        int64_t count = t->start[q + 1] - t->start[q];
        if (count == 0)
            continue;
        int64_t first = bounds(s, t, q, facet, 0, count);
        double least = nearest(s, t, q, facet, count, first, 1);
        for (int64_t k = 0; k < count; ++k)
            beyond[t->start[q] + k] = t->bound[k] - least;
    }
}

void tribox_closest_points(const Surface *s, const Task *t)
{
    for (int64_t q = 0; q < t->count; ++q)
        if (!t->kept || !stays(s, t, q))
            choose(s, t, q);
}

/* Distances (p) of pairs of a point and a facet. */
void tribox_distances(const Surface *s, const double *points, const int32_t *point,
                      const int32_t *facet, int64_t count, double *distance)
{
    for (int64_t k = 0; k < count; ++k) {
        const Facet *f = facet_of(s, facet[k]);
        Closest at;
        closest(s->shape, f, from_origin(s, f, points, point[k]), &at);
        distance[k] = sqrt(at.squared);
    }
}

void tribox_places(const Surface *s, const Geometry *g)
{
    const int64_t directions = s->shape->directions, dim = directions + 1;
    for (int64_t q = 0; q < g->count; ++q) {
        const Facet *f = facet_of(s, g->facet[q]);
        Place p;
        place_at(f->power, (int)directions, (int)s->shape->degree, g->xi + q * directions, &p);
        for (int64_t b = 0; b < directions; ++b)
            store(g->tangents, q * directions + b, dim, p.d[b]);
        for (int64_t b = 0; g->curvature && b < directions * directions; ++b)
            store(g->curvature, q * directions * directions + b, dim, p.h[b - b / 2]);
        store(g->foot, q, dim, plus(f->origin, 1.0, p.y));
        if (!g->points)
            continue;
        if (directions == 1)
            p.d[1] = (Vector){{0.0, 0.0, -1.0}}; /* the normal is the tangent turned left */
        Vector normal = cross(p.d[0], p.d[1]);
        normal = times(1.0 / sqrt(dot(normal, normal)), normal);
        store(g->normal, q, dim, normal);
        g->gap[q] = dot(less(from_origin(s, f, g->points, q), p.y), normal);
    }
}
