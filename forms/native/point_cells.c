/* Loops over material points, several at a time: points by themselves, and those of cells of any kind
 * with the forces, the energy and the tangent of the cells.
 *
 * What the points do is a kernel, see Update of point_lanes.h: a cell's deformation gradients, its
 * points' stress and moduli, and its matrix never leave the processor's caches. With the gradients
 * B_a of the nodes' shape functions, in rings those over the radius h_a, and the weight w
 *
 *     F = 1 + sum of u_a (x) B_a,   F_33 = 1 + sum of h_a u_a,x,
 *     f_a = sum over points of w (P B_a + P_33 h_a e_x),
 *     K_ab = sum over points of w (b_a.c.b_b + (b_a.tau.b_b) 1),   b_a = F^-T B_a,
 *
 * the row and the column of 33 with h likewise; see MODULI of point_lanes.h for c and tau.
 */

#include "point_lanes.h"

/* How many the tables of callers have side by side. */
EXPORT int64_t tribox_lanes(void)
{
    return LANES;
}

/* The columns k of the lanes' rows. */
INLINE vec column(double *const *row, int64_t k)
{
    vec x;
    for (int l = 0; l < LANES; ++l)
        x[l] = row[l][k];
    return x;
}

/* The lanes' rows of a table, each `width` times a number. */
INLINE void find_rows(const double *table, int64_t width, const int64_t *number, double **row)
{
    for (int l = 0; l < LANES; ++l)
        row[l] = (double *)table + width * number[l];
}

/* `count` columns of the lanes' rows from the column `from` on: LANES at a time, the last of
 * them twice where they overlap others. */
INLINE void load(double *const *row, int64_t from, int count, vec *to)
{
    for (int k = 0; count < LANES && k < count; ++k)
        to[k] = column(row, from + k);
#pragma GCC unroll 1
    for (int k = 0; count >= LANES && k < count; k += LANES) {
        const int first = k + LANES <= count ? k : count - LANES;
        vec rows[LANES];
        for (int l = 0; l < LANES; ++l)
            __builtin_memcpy(&rows[l], row[l] + from + first, sizeof(vec));
        transpose(rows);
        __builtin_memcpy(to + first, rows, sizeof rows);
    }
}

/* The other way round. */
INLINE void store(const vec *values, int lanes, int count, double *const *row, int64_t to)
{
#pragma GCC unroll 1
    for (int k = 0; lanes == LANES && count >= LANES && k < count; k += LANES) {
        const int first = k + LANES <= count ? k : count - LANES;
        vec rows[LANES];
        __builtin_memcpy(rows, values + first, sizeof rows);
        transpose(rows);
        for (int l = 0; l < LANES; ++l)
            __builtin_memcpy(row[l] + to + first, &rows[l], sizeof(vec));
    }
    if (lanes == LANES && count >= LANES)
        return;
#pragma GCC unroll 1
    for (int l = 0; l < lanes; ++l)
        for (int k = 0; k < count; ++k)
            row[l][to + k] = ((const double *)(values + k))[l];
}

/* Makes values no numbers where `good` is not set. */
INLINE void spoil(int count, ivec good, vec *values)
{
#pragma GCC unroll 1
    for (int k = 0; k < count; ++k)
        values[k] = (vec)((ivec)values[k] | ~good); /* all bits set */
}

/* F^-1 in the plane (2, 2) or in space. */
INLINE void inverse_of(int space, const vec *F, vec *inverse)
{
    if (!space) {
        const vec r = 1.0 / (F[0] * F[3] - F[1] * F[2]);
        inverse[0] = F[3] * r, inverse[1] = -F[1] * r, inverse[2] = -F[2] * r, inverse[3] = F[0] * r;
        return;
    }
    vec cofactor[3][3];
    for (int i = 0; i < 3; ++i)
        cross(F + 3 * ((i + 1) % 3), F + 3 * ((i + 2) % 3), cofactor[i]);
    const vec r = 1.0 / dot(F, cofactor[0]);
    for (int i = 0; i < 3; ++i)
        for (int J = 0; J < 3; ++J)
            inverse[3 * J + i] = cofactor[i][J] * r;
}

/* The lower half of c from the upper one. */
INLINE void fill(int n, vec *c)
{
    for (int p = 0; p < n; ++p)
        for (int q = 0; q < p; ++q)
            c[n * p + q] = c[n * q + p];
}

