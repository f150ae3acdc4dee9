#include "kernels.h"

/* sizes = {n}. Sorts x (n, 1) and adds shift (1, 1) times the place that each number had before.
 * Results: those numbers (n, 1), and how many exchanges it took (1, 1). */
KERNEL void ranked_work(const int *sizes, long *reals, long *ints)
{
    *reals = sizes[0];
    *ints = sizes[0];
}

KERNEL void ranked(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0];
    int i, k, exchanges = 0;
    for (i = 0; i < n; ++i) {
        const real x = arg[0][i];
        for (k = i; k > 0 && w[k - 1] > x; --k, ++exchanges) {
            w[k] = w[k - 1];
            iw[k] = iw[k - 1];
        }
        w[k] = x;
        iw[k] = i;
    }
    for (i = 0; i < n; ++i)
        res[0][i] = w[i] + arg[1][0] * (real)iw[i];
    res[1][0] = (real)exchanges;
}
