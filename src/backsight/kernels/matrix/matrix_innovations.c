/* Innovations of a Kalman filter over a recording, independent within a sample, with variances.
 *
 * Of x+ = A x + b + w, y = C x + v, with the covariances Q and R of w and v, and x and P before the
 * first sample: e = y - C x has S = C P C' + R = L D L', and r = L^-1 e the variances D. Then
 *
 *     K = A P C' S^-1, F = A - K C, x+ = A x + K e + b, P+ = F P F' + K R K' + Q .
 *
 * sizes: nx, ny and n. Arguments: A, C, Q, R, x, P, b (nx, n), y (ny, n), the weights of the rows m
 * (ny, n), see `backsight.algebra.update.masked`, and a row of n that is 0 where a sample is judged
 * alone and corrects nothing. Results: r and D (ny, n), 0 and 1 where nothing was measured, and x
 * and P after the last sample.
 *
 * P does not depend on y: where a sample has the weights of the one before, and P has come back to
 * itself but for rounding, K and S stay as they are.
 */
#include "matrix.h"

/* Products of so many numbers are worth the call of a library. */
#define matrix_innovations_large 4096L

/* A B, or A B' if transposed; A has m rows and k columns, the product n columns. */
static void matrix_innovations_product(
    int m, int n, int k, const real *A, const real *B, int b_transposed, real *C)
{
    int i, j, l;
    for (i = 0; i < m * n; ++i)
        C[i] = 0;
    if ((long)m * n * k > matrix_innovations_large) {
        matrix_add_product(m, n, k, 1, A, 0, B, b_transposed, C);
        return;
    }
    for (j = 0; j < n; ++j)
        for (l = 0; l < k; ++l) {
            const real b = b_transposed ? B[j + l * n] : B[l + j * k];
            for (i = 0; i < m; ++i)
                C[i + j * m] += b * A[i + l * m];
        }
}

/* L D L' of a positive definite matrix: L without its ones in the place of what is below the
 * diagonal. */
static void matrix_innovations_factor(int n, real *S, real *D)
{
    int i, j, k;
    for (j = 0; j < n; ++j) {
        D[j] = S[j + j * n];
        for (k = j + 1; k < n; ++k) {
            const real l = S[k + j * n] / D[j];
            for (i = k; i < n; ++i)
                S[i + k * n] -= S[i + j * n] * l;
        }
        for (i = j + 1; i < n; ++i)
            S[i + j * n] /= D[j];
    }
}

/* X (L D L')^-1 in the place of X, which has m rows. */
static void matrix_innovations_divide(int m, int n, const real *L, const real *D, real *X)
{
    int i, j, k;
    for (j = 0; j < n; ++j)
        for (k = 0; k < j; ++k)
            for (i = 0; i < m; ++i)
                X[i + j * m] -= L[j + k * n] * X[i + k * m];
    for (j = n - 1; j >= 0; --j) {
        for (i = 0; i < m; ++i)
            X[i + j * m] /= D[j];
        for (k = j + 1; k < n; ++k)
            for (i = 0; i < m; ++i)
                X[i + j * m] -= L[k + j * n] * X[i + k * m];
    }
}

/* Covariance of an innovation as its factors, and that of the noise of the sample, N. X is P C'. */
static void matrix_innovations_spread(int nx, int ny, const real *C, const real *R, const real *m,
    const real *P, real *X, real *S, real *D, real *N)
{
    int i, j;
    matrix_innovations_product(nx, ny, nx, P, C, 1, X);
    matrix_innovations_product(ny, ny, nx, C, X, 0, S);
    for (j = 0; j < ny; ++j)
        for (i = j; i < ny; ++i) {
            const int at = i + j * ny, across = j + i * ny, both = m[i] > 0 && m[j] > 0;
            N[at] = N[across] = both ? R[at] / (m[i] * m[j]) : 0;
            S[at] = both ? (S[at] + S[across]) / 2 + N[at] : i == j;
        }
    for (j = 0; j < ny; ++j)
        for (i = 0; i < nx; ++i)
            X[i + j * nx] = m[j] > 0 ? X[i + j * nx] : 0;
    matrix_innovations_factor(ny, S, D);
}

