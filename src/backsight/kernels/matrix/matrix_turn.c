/* A' of a matrix with m rows and n columns; or, of a square one, (A + A') / 2.
 *
 * sizes: m, n, and 1 for the symmetric part. In small squares, so that both sides of the diagonal
 * stay in the cache.
 */
#include "matrix.h"

#define matrix_turn_side 8

/* A square from row p and column q on, whole or what there is of it, and its mirror image. */
static void matrix_turn_square(
    const real *restrict A, int m, real *restrict B, int n, int rows, int columns)
{
    int i, j;
    if (rows == matrix_turn_side && columns == matrix_turn_side) {
        /* Lengths that the compiler knows: it unrolls them. */
        for (i = 0; i < matrix_turn_side; ++i)
            for (j = 0; j < matrix_turn_side; ++j)
                B[j + i * n] = A[i + j * m];
        return;
    }
    for (i = 0; i < rows; ++i)
        for (j = 0; j < columns; ++j)
            B[j + i * n] = A[i + j * m];
}

static void matrix_turn_halves(
    const real *restrict A, const real *restrict mirrored, int n, real *restrict B, int rows,
    int columns)
{
    int i, j;
    if (rows == matrix_turn_side && columns == matrix_turn_side) {
        for (j = 0; j < matrix_turn_side; ++j)
            for (i = 0; i < matrix_turn_side; ++i)
                B[i + j * n] = (A[i + j * n] + mirrored[j + i * n]) / 2;
        return;
    }
    for (j = 0; j < columns; ++j)
        for (i = 0; i < rows; ++i)
            B[i + j * n] = (A[i + j * n] + mirrored[j + i * n]) / 2;
}

static inline int matrix_turn_left(int from, int end)
{
    return end - from < matrix_turn_side ? end - from : matrix_turn_side;
}

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
    int p, q;
    (void)w;
    (void)iw;
    for (q = 0; q < n; q += matrix_turn_side)
        for (p = 0; p < m; p += matrix_turn_side) {
            const int rows = matrix_turn_left(p, m), columns = matrix_turn_left(q, n);
            if (symmetric)
                matrix_turn_halves(A + p + q * m, A + q + p * m, m, res[0] + p + q * m, rows, columns);
            else
                matrix_turn_square(A + p + q * m, m, res[0] + q + p * n, n, rows, columns);
        }
}
