/* What the kernels of this folder share: products and factors of dense matrices, column by column.
 *
 * Within Backsight they are BLAS and LAPACK, whose addresses Python provides (see library.py); in
 * an exported program, and where there are none, they are the loops below.
 */
#ifndef BACKSIGHT_MATRIX_H
#define BACKSIGHT_MATRIX_H

#include "kernels.h"

/* Pivots of a covariance below this share of its diagonal entry are rounding: no variance. */
#ifdef BACKSIGHT_FLOAT
#define matrix_nothing 1e-6f
#else
#define matrix_nothing 1e-14
#endif

#ifdef BACKSIGHT_BLAS
#include "blas.h"
#endif

/* C + sign op(A) op(B), op(A) with m rows and k columns, op(B) with n columns. */
static inline void matrix_add_product(int m, int n, int k, real sign, const real *A, int a_transposed,
    const real *B, int b_transposed, real *C)
{
    int i, j, l;
#ifdef BACKSIGHT_BLAS
    const real one = 1;
    const int lda = a_transposed ? k : m, ldb = b_transposed ? n : k, step = 1;
    if (m == 0 || n == 0 || k == 0)
        return;
    if (blas.gemm) {
        if (n == 1)
            blas.gemv(a_transposed ? "T" : "N", a_transposed ? &k : &m,
                a_transposed ? &m : &k, &sign, A, &lda, B, &step, &one, C, &step);
        else if (m == 1)
            blas.gemv(b_transposed ? "N" : "T", b_transposed ? &n : &k,
                b_transposed ? &k : &n, &sign, B, &ldb, A, &step, &one, C, &step);
        else
            blas.gemm(a_transposed ? "T" : "N", b_transposed ? "T" : "N", &m, &n, &k,
                &sign, A, &lda, B, &ldb, &one, C, &m);
        return;
    }
#endif
    for (j = 0; j < n; ++j) {
        real *to = C + j * m;
        if (a_transposed) {
            for (i = 0; i < m; ++i) {
                real sum = 0;
                for (l = 0; l < k; ++l)
                    sum += A[l + i * k] * (b_transposed ? B[j + l * n] : B[l + j * k]);
                to[i] += sign * sum;
            }
            continue;
        }
        for (l = 0; l < k; ++l) {
            const real b = sign * (b_transposed ? B[j + l * n] : B[l + j * k]);
            for (i = 0; i < m; ++i)
                to[i] += b * A[i + l * m];
        }
    }
}

#define matrix_square_small 64

/* Lower triangle of C + sign A A', or of C + sign A' A if transposed; A A' has n rows and sums over k
 * numbers.
 */
static inline void matrix_add_square(int n, int k, real sign, const real *A, int transposed, real *C)
{
    int i, j, l;
#ifdef BACKSIGHT_BLAS
    const real one = 1;
    if (n == 0 || k == 0)
        return;
    if (blas.gemm && n < matrix_square_small) {
        /* The other triangle too, which is faster than half of so little. */
        blas.gemm(transposed ? "T" : "N", transposed ? "N" : "T", &n, &n, &k, &sign, A,
            transposed ? &k : &n, A, transposed ? &k : &n, &one, C, &n);
        return;
    }
    if (blas.syrk) {
        blas.syrk("L", transposed ? "T" : "N", &n, &k, &sign, A, transposed ? &k : &n, &one, C, &n);
        return;
    }
#endif
    for (j = 0; j < n; ++j) {
        if (transposed) {
            for (i = j; i < n; ++i) {
                real sum = 0;
                for (l = 0; l < k; ++l)
                    sum += A[l + i * k] * A[l + j * k];
                C[i + j * n] += sign * sum;
            }
            continue;
        }
        for (l = 0; l < k; ++l) {
            const real b = sign * A[j + l * n];
            for (i = j; i < n; ++i)
                C[i + j * n] += b * A[i + l * n];
        }
    }
}

#define matrix_side 8

/* Copy the lower triangle of a matrix to the upper one, in squares that stay in the cache. */
static inline void matrix_mirror(int n, real *A)
{
    int i, j, p, q;
    for (q = 0; q < n; q += matrix_side) {
        const int columns = n - q < matrix_side ? n - q : matrix_side;
        for (j = q; j < q + columns; ++j)
            for (i = j + 1; i < q + columns; ++i)
                A[j + i * n] = A[i + j * n];
        for (p = q + matrix_side; p + matrix_side <= n; p += matrix_side) {
            /* Lengths that the compiler knows: it unrolls them. */
            const real *restrict from = A + p + q * n;
            real *restrict to = A + q + p * n;
            for (i = 0; i < matrix_side; ++i)
                for (j = 0; j < matrix_side; ++j)
                    to[j + i * n] = from[i + j * n];
        }
        for (i = p; i < n; ++i)
            for (j = q; j < q + columns; ++j)
                A[j + i * n] = A[i + j * n];
    }
}

/* Lower factor of a positive semidefinite matrix, in its place; zeros above. */
static inline void matrix_factor(int n, const real *A, real *L)
{
    int i, j, k;
#ifdef BACKSIGHT_BLAS
    if (blas.potrf) {
        int info = 0;
        for (j = 0; j < n; ++j)
            for (i = 0; i < n; ++i)
                L[i + j * n] = i < j ? 0 : A[i + j * n];
        blas.potrf("L", &n, L, &n, &info);
        for (j = 0; j < n && info == 0; ++j)
            info = !(L[j + j * n] * L[j + j * n] > matrix_nothing * A[j + j * n]);
        if (info == 0)
            return;
    }
#endif
    for (j = 0; j < n; ++j) {
        real pivot, size;
        for (i = 0; i < n; ++i)
            L[i + j * n] = i < j ? 0 : A[i + j * n];
        for (k = 0; k < j; ++k)
            for (i = j; i < n; ++i)
                L[i + j * n] -= L[i + k * n] * L[j + k * n];
        pivot = L[j + j * n];
        size = pivot > matrix_nothing * A[j + j * n] ? 1 / real_sqrt(pivot) : 0;
        for (i = j; i < n; ++i)
            L[i + j * n] *= size;
    }
}

/* Solve L X = B, or L' X = B if transposed, with m columns, in the place of B. */
static inline void matrix_divide(int n, int m, const real *L, int transposed, real *B)
{
    int i, j, k;
#ifdef BACKSIGHT_BLAS
    const real one = 1;
    if (n == 0 || m == 0)
        return;
    if (blas.trsm) {
        blas.trsm("L", "L", transposed ? "T" : "N", "N", &n, &m, &one, L, &n, B, &n);
        return;
    }
#endif
    for (j = 0; j < m; ++j) {
        real *x = B + j * n;
        if (!transposed) {
            for (k = 0; k < n; ++k) {
                x[k] /= L[k + k * n];
                for (i = k + 1; i < n; ++i)
                    x[i] -= L[i + k * n] * x[k];
            }
            continue;
        }
        for (k = n - 1; k >= 0; --k) {
            for (i = k + 1; i < n; ++i)
                x[k] -= L[i + k * n] * x[i];
            x[k] /= L[k + k * n];
        }
    }
}

#endif
