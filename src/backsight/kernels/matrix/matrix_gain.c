/* Gain and innovation covariance of a Kalman filter, with rows that have weights or are missing.
 *
 * sizes: nx, ny, and 1 for the covariance after the measurement, too. Arguments: P H' (nx, ny),
 * H P H' (ny, ny), R (ny, ny), the mask m (ny,), see `backsight.algebra.update.masked`, and P.
 * With M = diag(m), B = diag(m > 0):
 *
 *     K = P H' M (M H P H' M + B R B + I - B)^-1 M,
 *
 * which has columns of zeros for rows that were not measured, the covariance N of the sample's own
 * noise, M^-1 R M^-1 but nominal where not measured, and S = H P H' + N. The gain is the
 * optimal one of the measured rows for this noise. With the factor L of the matrix in brackets
 * and W = L^-1 M H P the covariance after the measurement is P - W' W, to the last bit symmetric.
 */
#include "matrix.h"

KERNEL void matrix_gain_work(const int *sizes, long *reals, long *ints)
{
    *reals = 2L * sizes[1] * sizes[1] + (long)sizes[0] * sizes[1];
    *ints = 0;
}

KERNEL void matrix_gain(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int nx = sizes[0], ny = sizes[1], corrected = sizes[2];
    const real *PHt = arg[0], *HPH = arg[1], *R = arg[2], *m = arg[3];
    real *K = res[0], *S = res[1], *N = res[2];
    real *A = w, *L = w + ny * ny, *X = w + 2 * ny * ny; /* X is W, then the gain, transposed */
    int i, j;
    (void)iw;
    for (j = 0; j < ny; ++j)
        for (i = 0; i < ny; ++i) {
            const int at = i + j * ny, both = m[i] > 0 && m[j] > 0;
            const real hph = (HPH[at] + HPH[j + i * ny]) / 2;
            N[at] = R[at] / ((m[i] > 0 ? m[i] : 1) * (m[j] > 0 ? m[j] : 1));
            S[at] = hph + N[at];
            A[at] = m[i] * m[j] * hph + (both ? R[at] : i == j);
        }
    matrix_factor(ny, A, L);
    for (j = 0; j < nx; ++j)
        for (i = 0; i < ny; ++i)
            X[i + j * ny] = m[i] * PHt[j + i * nx];
    matrix_divide(ny, nx, L, 0, X);
    if (corrected) {
        real *after = res[3];
        for (i = 0; i < nx * nx; ++i)
            after[i] = arg[4][i];
        matrix_add_square(nx, ny, -1, X, 1, after);
        matrix_mirror(nx, after);
    }
    matrix_divide(ny, nx, L, 1, X);
    for (i = 0; i < ny; ++i)
        for (j = 0; j < nx; ++j)
            K[j + i * nx] = m[i] * X[i + j * ny];
}
