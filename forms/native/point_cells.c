/* Loops over material points that remember, eight at a time: points by themselves, and those of
 * cells of any kind with the forces and the tangent of the cells.
 *
 * What the points do is a kernel, see Update of point_lanes.h: a cell's deformation gradients, its
 * points' stress and moduli, and its matrix never leave the processor's caches. With the gradients
 * B_a of the nodes' shape functions, in rings those over the radius h_a, and the weight w
 *
 *     F = 1 + sum of u_a (x) B_a,   F_33 = 1 + sum of h_a u_a,x,
 *     f_a = sum over points of w (P B_a + P_33 h_a e_x),
 *     K_ab = sum over points of w (B_a.A.B_b), the row and the column of 33 with h likewise.
 */

#include "point_lanes.h"

/* Rows for columns. */
INLINE void transpose(vec *a)
{
    vec b[LANES], c[LANES];
    for (int i = 0; i < LANES; i += 2) {
        b[i] = __builtin_shuffle(a[i], a[i + 1], (ivec){0, 8, 2, 10, 4, 12, 6, 14});
        b[i + 1] = __builtin_shuffle(a[i], a[i + 1], (ivec){1, 9, 3, 11, 5, 13, 7, 15});
    }
    for (int i = 0; i < LANES; i += 4)
        for (int j = i; j < i + 2; ++j) {
            c[j] = __builtin_shuffle(b[j], b[j + 2], (ivec){0, 1, 8, 9, 4, 5, 12, 13});
            c[j + 2] = __builtin_shuffle(b[j], b[j + 2], (ivec){2, 3, 10, 11, 6, 7, 14, 15});
        }
    for (int i = 0; i < LANES / 2; ++i) {
        a[i] = __builtin_shuffle(c[i], c[i + 4], (ivec){0, 1, 2, 3, 8, 9, 10, 11});
        a[i + 4] = __builtin_shuffle(c[i], c[i + 4], (ivec){4, 5, 6, 7, 12, 13, 14, 15});
    }
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

/* `count` columns of the lanes' rows from the column `from` on: eight at a time, the last eight of
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

/* Updates n points; returns whether any was not valid, where all but the state is no number.
 * `count` components of F and P, `width` values of a state; P (n, p), state at the end (n, s),
 * A (n, p, p) or null, energies (ENERGIES, n). */
EXPORT int64_t tribox_points(Update *update, const void *material, int64_t count, int64_t width,
                             int64_t n, const double *F, const double *state, double *P,
                             double *end, double *A, double *energies)
{
    vec s[width], next[width];
    ivec bad = {};
    for (int64_t first = 0; first < n; first += LANES) {
        const int lanes = n - first < LANES ? (int)(n - first) : LANES, values = (int)count;
        vec f[9], stress[9], moduli[81], energy[ENERGIES];
        int64_t number[LANES];
        double *row[LANES];
        ivec good;
        for (int l = 0; l < LANES; ++l)
            number[l] = first + (l < lanes ? l : lanes - 1);
        find_rows(F, count, number, row);
        load(row, 0, values, f);
        find_rows(state, width, number, row);
        load(row, 0, (int)width, s);
        update(material, f, s, stress, next, A ? moduli : 0, energy, &good);
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
            spoil(values * values, good, moduli);
            find_rows(A, count * count, number, row);
            store(moduli, lanes, values * values, row, 0);
        }
        bad |= ~good;
    }
    return any(bad);
}

/* What a call works on. `shape` (points, nodes, 1 + dim): the nodes' functions and their derivatives
 * by parent coordinates; `table` (blocks, points, dim dim + 2, LANES): the parent coordinates'
 * derivatives by place, the weight, and in rings 1/x; `node` (blocks, nodes, LANES), `cell` (blocks,
 * LANES) the number of a cell in the body, whose points are `points` cell and those that follow; the
 * last block repeats its last cell where there are fewer than LANES, and counts `lanes_of_last`.
 *
 * With `update` the points are evaluated from `state` (k, width), and `end` (k, width) is written if
 * there are `energies` (ENERGIES) to add to, and read if not, see Update. Without it P (k, p) and
 * A (k, p, p) are read where forces and values are wanted. What of these is not null is added to,
 * with `start` (cells, a, i, b) as in compiled_cells.py; F (k, p) is written. `symmetric`: whether A
 * is. `add`, where there is one, needs `begin` values of a state. */
typedef struct {
    int64_t blocks, lanes_of_last, points, nodes, width, symmetric, begin;
    const double *shape, *table;
    const int32_t *node, *cell;
    const double *u;
    Update *update;
    AddModuli *add;
    const void *material;
    const double *state;
    const double *P, *A;
    double *F, *end, *energies, *forces, *values;
    const int32_t *start;
} Work;

