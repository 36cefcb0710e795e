/* Where the values of element matrices lie in a sparse matrix with sorted rows.
 *
 * `unknown` (cells, corners, dim) are the rows of a cell's nodes, and its columns. `start` (cells, a,
 * i, b) gets the place of column (b, 0) in row (a, i), `found` (cells) whether all rows of a cell
 * have all its columns, those of a node one after the other. `before` are the rows' ends in the
 * pattern that `start` has the places of, or NULL: in rows as long as there these have only moved. */

#include <stdint.h>

/* The first of the places from `low` to before `high` whose number is not below `wanted`, or `high`. */
static inline int32_t first_place(const int32_t *numbers, int32_t low, int32_t high, int32_t wanted)
{
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (numbers[middle] < wanted)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void tribox_cell_places(int64_t cells, int corners, int dim, const int32_t *indptr,
                        const int32_t *columns, const int32_t *before, const int32_t *unknown,
                        int32_t *start, uint8_t *found)
{
    for (int64_t c = 0; c < cells; ++c, unknown += corners * dim) {
        int all = 1;
        for (int row = 0; row < corners * dim; ++row) {
            const int32_t first = indptr[unknown[row]], end = indptr[unknown[row] + 1];
            for (int b = 0; b < corners; ++b) {
                const int32_t wanted = unknown[b * dim];
                int32_t low;
                /* The rows of a node mostly have the same columns. */
                const int32_t above = row % dim ? first + start[-corners] - indptr[unknown[row - 1]] : end;
                const int32_t moved = before ? first + *start - before[unknown[row]] : end;
                if (above < end && columns[above] == wanted)
                    low = above;
                else if (moved >= first && moved < end && columns[moved] == wanted)
                    low = moved;
                else
                    low = first_place(columns, first, end, wanted);
                *start++ = low;
                for (int j = 0; j < dim; ++j)
                    all &= low + j < end && columns[low + j] == wanted + j;
            }
        }
        found[c] = all;
    }
}

/* Where the values of a part of a matrix lie in it: `places` gets one for each entry of the part.
 *
 * `row` (rows) are those that the part has, `number` of each column of the matrix that in the part, or
 * negative. `numbers` are those of the part's columns; NULL: they are these. Both have columns in the
 * same order. Returns whether the part has just these entries. */
int tribox_part_places(int64_t rows, const int32_t *row, const int32_t *indptr, const int32_t *columns,
                       const int32_t *number, const int32_t *ends, const int32_t *inside,
                       const int32_t *numbers, int32_t *places)
{
    for (int64_t r = 0; r < rows; ++r) {
        int32_t at = ends[r];
        for (int32_t k = indptr[row[r]]; k < indptr[row[r] + 1]; ++k) {
            const int32_t wanted = number[columns[k]];
            if (wanted < 0)
                continue;
            if (at == ends[r + 1] || (numbers ? numbers[inside[at]] : inside[at]) != wanted)
                return 0;
            places[at++] = k;
        }
        if (at != ends[r + 1])
            return 0;
    }
    return 1;
}

/* Where the values of entries lie in two parts of a matrix, in their `row`, mostly one after the other:
 * a negative `column` is ~ that in the second part, and so is its place. Returns whether all are there. */
int tribox_entry_places(int64_t entries, const int32_t *indptr, const int32_t *columns,
                        const int32_t *other_indptr, const int32_t *other_columns, const int32_t *row,
                        const int32_t *column, int32_t *places)
{
    int all = 1;
    for (int64_t e = 0; e < entries; ++e) {
        const int beyond = column[e] < 0;
        const int32_t *ends = beyond ? other_indptr : indptr, *in = beyond ? other_columns : columns;
        const int32_t wanted = beyond ? ~column[e] : column[e], end = ends[row[e] + 1];
        int32_t low = end;
        if (e && row[e - 1] == row[e] && (column[e - 1] < 0) == beyond) {
            const int32_t next = (beyond ? ~places[e - 1] : places[e - 1]) + 1;
            if (next < end && in[next] == wanted)
                low = next;
        }
        if (low == end)
            low = first_place(in, ends[row[e]], end, wanted);
        all &= low < end && in[low] == wanted;
        places[e] = beyond ? ~low : low;
    }
    return all;
}

/* Add values (entries) at these places, which may come twice, to those of the two parts. */
void tribox_add_entries(int64_t entries, const int32_t *places, const double *values, double *own,
                        double *other)
{
    for (int64_t e = 0; e < entries; ++e)
        *(places[e] < 0 ? other + ~places[e] : own + places[e]) += values[e];
}

/* Take the values (entries) that lie at these places. */
void tribox_take_entries(int64_t entries, const int32_t *places, const double *values, double *out)
{
    for (int64_t e = 0; e < entries; ++e)
        out[e] = values[places[e]];
}
