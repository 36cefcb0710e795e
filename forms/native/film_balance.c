/* The mass balance of a film on places of a line or ring, and its linear equations.
 *
 * Places n have numbers along the film, in which neighbours lie `reach` apart at most. Rows of the
 * matrix (n, 3 reach + 1) begin `reach` before the diagonal; what pivoting fills comes behind.
 * tribox/forms/film/reynolds.py says what is computed, and _Balance there is struct film. */

#include <math.h>
#include <stdint.h>
#include <string.h>

struct film {
    int64_t places, faces, reach;
    double scale, smoothing;
    const int64_t *ends, *order, *number;
    /* Of faces: k b/12 L, m^3, and u h b; of places: h M/dt, v/dt, w of reservoirs, accepted error. */
    const double *leads, *moves, *stores, *had, *held, *limit;
    const uint8_t *fixed;
    const double *viscosity, *thickens; /* of faces, and by pressure */
    double *unknown;
    int64_t *at;
    double *pressure, *filled, *d_pressure, *d_filled, *balance, *residual;
    double *middle, *flux, *matrix; /* the first two of faces */
};

int64_t tribox_film_size(void) { return sizeof(struct film); }

/* Pressure and filling of the unknown w, their derivatives, and the mean pressures of faces. */
void tribox_film_parts(const struct film *f)
{
    const double eps = f->smoothing;
    for (int64_t n = 0; n < f->places; ++n) {
        /* The smaller of (r + w)/2 and (r - w)/2 from their product: nothing cancels. */
        const double w = f->unknown[n], root = sqrt(w * w + 4.0 * eps * eps);
        const double larger = 0.5 * (root + fabs(w)), smaller = eps > 0.0 ? eps * eps / larger : 0.0;
        const double pressed = w > 0.0 ? larger : smaller, missing = w > 0.0 ? smaller : larger;
        f->pressure[n] = f->scale * pressed;
        f->filled[n] = 1.0 - missing;
        f->d_pressure[n] = f->scale * pressed / root;
        f->d_filled[n] = missing / root;
    }
    for (int64_t e = 0; e < f->faces; ++e)
        f->middle[e] = 0.5 * (f->pressure[f->ends[2 * e]] + f->pressure[f->ends[2 * e + 1]]);
}

/* Flow, balance and matrix for the parts at hand; whether all places balance. */
int tribox_film_assemble(const struct film *f)
{
    const int64_t width = 3 * f->reach + 1;
    memset(f->matrix, 0, sizeof(double) * f->places * width);
    for (int64_t n = 0; n < f->places; ++n) {
        const double stored = f->stores[n];
        double *diagonal = f->matrix + f->number[n] * width + f->reach;
        f->balance[n] = f->filled[n] * stored - f->had[n];
        *diagonal = f->fixed[n] ? 1.0 : f->d_filled[n] * stored;
    }
    for (int64_t e = 0; e < f->faces; ++e) {
        const int64_t end[2] = {f->ends[2 * e], f->ends[2 * e + 1]};
        const double steep = f->leads[e] / f->viscosity[e], moved = f->moves[e];
        const double drop = f->pressure[end[1]] - f->pressure[end[0]];
        const double thinner = 0.5 * steep * drop / f->viscosity[e] * f->thickens[e];
        const int up = moved < 0.0;
        const double flow = moved * f->filled[end[up]] - steep * drop;
        double by[2] = {(thinner + steep) * f->d_pressure[end[0]],
                        (thinner - steep) * f->d_pressure[end[1]]};
        by[up] += moved * f->d_filled[end[up]];
        f->flux[e] = flow;
        f->balance[end[0]] += flow;
        f->balance[end[1]] -= flow;
        for (int i = 0; i < 2; ++i) {
            if (f->fixed[end[i]])
                continue;
            const int64_t row = f->number[end[i]];
            for (int j = 0; j < 2; ++j)
                f->matrix[row * width + f->reach + f->number[end[j]] - row] += i ? -by[j] : by[j];
        }
    }
    int balanced = 1;
    for (int64_t n = 0; n < f->places; ++n) {
        f->residual[n] = f->fixed[n] ? f->unknown[n] - f->held[n] : f->balance[n];
        balanced &= fabs(f->residual[n]) <= f->limit[n];
    }
    return balanced;
}

/* See tribox_film_solve; what is inlined knows its reach and number of columns. */
static inline __attribute__((always_inline)) int solve(const struct film *f, const int64_t reach,
                                                       const int64_t columns,
                                                       double *restrict right, double *restrict out)
{
    const int64_t width = 3 * reach + 1, count = f->places;
    double *matrix = f->matrix;
    for (int64_t i = 0; i < count; ++i) {
        double *row = matrix + i * width, most = 0.0, *b = right + f->order[i] * columns;
        for (int64_t k = 0; k <= 2 * reach; ++k)
            most = fmax(most, fabs(row[k]));
        const double over = most > 0.0 ? 1.0 / most : 1.0;
        for (int64_t k = 0; k <= 2 * reach; ++k)
            row[k] *= over;
        for (int64_t c = 0; c < columns; ++c)
            b[c] *= over;
        f->at[i] = f->order[i];
    }
    for (int64_t i = 0; i < count; ++i) {
        double *own = matrix + i * width + reach;
        const int64_t below = i + reach < count ? reach : count - 1 - i;
        int64_t best = 0;
        for (int64_t m = 1; m <= below; ++m) /* column i of the row m below */
            if (fabs(own[m * (width - 1)]) > fabs(own[best * (width - 1)]))
                best = m;
        if (best) {
            double *other = own + best * (width - 1);
            for (int64_t k = 0; k <= 2 * reach; ++k) {
                const double kept = own[k];
                own[k] = other[k];
                other[k] = kept;
            }
            const int64_t kept = f->at[i];
            f->at[i] = f->at[i + best];
            f->at[i + best] = kept;
        }
        if (!(fabs(own[0]) > 0.0))
            return 1;
        const double over = own[0] = 1.0 / own[0];
        const double *b = right + f->at[i] * columns;
        for (int64_t m = 1; m <= below; ++m) {
            double *other = own + m * (width - 1);
            const double share = other[0] * over;
            if (share == 0.0)
                continue;
            for (int64_t k = 1; k <= 2 * reach; ++k)
                other[k] -= share * own[k];
            double *mine = right + f->at[i + m] * columns;
            for (int64_t c = 0; c < columns; ++c)
                mine[c] -= share * b[c];
        }
    }
    for (int64_t i = count - 1; i >= 0; --i) {
        const double *own = matrix + i * width + reach, over = own[0];
        double *x = out + f->order[i] * columns;
        memcpy(x, right + f->at[i] * columns, sizeof(double) * columns);
        for (int64_t k = 1; k <= 2 * reach && i + k < count; ++k) {
            const double *far = out + f->order[i + k] * columns, entry = own[k];
            for (int64_t c = 0; c < columns; ++c)
                x[c] -= entry * far[c];
        }
        for (int64_t c = 0; c < columns; ++c)
            x[c] *= over;
    }
    return 0;
}

/* Solves with the matrix, which it spends, for right (n, columns), which too; into out of that size.
 * Rows are scaled by their largest entries, and pivots chosen among rows. 1 where it is singular. */
int tribox_film_solve(const struct film *f, int64_t columns, double *restrict right,
                      double *restrict out)
{
    if (f->reach == 1)
        return columns == 1 ? solve(f, 1, 1, right, out) : solve(f, 1, columns, right, out);
    return columns == 1 ? solve(f, f->reach, 1, right, out) : solve(f, f->reach, columns, right, out);
}
