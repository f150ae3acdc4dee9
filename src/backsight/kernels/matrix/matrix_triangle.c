/* Lower triangle, column by column, of a symmetric matrix A of n rows in other units: a_i a_j A_ij.
 *
 * sizes: n, and 1 if A is given as its lower triangle already. Arguments: A and a.
 */
#include "matrix.h"

KERNEL void matrix_triangle_work(const int *sizes, long *reals, long *ints)
{
    (void)sizes;
    *reals = *ints = 0;
}

KERNEL void matrix_triangle(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0], packed = sizes[1];
    const real *restrict a = arg[1], *from = arg[0];
    real *to = res[0];
    int i, j;
    (void)w;
    (void)iw;
    for (j = 0; j < n; ++j) {
        const real *restrict column = packed ? from : arg[0] + j + j * n;
        real *restrict result = to;
        const real by = a[j];
        for (i = 0; i < n - j; ++i)
            result[i] = column[i] * a[j + i] * by;
        from += n - j;
        to += n - j;
    }
}