/* A point of a block's cells: gradients of the nodes' functions, with those over the radius last. */
INLINE void gradients(enum section section, int nodes, const double *shape, const vec *table,
                      vec (*B)[3])
{
    const int dim = section == SPACE ? 3 : 2;
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a, shape += 1 + dim) {
        for (int i = 0; i < dim; ++i) {
            B[a][i] = shape[1] * table[i];
            for (int z = 1; z < dim; ++z)
                B[a][i] += shape[1 + z] * table[dim * z + i];
        }
        if (section == RING)
            B[a][2] = shape[0] * table[dim * dim + 1];
    }
}

/* F from the derivatives of the displacement by parent coordinates. */
INLINE void deformation(enum section section, int nodes, const double *shape, const vec *table,
                        vec (*u)[3], vec *F)
{
    const int dim = section == SPACE ? 3 : 2;
    vec d[9], hoop = all(0.0);
    for (int p = 0; p < dim * dim; ++p)
        d[p] = all(0.0);
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a, shape += 1 + dim) {
        for (int p = 0; p < dim * dim; ++p)
            d[p] += shape[1 + p % dim] * u[a][p / dim];
        if (section == RING)
            hoop += shape[0] * u[a][0];
    }
    for (int i = 0; i < dim; ++i)
        for (int J = 0; J < dim; ++J) {
            vec sum = d[dim * i] * table[J];
            for (int z = 1; z < dim; ++z)
                sum += d[dim * i + z] * table[dim * z + J];
            F[dim * i + J] = i == J ? 1.0 + sum : sum;
        }
    if (section != SPACE)
        F[4] = section == RING ? 1.0 + hoop * table[5] : all(1.0);
}

/* The nodes' forces of the stress at a point, carried over to parent coordinates first. */
INLINE void add_forces(enum section section, int nodes, const double *shape, const vec *table,
                       const vec *P, vec weight, vec (*force)[3])
{
    const int dim = section == SPACE ? 3 : 2;
    vec T[9], hoop = weight * table[5] * P[4];
    for (int i = 0; i < dim; ++i)
        for (int z = 0; z < dim; ++z) {
            T[dim * i + z] = P[dim * i] * table[dim * z];
            for (int J = 1; J < dim; ++J)
                T[dim * i + z] += P[dim * i + J] * table[dim * z + J];
            T[dim * i + z] *= weight;
        }
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a, shape += 1 + dim) {
        for (int p = 0; p < dim * dim; ++p)
            force[a][p / dim] += shape[1 + p % dim] * T[p];
        if (section == RING)
            force[a][0] += shape[0] * hoop;
    }
}

/* Adds B_a.A.B_b to the blocks (a, b) of the matrix, one after the other, only those with a <= b of
 * a symmetric one. */