/* dP/dF (p, p). */
static void by_gradients(int space, const vec *F, int symmetric, vec *moduli, vec *A)
{
    const int n = space ? 6 : 4, count = space ? 9 : 5;
    const int(*place)[2] = space ? IN_SPACE : IN_PLANE;
    vec *c = tangent_of(space, moduli), plane[4] = {}, inverse[9] = {};
    inverse_of(space, F, space ? inverse : plane);
    for (int k = 0; !space && k < 4; ++k)
        inverse[3 * (k / 2) + k % 2] = plane[k];
    if (!space)
        inverse[8] = 1.0 / F[4];
    if (symmetric)
        fill(n, c);
    for (int p = 0; p < count; ++p)
        for (int q = 0; q < count; ++q) {
            const int i = place[p][0], J = place[p][1], k = place[q][0], L = place[q][1];
            vec sum = all(0.0);
            for (int j = 0; j < 3; ++j)
                for (int l = 0; l < 3; ++l)
                    if (COUPLED(space, i, j) && COUPLED(space, k, l))
                        sum += (c[n * NUMBER[i][j] + NUMBER[k][l]] + (i == k ? moduli[NUMBER[j][l]] : all(0.0))) *
                               (inverse[3 * J + j] * inverse[3 * L + l]);
            A[count * p + q] = sum;
        }
}

/* Updates n points; returns whether any was not valid, where all but the state is no number.
 * `count` components of F and P, `width` values of a state, `symmetric` moduli or not; P (n, p), state
 * at the end (n, s), A = dP/dF (n, p, p) or null, energies (ENERGIES, n). */
EXPORT int64_t tribox_points(Update *update, const void *material, int64_t count, int64_t width, int64_t symmetric,
                             int64_t n, const double *F, const double *state, double *P,
                             double *end, double *A, double *energies)
{
    vec s[width], next[width];
    ivec bad = {};
    for (int64_t first = 0; first < n; first += LANES) {
        const int lanes = n - first < LANES ? (int)(n - first) : LANES, values = (int)count;
        vec f[9], stress[9], moduli[MODULI], slopes[81], energy[ENERGIES];
        int64_t number[LANES];
        double *row[LANES];
        ivec good, fine = ~(ivec){};
        for (int l = 0; l < LANES; ++l)
            number[l] = first + (l < lanes ? l : lanes - 1);
        find_rows(F, count, number, row);
        load(row, 0, values, f);
        find_rows(state, width, number, row);
        load(row, 0, (int)width, s);
        update(material, f, s, stress, next, 0, energy, &good);
        if (A) {
            update(material, f, s, 0, next, moduli, 0, &fine);
            by_gradients(count == 9, f, (int)symmetric, moduli, slopes);
            good &= fine;
        }
        spoil(values, good, stress);
        spoil(ENERGIES, good, energy);
        find_rows(P, count, number, row);
        store(stress, lanes, values, row, 0);
        find_rows(end, width, number, row);
        store(next, lanes, (int)width, row, 0);
        find_rows(energies, 1, number, row);
        for (int k = 0; k < ENERGIES; ++k)
            store(energy + k, lanes, 1, row, k * n);
        if (A) {
            spoil(values * values, good, slopes);
            find_rows(A, count * count, number, row);
            store(slopes, lanes, values * values, row, 0);
        }
        bad |= ~good;
    }
    return any(bad);
}

/* What a call works on. `shape` (points, nodes, 1 + parents): the nodes' functions and their derivatives
 * by the parent coordinates, as many as there are dimensions, in rings at the centre also the mixed one;
 * `table` (blocks, points, dim parents + 2, LANES): the shares of these in the derivatives by place, the
 * weight, and in rings 1/x; `node` (blocks, nodes, LANES), `cell` (blocks,
 * LANES) the number of a cell in the body, whose points are `points` cell and those that follow; the
 * last block repeats its last cell where there are fewer than LANES, and counts `lanes_of_last`.
 *
 * With `update` the points are evaluated from `state` (k, width), and `end` (k, width) is written if
 * there are `energies` (ENERGIES) to add to, and read if not, see Update. Without it P (k, p) and
 * moduli A (k, n + n n) are read where forces and values are wanted. What of these is not null is added to:
 * `values` from start (cells, a, i, b) on, the columns of b in the row of (a, i); F (k, p) is written.
 * With `take` (cells) some cells alone have values, and a place in start. `read`: how many columns of
 * the state moduli need; `symmetric`: whether they are. `excess` (cells of the body) is added to
 * dW/dJ in moduli.
 *
 * Of the same cells there may be more points: at the `same` places, whose moduli are added up, and at
 * others, `next`, whose forces and values are. */
