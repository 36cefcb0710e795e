/* The geometry of a contact pair in the plane, point by point, as geometry/surfaces/projection.py
 * has it: closest points on segments, shares beside open ends. The rest is in contact_pair.h. */

#define DIM 2
#include "contact_pair.h"

static double stretch(const Vector *tangents)
{
    return norm(tangents[0]);
}

static Vector normal_of(const Vector *tangents)
{
    double length = norm(tangents[0]);
    return (Vector){{-tangents[0].c[1] / length, tangents[0].c[0] / length}};
}

static void shape_at(const Pair *p, const double *xi, double *values)
{
    values[0] = 1.0 - xi[0];
    values[1] = xi[0];
}

static Vector edge(const Pair *p, int32_t facet, Vector *start)
{
    *start = at(p->current, p->facets[2 * facet]);
    return less(at(p->current, p->facets[2 * facet + 1]), *start);
}

static Vector place_on(const Pair *p, int32_t facet, const double *xi, Vector *tangents)
{
    Vector start;
    tangents[0] = edge(p, facet, &start);
    return plus(start, xi[0], tangents[0]);
}

static void prepare(Pair *p)
{
}

/* The closest point on a vertex: the normal points to it, on the side of the mean normal. */
static void at_vertex(Pair *p, int64_t q, Vector x, double free, Vector tau)
{
    int32_t vertex = p->facets[2 * p->facet[q] + (free > 1.0)];
    int32_t sides[2] = {p->previous[vertex], p->next[vertex]};
    Vector outward = {{0.0, 0.0}}, start;
    for (int s = 0; s < 2; ++s)
        if (sides[s] >= 0) {
            Vector side = edge(p, sides[s], &start);
            outward = plus(outward, 1.0, normal_of(&side));
        }
    double size = norm(outward);
    outward = (Vector){{outward.c[0] / size, outward.c[1] / size}};
    Vector apart = less(x, at(p->foot, q));
    double distance = norm(apart), sign = dot(apart, outward) < 0.0 ? -1.0 : 1.0;
    p->on_surface[q] = sides[0] >= 0 && sides[1] >= 0;
    if (distance > 1e-12 * norm(tau))
        outward = (Vector){{sign * apart.c[0] / distance, sign * apart.c[1] / distance}};
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
    put(p->normal, q, normal_of(&tau));
    p->gap[q] = dot(less(x, at(p->foot, q)), at(p->normal, q));
    if (p->clamped[q])
        at_vertex(p, q, x, free, tau);
}

static double share_of(const Pair *p, int64_t q)
{
    const int32_t *ends = p->facets + 2 * p->facet[q];
    int start_open = p->previous[ends[0]] < 0, end_open = p->next[ends[1]] < 0;
    if (!start_open && !end_open)
        return 1.0;
    double length = norm(less(at(p->master, ends[1]), at(p->master, ends[0])));
    double steep = length / fmin(p->reach[q], length), share = 1.0;
    if (start_open)
        share = fmin(share, p->xi[q] * steep);
    if (end_open)
        share = fmin(share, (1.0 - p->xi[q]) * steep);
    return share;
}
