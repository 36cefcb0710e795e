/* Adding to a sparse matrix in place: DIM unknowns at each node, one after the other; what nodes
 * have that are not in it is listed beside.
 *
 * The source that includes this says how many dimensions there are, DIM.
 */

#include "lanes.h"

/* A sparse matrix of unknowns, rows in ascending order of columns; first unknown of each of the
 * pair's nodes in it, -1 where a node is not in it as a whole. */
typedef struct {
    const int32_t *indptr, *indices;
    double *values;
    const int32_t *row_first, *column_first;
    /* What does not go into the matrix: how many blocks of two nodes, and room for how many; nodes of
     * row and column, numbers (i, j). */
    int64_t count, room, *row, *column;
    double *block;
} Entries;

/* Place of a column in a row from the place `low` on, -1 where there is none: in steps that double,
 * for columns asked for one after the other are not far apart. */
INLINE int32_t place_from(const Entries *e, int32_t low, int32_t end, int32_t column)
{
    int32_t size = 1;
    while (low + size < end && e->indices[low + size] <= column)
        low += size, size *= 2;
    if (size > end - low)
        size = end - low;
    while (size > 1) {
        int32_t half = size / 2;
        low += e->indices[low + half] <= column ? half : 0;
        size -= half;
    }
    return size == 1 && e->indices[low] == column ? low : -1;
}

/* Add the numbers (i, j) of a row node and a column node, whose place in the first row is known;
 * `step` from row to row. Returns 0 where the matrix has no room for them. */
INLINE int add_at(const Entries *e, int32_t row, int32_t column, int32_t first, const double *x,
                  int64_t step)
{
    for (int i = 0; i < DIM; ++i) {
        int32_t place = first, end = e->indptr[row + i + 1];
        if (i) { /* most rows of a node have the same columns */
            place = e->indptr[row + i] + first - e->indptr[row];
            if (place + DIM > end || e->indices[place] != column)
                place = place_from(e, e->indptr[row + i], end, column);
        }
        if (place < 0 || place + DIM > end || e->indices[place + DIM - 1] != column + DIM - 1)
            return 0;
        for (int j = 0; j < DIM; ++j)
            e->values[place + j] += x[i * step + j];
    }
    return 1;
}

/* The same, looked for from the place `from` on. Returns the place, -1 where there is no room. */
INLINE int32_t add_numbers(const Entries *e, int32_t row, int32_t column, int32_t from,
                           const double *x, int64_t step)
{
    const int32_t first = place_from(e, from, e->indptr[row + 1], column);
    return first >= 0 && add_at(e, row, column, first, x, step) ? first : -1;
}

/* Where the row of a node begins. */
INLINE int32_t start_of_row(const Entries *e, int64_t node)
{
    return e->row_first[node] < 0 ? 0 : e->indptr[e->row_first[node]];
}

/* List the numbers (i, j) of two nodes of the pair; returns 1 where there is no memory for them. */
static int put_beside(Entries *e, int64_t row, int64_t column, const double *x, int64_t step)
{
    if (e->count == e->room) {
        const int64_t room = 2 * e->room + 1024;
        int64_t *rows = realloc(e->row, sizeof(int64_t) * room);
        e->row = rows ? rows : e->row;
        int64_t *columns = realloc(e->column, sizeof(int64_t) * room);
        e->column = columns ? columns : e->column;
        double *blocks = realloc(e->block, sizeof(double) * DIM * DIM * room);
        e->block = blocks ? blocks : e->block;
        if (!rows || !columns || !blocks)
            return 1;
        e->room = room;
    }
    e->row[e->count] = row, e->column[e->count] = column;
    double *block = e->block + DIM * DIM * e->count++;
    for (int i = 0; i < DIM; ++i)
        for (int j = 0; j < DIM; ++j)
            block[DIM * i + j] = x[i * step + j];
    return 0;
}

/* Let go of what was listed. */
void tribox_forget_beside(Entries *e)
{
    free(e->row);
    free(e->column);
    free(e->block);
    e->row = e->column = NULL, e->block = NULL, e->count = e->room = 0;
}

/* Add the numbers (i, j) of two nodes of the pair, looked for from the place `from` on, or list them.
 * Returns the place, -1 where there is no room. */
INLINE int32_t put(Entries *e, int64_t row, int64_t column, int32_t from, const double *x,
                   int64_t step)
{
    if (e->row_first[row] >= 0 && e->column_first[column] >= 0)
        return add_numbers(e, e->row_first[row], e->column_first[column], from, x, step);
    return put_beside(e, row, column, x, step) ? -1 : from;
}

/* Numbers low, low + 1, ... below high, by the columns of their nodes. */
INLINE void sort_columns(const Entries *e, const int64_t *nodes, int64_t low, int64_t high,
                         int64_t *sorted)
{
    for (int64_t n = low; n < high; ++n) {
        int64_t at = n - low;
        const int32_t column = e->column_first[nodes[n]];
        for (; at > 0 && e->column_first[nodes[sorted[at - 1]]] > column; --at)
            sorted[at] = sorted[at - 1];
        sorted[at] = n;
    }
}
