/* Where the values of element matrices lie in a sparse matrix with sorted rows.
 *
 * `unknown` (cells, corners, dim) are the rows of a cell's nodes, and its columns. `start` (cells, a,
 * i, b) gets the place of column (b, 0) in row (a, i), `found` (cells) whether all rows of a cell
 * have all its columns, those of a node one after the other. */

#include <stdint.h>

void tribox_cell_places(int64_t cells, int corners, int dim, const int32_t *indptr,
                        const int32_t *columns, const int32_t *unknown, int32_t *start,
                        uint8_t *found)
{
    for (int64_t c = 0; c < cells; ++c, unknown += corners * dim) {
        int all = 1;
        for (int row = 0; row < corners * dim; ++row) {
            const int32_t first = indptr[unknown[row]], end = indptr[unknown[row] + 1];
            for (int b = 0; b < corners; ++b) {
                const int32_t wanted = unknown[b * dim];
                int32_t low = first, high = end;
                /* The rows of a node mostly have the same columns. */
                const int32_t above = row % dim ? first + start[-corners] - indptr[unknown[row - 1]] : end;
                if (above < end && columns[above] == wanted)
                    low = high = above;
                while (low < high) {
                    int32_t middle = low + (high - low) / 2;
                    if (columns[middle] < wanted)
                        low = middle + 1;
                    else
                        high = middle;
                }
                *start++ = low;
                for (int j = 0; j < dim; ++j)
                    all &= low + j < end && columns[low + j] == wanted + j;
            }
        }
        found[c] = all;
    }
}
