/* The geometry of a contact pair in space, point by point: closest points on plane triangles and
 * bilinear quadrilaterals, as geometry/surfaces/projection.py has it. The rest: contact_pair.h.
 *
 * Newton's method for a point starts from where the last step has left it, on the facet that it was
 * on; candidates whose bounding boxes are further away than the best facet so far are passed over.
 */

#define DIM 3
#include "contact_pair.h"

#include <stddef.h>

#define INTERIOR (-1)
#define CORNER 8
#define SEAM 1e-11  /* reference distance past a seam up to which a point belongs to the facet */
#define STEPS 40    /* of Newton's method, at most */
#define CLASSES 8   /* of facets of about one size, within a factor of four */
#define MOST 64     /* facets that are equally close, at most */

/* Notes on a facet: its box, its centre, its class of size. */
enum { LOW = 0, HIGH = 3, CENTRE = 6, CLASS = 9, FACET_NOTES = 10 };
/* Notes on a far point: where it was when its facets were found, how far the nodes had moved then,
 * by how much the next facet was further, and the facets. */
enum { PLACE = 0, NODES = 3, MARGIN = 4, FACETS = 5, FAR_NOTES = FACETS + CLASSES };

typedef struct {
    Vector corner[4], b, c, d; /* y = corner[0] + b xi + c eta + d xi eta */
    int nodes;
} Facet;

typedef struct {
    double xi[2], distance;
    int32_t facet, entity;
} Closest;

static const double REFERENCE[4][2] = {{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}, {1.0, 1.0}};
/* Corners of each side, with the domain on the left, by the number of corners. */
static const int SIDES[5][4][2] = {
    [3] = {{0, 1}, {1, 2}, {2, 0}},
    [4] = {{0, 1}, {1, 3}, {3, 2}, {2, 0}},
};

static inline Vector cross(Vector a, Vector b)
{
    return (Vector){{a.c[1] * b.c[2] - a.c[2] * b.c[1], a.c[2] * b.c[0] - a.c[0] * b.c[2],
                     a.c[0] * b.c[1] - a.c[1] * b.c[0]}};
}

static double stretch(const Vector *tangents)
{
    return norm(cross(tangents[0], tangents[1]));
}

static Vector normal_of(const Vector *tangents)
{
    Vector n = cross(tangents[0], tangents[1]);
    double length = norm(n);
    return (Vector){{n.c[0] / length, n.c[1] / length, n.c[2] / length}};
}

static double share_of(const Pair *p, int64_t q)
{
    return 1.0;
}

static void shape_at(const Pair *p, const double *xi, double *values)
{
    double u = xi[0], v = xi[1];
    if (p->facet_nodes == 3) {
        values[0] = 1.0 - u - v, values[1] = u, values[2] = v;
        return;
    }
    values[0] = (1.0 - u) * (1.0 - v), values[1] = u * (1.0 - v);
    values[2] = (1.0 - u) * v, values[3] = u * v;
}

/* -- one facet ------------------------------------------------------------------------------ */

static inline Facet facet_of(const Pair *p, int32_t number)
{
    Facet f;
    f.nodes = (int)p->facet_nodes;
    for (int a = 0; a < f.nodes; ++a)
        f.corner[a] = at(p->current, p->facets[f.nodes * number + a]);
    f.b = less(f.corner[1], f.corner[0]);
    f.c = less(f.corner[2], f.corner[0]);
    f.d = f.nodes == 4 ? less(less(f.corner[3], f.corner[2]), f.b) : (Vector){{0.0, 0.0, 0.0}};
    return f;
}

static inline Vector point_of(const Facet *f, const double *xi)
{
    Vector y = plus(plus(f->corner[0], xi[0], f->b), xi[1], f->c);
    return plus(y, xi[0] * xi[1], f->d);
}

static inline void tangents_of(const Facet *f, const double *xi, Vector *tau)
{
    tau[0] = plus(f->b, xi[1], f->d);
    tau[1] = plus(f->c, xi[0], f->d);
}

static Vector place_on(const Pair *p, int32_t facet, const double *xi, Vector *tangents)
{
    Facet f = facet_of(p, facet);
    tangents_of(&f, xi, tangents);
    return point_of(&f, xi);
}

/* How far xi is outside the reference domain; at most zero inside. */
static inline double excess(const Facet *f, const double *xi)
{
    double least = fmax(-xi[0], -xi[1]);
    if (f->nodes == 3)
        return fmax(least, xi[0] + xi[1] - 1.0);
    return fmax(least, fmax(xi[0], xi[1]) - 1.0);
}

static inline double squared_at(const Facet *f, Vector x, const double *xi)
{
    Vector apart = less(x, point_of(f, xi));
    return dot(apart, apart);
}