typedef struct Work {
    int64_t blocks, lanes_of_last, points, nodes, parents, width, read, symmetric;
    const double *shape, *table;
    const int32_t *node, *cell;
    const double *u;
    Update *update;
    const void *material;
    const double *state;
    const double *P, *A;
    double *F, *end, *energies, *forces, *values;
    const int32_t *start;
    const uint8_t *take;
    const double *excess;
    const struct Work *same, *next;
} Work;

/* A point of a block's cells: gradients of the nodes' functions, with those over the radius last. */
INLINE void gradients(enum section section, int nodes, int parents, const double *shape,
                      const vec *table, vec (*B)[3])
{
    const int dim = section == SPACE ? 3 : 2;
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a, shape += 1 + parents) {
        for (int i = 0; i < dim; ++i) {
            B[a][i] = shape[1] * table[i];
            for (int z = 1; z < parents; ++z)
                B[a][i] += shape[1 + z] * table[dim * z + i];
        }
        if (section == RING)
            B[a][2] = shape[0] * table[dim * parents + 1];
    }
}

/* F from the derivatives by parent coordinates of the displacement relative to a node, that of which
 * is `radial` across. */
INLINE void deformation(enum section section, int nodes, int parents, const double *shape,
                        const vec *table, vec (*u)[3], vec radial, vec *F)
{
    const int dim = section == SPACE ? 3 : 2;
    vec d[9], hoop = radial;
    for (int p = 0; p < dim * parents; ++p)
        d[p] = all(0.0);
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a, shape += 1 + parents) {
        for (int p = 0; p < dim * parents; ++p)
            d[p] += shape[1 + p % parents] * u[a][p / parents];
        if (section == RING)
            hoop += shape[0] * u[a][0];
    }
    for (int i = 0; i < dim; ++i)
        for (int J = 0; J < dim; ++J) {
            vec sum = d[parents * i] * table[J];
            for (int z = 1; z < parents; ++z)
                sum += d[parents * i + z] * table[dim * z + J];
            F[dim * i + J] = i == J ? 1.0 + sum : sum;
        }
    if (section != SPACE)
        F[4] = section == RING ? 1.0 + hoop * table[dim * parents + 1] : all(1.0);
}

/* The nodes' forces of the stress at a point, carried over to parent coordinates first. */
INLINE void add_forces(enum section section, int nodes, int parents, const double *shape,
                       const vec *table, const vec *P, vec weight, vec (*force)[3])
{
    const int dim = section == SPACE ? 3 : 2;
    vec T[9], hoop = weight * table[section == RING ? dim * parents + 1 : 0] * P[4];
    for (int i = 0; i < dim; ++i)
        for (int z = 0; z < parents; ++z) {
            vec sum = P[dim * i] * table[dim * z];
            for (int J = 1; J < dim; ++J)
                sum += P[dim * i + J] * table[dim * z + J];
            T[parents * i + z] = sum * weight;
        }
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a, shape += 1 + parents) {
        for (int p = 0; p < dim * parents; ++p)
            force[a][p / parents] += shape[1 + p % parents] * T[p];
        if (section == RING)
            force[a][0] += shape[0] * hoop;
    }
}

/* The place of the block (a, b) in the matrix, of a <= b in a symmetric one. */
INLINE int place_of(int nodes, int symmetric, int a, int b)
{
    return symmetric ? b * (b + 1) / 2 + a : b * nodes + a;
}

/* The blocks of the first node, whose functions all others add up to one with: moved as a whole, a cell
 * answers with no force. */
INLINE void add_first_node(int dim, int nodes, int symmetric, vec *matrix)
{
    const int size = dim * dim;
#pragma GCC unroll 1
    for (int b = symmetric ? 1 : 2 - nodes; b < nodes; ++b) { /* below 1 the columns of the first node */
        const int row = b > 0, fixed = row ? b : b + nodes - 1;
        vec sum[9] = {}, *to = matrix + size * (row ? place_of(nodes, symmetric, 0, b) : fixed);
#pragma GCC unroll 1
        for (int a = 1; a < nodes; ++a) {
            const int turned = symmetric && a > b;
            const int at = row ? place_of(nodes, symmetric, turned ? b : a, turned ? a : b) : a * nodes + fixed;
            for (int k = 0; k < size; ++k)
                sum[k] -= matrix[size * at + (turned ? dim * (k % dim) + k / dim : k)];
        }
        for (int k = 0; k < size; ++k) {
            to[k] = sum[k];
            matrix[k] -= row ? sum[k] : all(0.0);
        }
    }
}

