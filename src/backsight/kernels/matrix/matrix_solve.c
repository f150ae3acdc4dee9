/* Solve L X = B, or L' X = B, for the lower factor L of a covariance.
 *
 * sizes: rows n, columns m of B, whether L is transposed. In L' X = B directions without variance
 * (a pivot that is rounding of its row) have rows of zeros in X. Arguments: L and B.
 */
#include "matrix.h"

#ifdef BACKSIGHT_FLOAT
#define matrix_solve_least 1e-5f
#else
#define matrix_solve_least 1e-12
#endif

KERNEL void matrix_solve_work(const int *sizes, long *reals, long *ints)
{
    *reals = sizes[0];
    *ints = 0;
}

KERNEL void matrix_solve(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0], m = sizes[1], transposed = sizes[2];
    const real *L = arg[0];
    int i, j, k, singular = 0;
    (void)iw;
    for (i = 0; i < n * m; ++i)
        res[0][i] = arg[1][i];
    if (transposed) {
        for (i = 0; i < n; ++i)
            w[i] = 0;
        for (k = 0; k < n; ++k)
            for (i = k; i < n; ++i)
                w[i] += L[i + k * n] * L[i + k * n];
        for (i = 0; i < n; ++i) {
            w[i] = L[i + i * n] > matrix_solve_least * real_sqrt(w[i]);
            singular |= w[i] == 0;
        }
    }
    if (!singular) {
        matrix_divide(n, m, L, transposed, res[0]);
        return;
    }
    for (j = 0; j < m; ++j)
        for (k = n - 1; k >= 0; --k) {
            real *x = res[0] + j * n;
            for (i = k + 1; i < n; ++i)
                x[k] -= L[i + k * n] * x[i];
            x[k] = w[k] != 0 ? x[k] / L[k + k * n] : 0;
        }
}