/* The nearest of three by three samples. */
static void nearest_sample(const Facet *f, Vector x, double *xi)
{
    double best = INFINITY;
    for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i) {
            double sample[2] = {0.5 * i, 0.5 * j}, squared = squared_at(f, x, sample);
            if (squared < best)
                best = squared, xi[0] = sample[0], xi[1] = sample[1];
        }
}

/* Newton's step at xi, with the Gauss-Newton matrix where the Hessian is not positive definite;
 * returns whether it is. */
static int newton_step(const Facet *f, Vector x, const double *xi, double *step)
{
    Vector tau[2], apart = less(x, point_of(f, xi));
    tangents_of(f, xi, tau);
    double r = dot(tau[0], apart), s = dot(tau[1], apart);
    double a = dot(tau[0], tau[0]), b = dot(tau[0], tau[1]), c = dot(tau[1], tau[1]);
    double metric = a * c - b * b, bent = b - dot(f->d, apart), hessian = a * c - bent * bent;
    int convex = hessian > 1e-8 * metric;
    double off = convex ? bent : b, over = 1.0 / (convex ? hessian : metric);
    step[0] = (c * r - off * s) * over;
    step[1] = (a * s - off * r) * over;
    return convex;
}

/* Newton's method from xi for the point where the distance is least, inside or near the domain;
 * returns whether there is one. */
static int stationary(const Facet *f, Vector x, double *xi)
{
    double step[2];
    if (f->nodes == 3) {
        xi[0] = xi[1] = 1.0 / 3.0;
        newton_step(f, x, xi, step);
        xi[0] += step[0], xi[1] += step[1];
        return 1;
    }
    for (int k = 0; k < STEPS; ++k) {
        int convex = newton_step(f, x, xi, step);
        double size = fmax(fabs(step[0]), fabs(step[1])), old[2] = {xi[0], xi[1]};
        double most = squared_at(f, x, old) * (1.0 + 1e-12);
        for (int half = 0; half < 13; ++half) {
            xi[0] = old[0] + step[0], xi[1] = old[1] + step[1];
            if (!(squared_at(f, x, xi) > most))
                break;
            step[0] *= 0.5, step[1] *= 0.5;
        }
        if (size < 1e-13 || (size < 1e-9 && convex))
            return convex;
        if (!(excess(f, xi) < 0.3) || (xi[0] == old[0] && xi[1] == old[1]))
            return 0;
    }
    return 0;
}

/* The closest point on the sides of a facet. */
static void on_sides(const Facet *f, Vector x, Closest *out)
{
    double best = INFINITY;
    for (int side = 0; side < f->nodes; ++side) {
        const int *ends = SIDES[f->nodes][side];
        Vector start = f->corner[ends[0]], way = less(f->corner[ends[1]], start);
        Vector apart = less(x, start);
        double free = dot(apart, way) / dot(way, way), s = fmin(fmax(free, 0.0), 1.0);
        apart = plus(apart, -s, way);
        double squared = dot(apart, apart);
        if (!(squared < best))
            continue;
        best = squared;
        const double *from = REFERENCE[ends[0]], *to = REFERENCE[ends[1]];
        out->xi[0] = from[0] + s * (to[0] - from[0]);
        out->xi[1] = from[1] + s * (to[1] - from[1]);
        out->entity = free < 0.0 ? CORNER + ends[0] : free > 1.0 ? CORNER + ends[1] : side;
    }
    out->distance = sqrt(best);
}

/* The closest point of a facet; Newton's method starts from `warm` if that leads inside. */
static Closest closest_on(const Pair *p, int32_t number, Vector x, const double *warm)
{
    Facet f = facet_of(p, number);
    Closest out = {.facet = number, .entity = INTERIOR};
    int found = 0;
    if (warm) {
        out.xi[0] = warm[0], out.xi[1] = warm[1];
        found = stationary(&f, x, out.xi) && excess(&f, out.xi) <= SEAM;
    }
    if (!found) {
        nearest_sample(&f, x, out.xi);
        found = stationary(&f, x, out.xi) && excess(&f, out.xi) <= SEAM;
    }
    if (found)
        out.distance = sqrt(squared_at(&f, x, out.xi));
    else
        on_sides(&f, x, &out);
    return out;
}

/* -- all facets ----------------------------------------------------------------------------- */