/* The gradients' shares of a point, carried over to its present place. */
INLINE void carry(enum section section, int parents, const vec *F, vec *table)
{
    const int dim = section == SPACE ? 3 : 2;
    vec inverse[9], row[3];
    inverse_of(section == SPACE, F, inverse);
    for (int z = 0; z < parents; ++z) {
        for (int j = 0; j < dim; ++j) {
            row[j] = table[dim * z] * inverse[j];
            for (int J = 1; J < dim; ++J)
                row[j] += table[dim * z + J] * inverse[dim * J + j];
        }
        for (int j = 0; j < dim; ++j)
            table[dim * z + j] = row[j];
    }
    if (section == RING)
        table[dim * parents + 1] /= F[4];
}

/* Adds what a point does to the blocks (a, b) of the matrix, one after the other, only those with a <= b
 * of a symmetric one; but in rings without those of the first node. */
INLINE void add_matrix(enum section section, int nodes, int symmetric, vec (*B)[3], const vec *moduli,
                       vec weight, vec *matrix)
{
    const int space = section == SPACE, dim = space ? 3 : 2, n = space ? 6 : 4, first = section != RING;
    const vec *c = moduli + n;
#pragma GCC unroll 1
    for (int b = first; b < nodes; ++b) {
        vec M[6][3], W[9][3], hoop = all(0.0), at[3];
        for (int i = 0; i < dim + (section == RING); ++i)
            at[i] = weight * B[b][i];
        for (int p = 0; p < n; ++p)
            for (int k = 0; k < dim && counts(section, p); ++k) {
                M[p][k] = all(0.0);
                for (int l = 0; l < dim + (section == RING && k == 0); ++l) {
                    const int q = l < dim ? NUMBER[k][l] : 2;
                    vec value = symmetric && q < p ? c[n * q + p] : c[n * p + q];
                    M[p][k] = l ? M[p][k] + value * at[l] : value * at[l];
                }
            }
        for (int j = 0; j < dim; ++j) {
            vec along = moduli[NUMBER[j][0]] * at[0];
            for (int l = 1; l < dim; ++l)
                along += moduli[NUMBER[j][l]] * at[l];
            for (int i = 0; i < dim; ++i)
                for (int k = 0; k < dim; ++k)
                    W[dim * i + j][k] = i == k ? M[NUMBER[i][j]][k] + along : M[NUMBER[i][j]][k];
        }
        if (section == RING)
            hoop = M[2][0] + moduli[2] * at[2];
        const int end = symmetric ? b + 1 : nodes;
        vec *block = matrix + dim * dim * place_of(nodes, symmetric, first, b);
#pragma GCC unroll 1
        for (int a = first; a < end; ++a, block += dim * dim)
            for (int i = 0; i < dim; ++i)
                for (int k = 0; k < dim; ++k) {
                    vec sum = block[dim * i + k];
                    for (int j = 0; j < dim; ++j)
                        sum += W[dim * i + j][k] * B[a][j];
                    if (section == RING && i == 0)
                        sum += (k ? M[2][k] : hoop) * B[a][2];
                    block[dim * i + k] = sum;
                }
    }
}

/* Adds what a pressure more, dW/dJ, is in the moduli. */
INLINE void add_pressure(enum section section, const vec *F, vec excess, vec *moduli)
{
    const int space = section == SPACE, n = space ? 6 : 4;
    vec normal[3], *c = tangent_of(space, moduli), J;
    if (space) {
        cross(F + 3, F + 6, normal);
        J = dot(F, normal);
    } else {
        J = (F[0] * F[3] - F[1] * F[2]) * F[4];
    }
    J *= excess;
    for (int p = 0; p < n; ++p) {
        c[(n + 1) * p] -= J;
        for (int q = 0; p < 3 && q < 3; ++q)
            c[n * p + q] += p == q ? all(0.0) : J;
        if (p < 3)
            moduli[p] += J;
    }
}

