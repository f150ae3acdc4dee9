/* C + sign A A', or C + sign A' A, of a symmetric C: to the last bit symmetric, too.
 *
 * sizes: n rows of C, how many numbers the product sums over, whether A is transposed, the sign.
 * Arguments: C, of which the lower triangle counts, and A.
 */
#include "matrix.h"

KERNEL void matrix_square_work(const int *sizes, long *reals, long *ints)
{
    (void)sizes;
    *reals = *ints = 0;
}

KERNEL void matrix_square(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0];
    int i, j;
    (void)w;
    (void)iw;
    for (j = 0; j < n; ++j)
        for (i = j; i < n; ++i)
            res[0][i + j * n] = arg[0][i + j * n];
    matrix_add_square(n, sizes[1], sizes[3] ? -1 : 1, arg[1], sizes[2], res[0]);
    matrix_mirror(n, res[0]);
}