INLINE void add_matrix(enum section section, int nodes, int symmetric, vec (*B)[3], const vec *A,
                       vec weight, vec *block)
{
    const int dim = section == SPACE ? 3 : 2, count = section == SPACE ? 9 : 5;
    const int rows = section == STRAIN ? 4 : count;
#pragma GCC unroll 1
    for (int b = 0; b < nodes; ++b) {
        vec M[9][3], at[3];
        for (int i = 0; i < dim + (section == RING); ++i)
            at[i] = weight * B[b][i];
        for (int p = 0; p < rows; ++p)
            for (int k = 0; k < dim; ++k) {
                M[p][k] = A[count * p + dim * k] * at[0];
                for (int L = 1; L < dim; ++L)
                    M[p][k] += A[count * p + dim * k + L] * at[L];
                if (section == RING && k == 0)
                    M[p][k] += A[count * p + 4] * at[2];
            }
        const int end = symmetric ? b + 1 : nodes;
#pragma GCC unroll 1
        for (int a = 0; a < end; ++a, block += dim * dim)
            for (int i = 0; i < dim; ++i)
                for (int k = 0; k < dim; ++k) {
                    vec sum = M[dim * i][k] * B[a][0];
                    for (int J = 1; J < dim; ++J)
                        sum += M[dim * i + J][k] * B[a][J];
                    if (section == RING && i == 0)
                        sum += M[4][k] * B[a][2];
                    block[dim * i + k] += sum;
                }
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

/* One block of cells: adds to their matrices, blocks (a, b) one after the other, and to the forces of
 * their nodes, each unless it is null; returns which points could not be evaluated. */
INLINE ivec at_block(enum section section, const Work *w, int64_t n, int lanes, vec *matrix,
                     vec (*force)[3], vec *sums)
{
    const int dim = section == SPACE ? 3 : 2, count = section == SPACE ? 9 : 5;
    const int nodes = (int)w->nodes, points = (int)w->points, size = dim * dim + 2;
    const int32_t *node = w->node + n * nodes * LANES;
    const double *table = w->table + n * points * size * LANES;
    const int width = (int)w->width, fresh = w->energies != 0, known = w->end && !fresh;
    vec B[nodes][3], at[nodes][3], s[width + 1], next[width + 1];
    double *of_u[LANES], *of_state[LANES], *of_end[LANES], *of_F[LANES], *of_P[LANES], *of_A[LANES];
    int64_t number[LANES];
    ivec bad = {};
#pragma GCC unroll 1
    for (int a = 0; a < nodes; ++a) {
        for (int l = 0; l < LANES; ++l)
            number[l] = node[a * LANES + l];
        find_rows(w->u, dim, number, of_u);
        for (int i = 0; i < dim; ++i)
            at[a][i] = column(of_u, i);
    }
    for (int l = 0; l < LANES; ++l)
        number[l] = w->cell[n * LANES + l] * (int64_t)points;
    find_rows(w->state, width, number, of_state);
    find_rows(w->end, width, number, of_end);
    find_rows(w->F, count, number, of_F);
    find_rows(w->P, count, number, of_P);
    find_rows(w->A, count * count, number, of_A);
    for (int q = 0; q < points; ++q, table += size * LANES) {
        vec tabled[11], F[9], P[9], A[81], energy[ENERGIES], weight;
        ivec good = ~(ivec){};
        __builtin_memcpy(tabled, table, size * sizeof(vec));
        weight = tabled[dim * dim];
        const double *shape = w->shape + q * nodes * (1 + dim);
        deformation(section, nodes, shape, tabled, at, F);
        if (w->update) {
            fetch_next(w, w->end, n, q);
            load(of_state, q * width, width, s);
            if (known)
                load(of_end, q * width, width, next);
            w->update(w->material, F, s, P, w->end ? next : 0, matrix ? A : 0, fresh ? energy : 0,
                      &good);
            bad |= ~good;
            weight = (vec)((ivec)weight | ~good); /* all bits set: not a number */
            if (fresh)
                store(next, lanes, width, of_end, q * width);
            for (int k = 0; fresh && k < ENERGIES; ++k)
                sums[k] += weight * energy[k];
        } else if (force) {
            load(of_P, q * count, count, P);
        } else if (matrix) {
            load(of_A, q * count * count, count * count, A);
        }
        if (w->F)
            store(F, lanes, count, of_F, q * count);
        if (force)
            add_forces(section, nodes, shape, tabled, P, weight, force);
        if (matrix)
            gradients(section, nodes, shape, tabled, B);
        if (matrix && w->symmetric)
            add_matrix(section, nodes, 1, B, A, weight, matrix);
        else if (matrix)
            add_matrix(section, nodes, 0, B, A, weight, matrix);
    }
    return bad;
}

/* See `moduli` of Beside. */
EXPORT void tribox_point_moduli(const void *cells, int64_t block, int64_t point, const Place *at, vec *out)
{
    const Work *w = cells;
    vec s[w->begin + 1];
    double *row[LANES];
    int64_t number[LANES];
    fetch_next(w, 0, block, point);
    for (int l = 0; l < LANES; ++l)
        number[l] = w->cell[block * LANES + l] * w->points + point;
    find_rows(w->state, w->width, number, row);
    load(row, 0, (int)w->begin, s);
    w->add(w->material, at, s, out);
}

/* All cells of one body; returns whether a point could not be evaluated. */
INLINE int64_t over_cells(enum section section, const Work *w)
{
    const int dim = section == SPACE ? 3 : 2, nodes = (int)w->nodes;
    const int blocks = w->symmetric ? nodes * (nodes + 1) / 2 : nodes * nodes;
    const int32_t *start = w->start;
    vec matrix[w->values ? dim * dim * blocks : 1], force[nodes][3];
    ivec bad = {};
    for (int64_t n = 0; n < w->blocks; ++n) {
        const int lanes = n + 1 < w->blocks ? LANES : (int)w->lanes_of_last;
        const int32_t *node = w->node + n * nodes * LANES;
        if (w->forces)
            __builtin_memset(force, 0, sizeof force);
        if (w->values)
            __builtin_memset(matrix, 0, sizeof matrix);
        vec sums[ENERGIES] = {};
        bad |= at_block(section, w, n, lanes, w->values ? matrix : 0, w->forces ? force : 0, sums);
        for (int k = 0; w->energies && k < ENERGIES; ++k)
            for (int l = 0; l < lanes; ++l)
                w->energies[k] += sums[k][l];
        for (int a = 0; w->forces && a < nodes; ++a)
            for (int l = 0; l < lanes; ++l)
                for (int i = 0; i < dim; ++i)
                    w->forces[dim * (int64_t)node[a * LANES + l] + i] +=
                        ((const double *)&force[a][i])[l];
        if (w->values && w->symmetric)
            start = insert(dim, nodes, 1, lanes, start, matrix, w->values);
        else if (w->values)
            start = insert(dim, nodes, 0, lanes, start, matrix, w->values);
    }
    return any(bad);
}

/* The loop, and what adds of it to another one: see Beside of lanes.h. */
#define LOOPS(name, section)                                                                       \
    EXPORT int64_t tribox_point_cells_##name(const Work *w)                                        \
    {                                                                                              \
        return over_cells(section, w);                                                             \
    }                                                                                              \
    EXPORT void tribox_point_block_##name(const void *cells, int64_t block, vec *matrix)           \
    {                                                                                              \
        at_block(section, cells, block, 0, matrix, 0, 0);                                          \
    }
LOOPS(strain, STRAIN)
LOOPS(ring, RING)
LOOPS(space, SPACE)