/* P+ in the place of P; returns whether it is P but for rounding. F, T and next are work space. */
static int matrix_innovations_ahead(int nx, int ny, const real *A, const real *C, const real *Q,
    const real *N, const real *K, real *P, real *F, real *T, real *next)
{
    const real rounding = nx * real_epsilon;
    int i, j, l, same = 1;
    for (i = 0; i < nx * nx; ++i)
        F[i] = A[i];
    for (j = 0; j < nx; ++j)
        for (l = 0; l < ny; ++l)
            for (i = 0; i < nx; ++i)
                F[i + j * nx] -= K[i + l * nx] * C[l + j * ny];
    matrix_innovations_product(nx, nx, nx, F, P, 0, T);
    matrix_innovations_product(nx, nx, nx, T, F, 1, next);
    matrix_innovations_product(nx, ny, ny, K, N, 0, T);
    for (j = 0; j < nx; ++j)
        for (l = 0; l < ny; ++l)
            for (i = j; i < nx; ++i)
                next[i + j * nx] += T[i + l * nx] * K[j + l * nx];
    for (j = 0; j < nx; ++j)
        for (i = j; i < nx; ++i) {
            const int at = i + j * nx;
            real by;
            next[at] += Q[at];
            by = next[at] - P[at];
            same = same && by * by <= rounding * rounding * P[i + i * nx] * P[j + j * nx];
        }
    for (j = 0; j < nx; ++j)
        for (i = j; i < nx; ++i)
            P[i + j * nx] = P[j + i * nx] = next[i + j * nx];
    return same;
}

KERNEL void matrix_innovations_work(const int *sizes, long *reals, long *ints)
{
    const long nx = sizes[0], ny = sizes[1], wide = nx > ny ? nx : ny;
    *reals = 2 * nx * nx + nx * wide + 2 * nx * ny + 2 * ny * ny + 2 * ny + nx;
    *ints = 0;
}

KERNEL void matrix_innovations(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int nx = sizes[0], ny = sizes[1], n = sizes[2], wide = nx > ny ? nx : ny;
    const real *A = arg[0], *C = arg[1], *Q = arg[2], *R = arg[3];
    real *x = res[2], *P = res[3];
    real *F = w, *T = F + nx * nx, *P_next = T + nx * wide, *K = P_next + nx * nx, *X = K + nx * ny;
    real *L = X + nx * ny, *N = L + ny * ny, *D = N + ny * ny, *e = D + ny, *x_next = e + ny;
    int i, j, k, settled = 0;
    (void)iw;
    for (i = 0; i < nx; ++i)
        x[i] = arg[4][i];
    for (i = 0; i < nx * nx; ++i)
        P[i] = arg[5][i];
    for (k = 0; k < n; ++k) {
        const real *b = arg[6] + k * nx, *y = arg[7] + k * ny, *m = arg[8] + k * ny;
        real *r = res[0] + k * ny, *variance = res[1] + k * ny;
        int same = k > 0 && arg[9][k] == arg[9][k - 1];
        for (i = 0; i < ny && same; ++i)
            same = m[i] == m[i - ny];
        if (!(settled && same)) {
            matrix_innovations_spread(nx, ny, C, R, m, P, X, L, D, N);
            matrix_innovations_divide(nx, ny, L, D, X);
            matrix_innovations_product(nx, ny, nx, A, X, 0, K);
            for (i = 0; i < nx * ny; ++i)
                K[i] = arg[9][k] > 0 ? K[i] : 0;
            settled = matrix_innovations_ahead(nx, ny, A, C, Q, N, K, P, F, T, P_next);
        }
        for (i = 0; i < ny; ++i)
            e[i] = m[i] > 0 ? y[i] : 0;
        for (j = 0; j < nx; ++j)
            for (i = 0; i < ny; ++i)
                e[i] -= m[i] > 0 ? C[i + j * ny] * x[j] : 0;
        for (i = 0; i < ny; ++i) {
            r[i] = e[i];
            for (j = 0; j < i; ++j)
                r[i] -= L[i + j * ny] * r[j];
            variance[i] = D[i];
        }
        for (i = 0; i < nx; ++i)
            x_next[i] = b[i];
        for (j = 0; j < nx; ++j)
            for (i = 0; i < nx; ++i)
                x_next[i] += A[i + j * nx] * x[j];
        for (j = 0; j < ny; ++j)
            for (i = 0; i < nx; ++i)
                x_next[i] += K[i + j * nx] * e[j];
        for (i = 0; i < nx; ++i)
            x[i] = x_next[i];
    }
}