static void prepare(Pair *p)
{
    double largest = 0.0;
    for (int64_t k = 0; k < p->facet_count; ++k) {
        double *notes = p->facet_notes + FACET_NOTES * k, radius = 0.0;
        const int32_t *nodes = p->facets + p->facet_nodes * k;
        for (int i = 0; i < DIM; ++i) {
            double low = INFINITY, high = -INFINITY, sum = 0.0;
            for (int64_t a = 0; a < p->facet_nodes; ++a) {
                double x = p->current[DIM * nodes[a] + i];
                low = fmin(low, x), high = fmax(high, x), sum += x;
            }
            notes[LOW + i] = low, notes[HIGH + i] = high;
            notes[CENTRE + i] = sum / (double)p->facet_nodes;
        }
        Vector centre = at(notes + CENTRE, 0);
        for (int64_t a = 0; a < p->facet_nodes; ++a) {
            Vector apart = less(at(p->current, nodes[a]), centre);
            radius = fmax(radius, dot(apart, apart));
        }
        notes[CLASS] = radius;
        largest = fmax(largest, radius);
    }
    for (int64_t k = 0; k < p->facet_count; ++k) { /* squared radii: a factor of sixteen */
        double *notes = p->facet_notes + FACET_NOTES * k, bound = largest;
        int number = 0;
        while (number < CLASSES - 1 && notes[CLASS] < bound)
            bound *= 0.0625, ++number;
        notes[CLASS] = number;
    }
}

/* Distance of x from the box of a facet: no more than that from the facet. */
static inline double to_box(const Pair *p, int32_t facet, Vector x)
{
    const double *notes = p->facet_notes + FACET_NOTES * (int64_t)facet;
    double squared = 0.0;
    for (int i = 0; i < DIM; ++i) {
        double out = fmax(fmax(notes[LOW + i] - x.c[i], x.c[i] - notes[HIGH + i]), 0.0);
        squared += out * out;
    }
    return sqrt(squared);
}

/* Of facets equally close, the first that has the point inside, or else the first. */
static Closest first_of(const Pair *p, const Closest *found, int count, double best)
{
    int chosen = 0;
    int64_t least = INT64_MAX;
    for (int k = 0; k < count; ++k) {
        int64_t rank = found[k].facet + (found[k].entity == INTERIOR ? 0 : p->facet_count);
        if (found[k].distance <= best + p->tie && rank < least)
            least = rank, chosen = k;
    }
    return found[chosen];
}

static Closest among_candidates(const Pair *p, int64_t q, Vector x)
{
    const int32_t *candidate = p->candidate + q * p->candidates, before = p->facet_before[q];
    Closest found[MOST];
    int count = 0;
    int64_t last = -1;
    double best = INFINITY;
    for (int64_t k = 0; k < p->candidates && last < 0; ++k)
        if (candidate[k] == before)
            last = k;
    if (last >= 0) {
        found[count++] = closest_on(p, before, x, p->xi_before + ALONG * q);
        best = found[0].distance;
    }
    for (int64_t k = 0; k < p->candidates; ++k) {
        int32_t facet = candidate[k];
        if (facet == before || (k > 0 && facet == candidate[0]))
            continue; /* rows with fewer candidates repeat their first */
        if (to_box(p, facet, x) > best + 1e-9 * (best + p->slack))
            continue;
        Closest one = closest_on(p, facet, x, NULL);
        if (one.distance > best + p->tie)
            continue;
        best = fmin(best, one.distance);
        if (count == MOST)
            found[0] = first_of(p, found, count, best), count = 1;
        found[count++] = one;
    }
    return first_of(p, found, count, best);
}

/* Facets with the nearest centre of each class, and by how much the next one is further. */
static void nearest_centres(const Pair *p, Vector x, double *notes)
{
    double first[CLASSES], second[CLASSES], margin = INFINITY;
    for (int k = 0; k < CLASSES; ++k)
        first[k] = second[k] = INFINITY, notes[FACETS + k] = -1.0;
    for (int64_t f = 0; f < p->facet_count; ++f) {
        const double *of = p->facet_notes + FACET_NOTES * f;
        Vector apart = less(x, at(of + CENTRE, 0));
        double squared = dot(apart, apart);
        int k = (int)of[CLASS];
        if (squared < first[k]) {
            second[k] = first[k], first[k] = squared;
            notes[FACETS + k] = (double)f;
        } else if (squared < second[k]) {
            second[k] = squared;
        }
    }
    for (int k = 0; k < CLASSES; ++k)
        if (first[k] < INFINITY && second[k] < INFINITY)
            margin = fmin(margin, sqrt(second[k]) - sqrt(first[k]));
    put(notes + PLACE, 0, x);
    notes[NODES] = p->moved;
    notes[MARGIN] = margin;
}

/* A point many facets away: the closest of the facets with the nearest centres. They are looked for
 * only when points and nodes have moved enough for another one to be nearer. */
