/* A' of a matrix with m rows and n columns; or, of a square one, (A + A') / 2.
 *
 * sizes: m, n, and 1 for the symmetric part. In small squares, so that both sides of the diagonal
 * stay in the cache.
 */
#include "matrix.h"

#define matrix_turn_side 16

KERNEL void matrix_turn_work(const int *sizes, long *reals, long *ints)
{
    (void)sizes;
    *reals = *ints = 0;
}

KERNEL void matrix_turn(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int m = sizes[0], n = sizes[1], symmetric = sizes[2];
    const real *A = arg[0];
    int i, j, p, q;
    (void)w;
    (void)iw;
    for (p = 0; p < m; p += matrix_turn_side)
        for (q = 0; q < n; q += matrix_turn_side)
            for (i = p; i < m && i < p + matrix_turn_side; ++i)
                for (j = q; j < n && j < q + matrix_turn_side; ++j)
                    res[0][j + i * n] =
                        symmetric ? (A[i + j * m] + A[j + i * m]) / 2 : A[i + j * m];
}
