/* Factor of L L' - v v', and 1 if that is positive definite, else 0; n rows.
 *
 * By hyperbolic rotations in their mixed form: the new row enters the rest of v, which is the
 * stable order (Chambers, Regression updating, 1971, doi:10.1080/01621459.1971.10482336). Where a
 * pivot would not be positive the old one stays, so that the factor is finite; the flag says that
 * it must not be used. Arguments: L and v.
 */
#include "matrix.h"

KERNEL void matrix_downdate_work(const int *sizes, long *reals, long *ints)
{
    *reals = sizes[0];
    *ints = 0;
}

KERNEL void matrix_downdate(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0];
    real definite = 1;
    int i, k;
    (void)iw;
    for (i = 0; i < n; ++i)
        w[i] = arg[1][i];
    for (k = 0; k < n; ++k) {
        const real *from = arg[0] + k * n;
        real *to = res[0] + k * n;
        const real old = from[k], top = w[k], square = (old - top) * (old + top);
        const int positive = square > 0;
        const real pivot = real_sqrt(positive ? square : old * old);
        const real c = pivot / old, s = positive ? top / old : 0;
        if (!positive)
            definite = 0;
        for (i = 0; i < k; ++i)
            to[i] = 0;
        to[k] = pivot;
        for (i = k + 1; i < n; ++i) {
            to[i] = (from[i] - s * w[i]) / c;
            w[i] = c * w[i] - s * to[i];
        }
    }
    res[1][0] = definite;
}
