/* 1 if a symmetric matrix is close to another: ||diag(s)^-1 (A - B) diag(s)^-1||_F <= r, else 0.
 *
 * sizes: n. Arguments: A, B, the sizes s (n,) and r. Columns are looked at until it is clear.
 */
#include "matrix.h"

KERNEL void matrix_near_work(const int *sizes, long *reals, long *ints)
{
    *reals = sizes[0];
    *ints = 0;
}

KERNEL void matrix_near(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0];
    const real *A = arg[0], *B = arg[1], most = arg[3][0] * arg[3][0];
    real sum = 0;
    int i, j;
    (void)iw;
    for (i = 0; i < n; ++i)
        w[i] = 1 / (arg[2][i] * arg[2][i]);
    for (j = 0; j < n && sum <= most; ++j) {
        real column = 0;
        for (i = 0; i < n; ++i) {
            const real by = A[i + j * n] - B[i + j * n];
            column += by * by * w[i];
        }
        sum += column * w[j];
    }
    res[0][0] = sum <= most; /* not if it is no number */
}
