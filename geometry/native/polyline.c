/* Closest points on a line in the plane made of straight pieces and arcs, and places on it.
 *
 * As geometry/surfaces/rigid_pieces.py has them: xi goes from 0 to 1 along a piece, a place is
 * P + xi D on a straight one and M + R(xi omega)(P - M) on an arc.
 *
 * Letters: q points, p pieces, e their two ends, i the plane.
 */

#include <math.h>
#include <stdint.h>

typedef struct {
    int64_t pieces;
    /* (p, i), (p, i), (p, i) and of arcs (p): the angle, 0 of straight ones; (p, i) from the centre
     * to the middle of an arc; (p, e) limits of xi; spheres (p, i), (p) that hold the pieces. */
    const double *start, *end, *centre, *sweep, *middle, *limits, *sphere, *radius;
} Line;

static double apart(const double *x, const double *y)
{
    const double a = x[0] - y[0], b = x[1] - y[1];
    return sqrt(a * a + b * b);
}

/* The place, and the tangent and second derivative by xi unless they are not asked for. */
static void place_of(const Line *l, int32_t p, double xi, double *place, double *tangent,
                     double *bend)
{
    const double *start = l->start + 2 * p, *end = l->end + 2 * p, *centre = l->centre + 2 * p;
    const double omega = l->sweep[p];
    if (omega == 0.0) {
        for (int i = 0; i < 2; ++i) {
            const double way = end[i] - start[i];
            place[i] = start[i] + xi * way;
            if (tangent)
                tangent[i] = way, bend[i] = 0.0;
        }
        return;
    }
    const double x = start[0] - centre[0], y = start[1] - centre[1];
    const double c = cos(xi * omega), s = sin(xi * omega), arm[2] = {c * x - s * y, c * y + s * x};
    place[0] = centre[0] + arm[0], place[1] = centre[1] + arm[1];
    if (!tangent)
        return;
    tangent[0] = -omega * arm[1], tangent[1] = omega * arm[0];
    bend[0] = -omega * omega * arm[0], bend[1] = -omega * omega * arm[1];
}

/* xi of the place nearest to x, as if the piece went on as it is. On arcs by the angle from the
 * middle, so that it jumps opposite to the arc. */
static double nearest(const Line *l, int32_t p, const double *x)
{
    const double *start = l->start + 2 * p, *centre = l->centre + 2 * p, *m = l->middle + 2 * p;
    if (l->sweep[p] == 0.0) {
        const double w[2] = {l->end[2 * p] - start[0], l->end[2 * p + 1] - start[1]};
        return ((x[0] - start[0]) * w[0] + (x[1] - start[1]) * w[1]) / (w[0] * w[0] + w[1] * w[1]);
    }
    const double arm[2] = {x[0] - centre[0], x[1] - centre[1]};
    const double across = m[0] * arm[1] - m[1] * arm[0], along = m[0] * arm[0] + m[1] * arm[1];
    return 0.5 + atan2(across, along) / l->sweep[p];
}

void tribox_line_places(const Line *l, int64_t count, const int32_t *piece, const double *xi,
                        double *place, double *tangent, double *bend)
{
    for (int64_t q = 0; q < count; ++q)
        place_of(l, piece[q], xi[q], place + 2 * q, tangent + 2 * q, bend + 2 * q);
}

/* Closest points (q, i). Of pieces equally close, within `tie`, the first is taken, one that holds
 * the point inside before one that holds it at an end. `held` (q): 0, or 1 and 2 at the first and
 * the second end of the piece. `found` (p, 2) is scratch. */
void tribox_line_closest(const Line *l, int64_t count, const double *x, double tie,
                         int32_t *piece, double *xi, uint8_t *held, double *found)
{
    for (int64_t q = 0; q < count; ++q, x += 2) {
        double reach = INFINITY, least = INFINITY;
        for (int64_t p = 0; p < l->pieces; ++p) {
            const double *c = l->sphere + 2 * p;
            found[2 * p] = apart(x, c);
            reach = fmin(reach, found[2 * p] + l->radius[p]);
        }
        for (int64_t p = 0; p < l->pieces; ++p) {
            const int near = !(found[2 * p] - l->radius[p] > (1.0 + 1e-12) * reach);
            found[2 * p] = INFINITY;
            if (!near)
                continue;
            double there[2], free = nearest(l, (int32_t)p, x);
            found[2 * p + 1] = free;
            free = fmin(fmax(free, l->limits[2 * p]), l->limits[2 * p + 1]);
            place_of(l, (int32_t)p, free, there, 0, 0);
            found[2 * p] = apart(x, there);
            least = fmin(least, found[2 * p]);
        }
        int chosen = 0, inside = 0;
        for (int64_t p = 0; p < l->pieces && !inside; ++p) {
            const double low = l->limits[2 * p], high = l->limits[2 * p + 1];
            const double free = found[2 * p + 1], at = fmin(fmax(free, low), high);
            inside = found[2 * p] <= least + tie && at == free;
            if (!inside && (chosen || !(found[2 * p] <= least + tie)))
                continue;
            chosen = 1;
            piece[q] = (int32_t)p, xi[q] = at;
            held[q] = inside ? 0 : free > at ? 2 : 1;
        }
    }
}
