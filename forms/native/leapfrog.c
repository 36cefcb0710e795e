/* One pass over the unknowns: v += dt_mean a, u += dt v. */

#include <stdint.h>

#if defined(__x86_64__) && defined(__linux__)
#define EXPORT __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define EXPORT
#endif

EXPORT void tribox_leapfrog(int64_t n, double mean, double dt, const double *restrict a,
                            double *restrict v, double *restrict u)
{
    for (int64_t i = 0; i < n; ++i) {
        v[i] += mean * a[i];
        u[i] += dt * v[i];
    }
}
