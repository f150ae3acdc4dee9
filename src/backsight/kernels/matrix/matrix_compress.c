/* Lower triangular L with L L' = A A' and no negative diagonal, for A with n rows and m columns.
 *
 * By LAPACK's QR of A', or by modified Gram-Schmidt on the rows, whose triangular factor is as
 * accurate (Björck 1967, doi:10.1007/BF01934122). A row that depends on the rows above gets a pivot
 * that is zero, or rounding.
 */
#include "matrix.h"

#define matrix_compress_block 32 /* columns that LAPACK takes at once */

KERNEL void matrix_compress_work(const int *sizes, long *reals, long *ints)
{
    *reals = (long)sizes[0] * (sizes[1] + 1 + matrix_compress_block);
    *ints = 0;
}

KERNEL void matrix_compress(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0], m = sizes[1];
    real *L = res[0], *rows = w; /* row i of A is column i here */
    int i, j, k;
    (void)iw;
    for (i = 0; i < n; ++i)
        for (k = 0; k < m; ++k)
            rows[k + i * m] = arg[0][i + k * n];
    for (i = 0; i < n * n; ++i)
        L[i] = 0;
#ifdef BACKSIGHT_BLAS
    if (blas.geqrf) {
        const int space = n * matrix_compress_block;
        int info = 0;
        blas.geqrf(&m, &n, rows, &m, w + n * m, w + n * m + n, &space, &info);
        for (k = 0; k < n && k < m; ++k) {
            const real sign = rows[k + k * m] < 0 ? -1 : 1;
            for (i = k; i < n; ++i)
                L[i + k * n] = sign * rows[k + i * m];
        }
        return;
    }
#endif
    for (i = 0; i < n; ++i) {
        real size = 0;
        for (k = 0; k < m; ++k)
            size += rows[k + i * m] * rows[k + i * m];
        size = real_sqrt(size);
        L[i + i * n] = size;
        for (k = 0; k < m; ++k)
            rows[k + i * m] /= size > 0 ? size : 1;
        for (j = i + 1; j < n; ++j) {
            real along = 0;
            for (k = 0; k < m; ++k)
                along += rows[k + i * m] * rows[k + j * m];
            L[j + i * n] = along;
            for (k = 0; k < m; ++k)
                rows[k + j * m] -= along * rows[k + i * m];
        }
    }
}