static Closest far_away(const Pair *p, int64_t q, Vector x)
{
    double *notes = p->far_notes + FAR_NOTES * q;
    double moved = norm(less(x, at(notes + PLACE, 0))) + notes[NODES] + p->moved;
    if (!(notes[MARGIN] > 2.0 * moved + 1e-9 * p->slack))
        nearest_centres(p, x, notes);
    Closest out = {.distance = INFINITY};
    for (int k = CLASSES - 1; k >= 0; --k) {
        if (notes[FACETS + k] < 0.0)
            continue;
        Closest one = closest_on(p, (int32_t)notes[FACETS + k], x, NULL);
        if (one.distance < out.distance)
            out = one;
    }
    return out;
}

/* -- edges and corners ---------------------------------------------------------------------- */

/* Outward direction at a node: normals of the facets there, by their angles. */
static Vector corner_outward(const Pair *p, int32_t node)
{
    Vector outward = {{0.0, 0.0, 0.0}}, tau[2];
    for (int64_t k = node * p->around_most; k < (node + 1) * p->around_most; ++k) {
        if (p->around[k] < 0)
            continue;
        Facet f = facet_of(p, p->around[k]);
        int corner = p->around_corner[k], next = 0, last = 0;
        for (int s = 0; s < f.nodes; ++s) {
            const int *ends = SIDES[f.nodes][s];
            next = ends[0] == corner ? ends[1] : next;
            last = ends[1] == corner ? ends[0] : last;
        }
        Vector a = less(f.corner[next], f.corner[corner]);
        Vector b = less(f.corner[last], f.corner[corner]);
        double cosine = dot(a, b) / (norm(a) * norm(b));
        tangents_of(&f, REFERENCE[corner], tau);
        outward = plus(outward, acos(fmin(fmax(cosine, -1.0), 1.0)), normal_of(tau));
    }
    return outward;
}

/* Outward direction on a side: the sum of both facets' normals there. */
static Vector side_outward(const Pair *p, const Closest *at_side, Vector normal)
{
    int nodes = (int)p->facet_nodes;
    int64_t k = nodes * (int64_t)at_side->facet + at_side->entity;
    if (p->across[k] < 0)
        return normal;
    const int *ends = SIDES[nodes][at_side->entity], *there = SIDES[nodes][p->across_side[k]];
    double s = 0.0, squared = 0.0, xi[2];
    for (int i = 0; i < 2; ++i) {
        double way = REFERENCE[ends[1]][i] - REFERENCE[ends[0]][i];
        s += (at_side->xi[i] - REFERENCE[ends[0]][i]) * way;
        squared += way * way;
    }
    s = 1.0 - s / squared; /* both facets run round their own side: in opposite directions */
    for (int i = 0; i < 2; ++i)
        xi[i] = REFERENCE[there[0]][i] + s * (REFERENCE[there[1]][i] - REFERENCE[there[0]][i]);
    Facet other = facet_of(p, p->across[k]);
    Vector tau[2];
    tangents_of(&other, xi, tau);
    return plus(normal, 1.0, normal_of(tau));
}

/* Normal and gap of a point on a side or a corner. */
static void clamp(Pair *p, int64_t q, Vector x, const Closest *found)
{
    Vector outward, apart = less(x, at(p->foot, q));
    if (found->entity >= CORNER) {
        int32_t node = p->facets[p->facet_nodes * found->facet + found->entity - CORNER];
        outward = corner_outward(p, node);
        p->on_surface[q] = !p->open[node];
    } else {
        outward = side_outward(p, found, at(p->normal, q));
        p->on_surface[q] = p->across[p->facet_nodes * found->facet + found->entity] >= 0;
    }
    double size = norm(outward), distance = norm(apart);
    double sign = dot(apart, outward) < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < DIM; ++i)
        outward.c[i] = outward.c[i] / size;
    if (distance > 1e-12 * norm(at(p->tangent, ALONG * q)))
        for (int i = 0; i < DIM; ++i)
            outward.c[i] = sign * apart.c[i] / distance;
    put(p->normal, q, outward);
    p->gap[q] = sign * distance;
}

static void project(Pair *p, int64_t q)
{
    Vector x = at(p->position, q), tau[2];
    int far = p->candidate[q * p->candidates] < 0;
    Closest found = far ? far_away(p, q, x) : among_candidates(p, q, x);
    Vector foot = place_on(p, found.facet, found.xi, tau), n = normal_of(tau);
    p->facet[q] = found.facet;
    for (int b = 0; b < ALONG; ++b) {
        p->xi[ALONG * q + b] = found.xi[b];
        put(p->tangent, ALONG * q + b, tau[b]);
    }
    p->clamped[q] = found.entity != INTERIOR;
    p->on_surface[q] = 1;
    put(p->foot, q, foot);
    put(p->normal, q, n);
    p->gap[q] = dot(less(x, foot), n);
    if (p->clamped[q])
        clamp(p, q, x, &found);
}