/* Fetches a part of what the next block needs, as much as one of its points does: memory does not
 * follow the way from the rows of one block to those of the next. */
INLINE void fetch_next(const Work *w, const double *end, int64_t n, int64_t q)
{
    if (n + 1 >= w->blocks)
        return;
    /* the rows of cells that follow each other are one piece, LANES rows for each point */
    const int64_t piece = 8 * LANES * w->width;
    const int64_t first = 8 * w->cell[(n + 1) * LANES] * w->points * w->width + q * piece;
    for (int64_t k = 0; k < piece; k += 64)
        __builtin_prefetch((const char *)w->state + first + k);
    for (int64_t k = 0; end && k < piece; k += 64)
        __builtin_prefetch((const char *)end + first + k, 1);
}

/* Stress or moduli, or both, at a point q of a block's cells, of those whose number is that of their
 * first point; returns which are good. */
INLINE ivec at_point(enum section section, const Work *w, int64_t n, int q, int lanes, int symmetric,
                     const int64_t *first, const vec *F, vec *P, vec *A, vec *energy)
{
    const int count = section == SPACE ? 9 : 5, n_moduli = section == SPACE ? 42 : 20, width = (int)w->width;
    vec state[width + 1], next[width + 1], excess = {};
    double *row[LANES];
    int64_t number[LANES];
    ivec good = ~(ivec){};
    for (int l = 0; l < LANES; ++l)
        number[l] = first[l] * w->points + q;
    if (!w->update) {
        find_rows(A ? w->A : w->P, A ? n_moduli : count, number, row);
        load(row, 0, A ? n_moduli : count, A ? A : P);
        return good;
    }
    if (width) {
        fetch_next(w, w->end, n, q);
        find_rows(w->state, width, number, row);
        load(row, 0, A ? (int)w->read : width, state);
        find_rows(w->end, width, number, row);
    }
    if (w->end && !energy)
        load(row, 0, width, next);
    w->update(w->material, F, state, P, w->end ? next : 0, A, energy, &good);
    if (w->end && energy)
        store(next, lanes, width, row, 0);
    if (A && w->excess) {
        for (int l = 0; l < LANES; ++l)
            excess[l] = w->excess[first[l]];
        add_pressure(section, F, excess, A);
    }
    if (A && w->symmetric && !symmetric)
        fill(section == SPACE ? 6 : 4, tangent_of(section == SPACE, A));
    return good;
}

/* One block of cells: adds to their matrices, blocks (a, b) one after the other, and to the forces of
 * their nodes, each unless it is null; returns which points could not be evaluated. */
INLINE ivec at_block(enum section section, int nodes, int parents, const Work *w, int64_t n,
                     int lanes, int symmetric, vec *matrix, vec (*force)[3], vec *sums)
{
    const int dim = section == SPACE ? 3 : 2, count = section == SPACE ? 9 : 5;
    const int components = section == SPACE ? 6 : 4, points = (int)w->points, size = dim * parents + 2;
    const int32_t *node = w->node + n * nodes * LANES;
    const double *table = w->table + n * points * size * LANES;
    vec B[nodes][3], at[nodes][3], radial;
    double *row[LANES];
    int64_t number[LANES], first[LANES];
    ivec bad = {};
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a) {
        for (int l = 0; l < LANES; ++l)
            number[l] = node[a * LANES + l];
        find_rows(w->u, dim, number, row);
        for (int i = 0; i < dim; ++i)
            at[a][i] = column(row, i);
    }
    radial = at[0][0];
