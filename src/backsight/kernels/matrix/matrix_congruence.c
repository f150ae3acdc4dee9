/* A P A' + Q of symmetric P and Q, of n rows: to the last bit symmetric, too.
 *
 * With P = L L' it is a triangular product and the square of its result, (A L) (A L)', together
 * 7/3 n^3 operations where two products of whole matrices take 4 n^3; and it is positive whatever
 * was rounded. A P that has no factor (a state that is known) is multiplied as it is, and so are
 * small matrices, of which the factor takes longer. Arguments: A, P and Q.
 */
#include "matrix.h"

#ifdef BACKSIGHT_BLAS
#define matrix_congruence_by_factor matrix_square_small
#endif

KERNEL void matrix_congruence_work(const int *sizes, long *reals, long *ints)
{
    *reals = 2L * sizes[0] * sizes[0];
    *ints = 0;
}

#ifdef BACKSIGHT_BLAS
/* X = A L for the factor L of P, unless there is none. */
static inline int matrix_congruence_factored(int n, const real *A, const real *P, real *L, real *X)
{
    const real one = 1;
    int info = 0, i, j;
    if (n < matrix_congruence_by_factor || !blas.potrf || !blas.trmm)
        return 0;
    for (j = 0; j < n; ++j)
        for (i = j; i < n; ++i)
            L[i + j * n] = P[i + j * n];
    blas.potrf("L", &n, L, &n, &info);
    if (info != 0)
        return 0;
    for (i = 0; i < n * n; ++i)
        X[i] = A[i];
    blas.trmm("R", "L", "N", "N", &n, &n, &one, L, &n, X, &n);
    return 1;
}
#endif

KERNEL void matrix_congruence(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int n = sizes[0];
    real *X = w, *C = res[0];
    int i, j, k;
    (void)iw;
#ifdef BACKSIGHT_BLAS
    if (matrix_congruence_factored(n, arg[0], arg[1], w + n * n, X)) {
        for (j = 0; j < n; ++j)
            for (i = j; i < n; ++i)
                C[i + j * n] = arg[2][i + j * n];
        matrix_add_square(n, n, 1, X, 0, C);
        matrix_mirror(n, C);
        return;
    }
#endif
    for (i = 0; i < n * n; ++i)
        X[i] = 0;
    matrix_add_product(n, n, n, 1, arg[0], 0, arg[1], 0, X);
    for (i = 0; i < n * n; ++i)
        C[i] = arg[2][i];
#ifdef BACKSIGHT_BLAS
    if (blas.gemm) {
        matrix_add_product(n, n, n, 1, X, 0, arg[0], 1, C);
        matrix_mirror(n, C);
        return;
    }
#endif
    for (j = 0; j < n; ++j)
        for (k = 0; k < n; ++k)
            for (i = j; i < n; ++i)
                C[i + j * n] += X[i + k * n] * arg[0][j + k * n];
    matrix_mirror(n, C);
}
