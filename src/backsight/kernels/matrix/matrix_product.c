/* C + sign op(A) op(B): a product of dense matrices, to which another is added.
 *
 * sizes: m, n, k, whether A and B are transposed, the sign, whether there is a C. Arguments: A, B
 * and, if there is one, C.
 */
#include "matrix.h"

KERNEL void matrix_product_work(const int *sizes, long *reals, long *ints)
{
    (void)sizes;
    *reals = *ints = 0;
}

KERNEL void matrix_product(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int m = sizes[0], n = sizes[1], added = sizes[6];
    int i;
    (void)w;
    (void)iw;
    for (i = 0; i < m * n; ++i)
        res[0][i] = added ? arg[2][i] : 0;
    matrix_add_product(
        m, n, sizes[2], sizes[5] ? -1 : 1, arg[0], sizes[3], arg[1], sizes[4], res[0]);
}
