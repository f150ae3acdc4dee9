/* Lower factor L, L L' = A, of a positive semidefinite matrix of n rows.
 *
 * A pivot that is rounding error (see matrix.h) counts as zero, and its column is zero.
 */
#include "matrix.h"

KERNEL void matrix_cholesky_work(const int *sizes, long *reals, long *ints)
{
    (void)sizes;
    *reals = *ints = 0;
}

KERNEL void matrix_cholesky(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    (void)w;
    (void)iw;
    matrix_factor(sizes[0], arg[0], res[0]);
}
