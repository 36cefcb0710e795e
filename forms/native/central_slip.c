/* Elastic slips on the central path, of forms/contact/interior_point.py: all points at once. */

#include <stdint.h>

#include "lanes.h"

/* The largest a (q) found with a (1 + kappa / (1 - a^2)) at most t, 0 <= a <= min(t, 1), by halving
 * the interval: Newton's method is slow beside the pole at 1. */
EXPORT void tribox_central_slip(int64_t points, int64_t halvings, const double *t,
                                const double *kappa, double *a)
{
    for (int64_t first = 0; first < points; first += LANES) {
        const int64_t count = points - first < LANES ? points - first : LANES;
        vec wanted = all(0.0), barrier = all(1.0), low = all(0.0);
        for (int64_t l = 0; l < count; ++l)
            wanted[l] = t[first + l], barrier[l] = kappa[first + l];
        vec high = choose((ivec)(wanted < 1.0), wanted, all(1.0));
        for (int64_t k = 0; k < halvings; ++k) {
            vec ahead = 0.5 * (low + high);
            ivec over = (ivec)(ahead * (1.0 + barrier / (1.0 - ahead * ahead)) > wanted);
            low = choose(over, low, ahead);
            high = choose(over, ahead, high);
        }
        for (int64_t l = 0; l < count; ++l)
            a[first + l] = low[l];
    }
}