#pragma GCC unroll 1
    for (int a = nodes - 1; a >= 0; --a) /* how far the cell has moved rounds nothing */
        for (int i = 0; i < dim; ++i)
            at[a][i] -= at[0][i];
    for (int l = 0; l < LANES; ++l)
        first[l] = w->cell[n * LANES + l];
    for (int q = 0; q < points; ++q, table += size * LANES) {
        vec tabled[11], F[9], P[9], A[MODULI], energy[ENERGIES], weight;
        __builtin_memcpy(tabled, table, size * sizeof(vec));
        weight = tabled[dim * parents];
        const double *shape = w->shape + q * nodes * (1 + parents);
        deformation(section, nodes, parents, shape, tabled, at, radial, F);
        if (w->F) {
            for (int l = 0; l < LANES; ++l)
                number[l] = first[l] * points + q;
            find_rows(w->F, count, number, row);
            store(F, lanes, count, row, 0);
            continue;
        }
        for (const Work *v = w; v; v = v->same) {
            vec more[MODULI], *moduli = matrix ? v == w ? A : more : 0;
            ivec good = at_point(section, v, n, q, lanes, symmetric, first, F, P, moduli, w->energies ? energy : 0);
            bad |= ~good;
            if (v->width) /* what remembers nothing says itself what is no number */
                weight = (vec)((ivec)weight | ~good); /* all bits set: not a number */
#pragma GCC unroll 6
            for (int p = 0; moduli == more && p < components; ++p) {
                A[p] += more[p];
#pragma GCC unroll 6
                for (int r = symmetric ? p : 0; r < components; ++r)
                    if (counts(section, p) && counts(section, r))
                        A[components * (1 + p) + r] += more[components * (1 + p) + r];
            }
        }
        for (int k = 0; w->energies && k < ENERGIES; ++k)
            sums[k] += weight * energy[k];
        if (force)
            add_forces(section, nodes, parents, shape, tabled, P, weight, force);
        if (matrix) {
            carry(section, parents, F, tabled);
            gradients(section, nodes, parents, shape, tabled, B);
        }
        if (matrix && symmetric)
            add_matrix(section, nodes, 1, B, A, weight, matrix);
        else if (matrix)
            add_matrix(section, nodes, 0, B, A, weight, matrix);
    }
    return bad;
}

INLINE int all_symmetric(const Work *w)
{
    int64_t found = 1;
    for (; w; w = w->next)
        for (const Work *v = w; v; v = v->same)
            found &= v->symmetric;
    return (int)found;
}

/* All cells of one body; returns whether a point could not be evaluated. */
INLINE int64_t over_cells(enum section section, int nodes, const Work *w)
{
    const int dim = section == SPACE ? 3 : 2, symmetric = all_symmetric(w);
    const int blocks = symmetric ? nodes * (nodes + 1) / 2 : nodes * nodes;
    const int32_t *start = w->start;
    vec matrix[w->values ? dim * dim * blocks : 1], force[nodes][3];
    ivec bad = {};
    for (int64_t n = 0; n < w->blocks; ++n) {
        const int lanes = n + 1 < w->blocks ? LANES : (int)w->lanes_of_last;
        const int32_t *node = w->node + n * nodes * LANES;
        const uint8_t *take = w->take ? w->take + n * LANES : 0;
        if (w->forces)
            __builtin_memset(force, 0, sizeof force);
        if (w->values)
            __builtin_memset(matrix, 0, sizeof matrix);
        for (const Work *v = w; v; v = v->next) {
            vec sums[ENERGIES] = {}, *K = w->values ? matrix : 0, (*f)[3] = w->forces ? force : 0;
            if (section == RING && v->parents == 3)
                bad |= at_block(section, nodes, 3, v, n, lanes, symmetric, K, f, sums);
            else
                bad |= at_block(section, nodes, dim, v, n, lanes, symmetric, K, f, sums);
            for (int k = 0; v->energies && k < ENERGIES; ++k)
                for (int l = 0; l < lanes; ++l)
                    v->energies[k] += sums[k][l];
        }
        for (int a = 0; w->forces && a < nodes; ++a)
            for (int l = 0; l < lanes; ++l)
                for (int i = 0; i < dim; ++i)
                    w->forces[dim * (int64_t)node[a * LANES + l] + i] +=
                        ((const double *)&force[a][i])[l];
        if (w->values && section != RING && symmetric)
            add_first_node(dim, nodes, 1, matrix);
        else if (w->values && section != RING)
            add_first_node(dim, nodes, 0, matrix);
        if (w->values && symmetric)
            start = insert(dim, nodes, 1, lanes, start, take, matrix, w->values);
        else if (w->values)
            start = insert(dim, nodes, 0, lanes, start, take, matrix, w->values);
    }
    return any(bad);
}

#define LOOP(name, section)                                                                        \
    EXPORT int64_t tribox_point_cells_##name(const Work *w)                                        \
    {                                                                                              \
        const int corners = section == SPACE ? 8 : 4; /* with a loop of their own */               \
        return w->nodes == corners ? over_cells(section, corners, w)                               \
                                   : over_cells(section, (int)w->nodes, w);                        \
    }
LOOP(strain, STRAIN)
LOOP(ring, RING)
LOOP(space, SPACE)
