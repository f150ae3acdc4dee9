/* Products and factors of small matrices, column by column.

   Vectors that change in every pass begin at the same place, or two further on, in the next one: a
   load that overlaps two earlier stores would have to wait for both. */
#ifndef CS_WINDOW_ALGEBRA_H
#define CS_WINDOW_ALGEBRA_H

#include "kernels.h"

static real cs_window_dot(const real *a, const real *b, int n)
{
    real even = 0, odd = 0;
    int i = 0;
    for (; i + 2 <= n; i += 2) {
        even += a[i] * b[i];
        odd += a[i + 1] * b[i + 1];
    }
    return i < n ? even + odd + a[i] * b[i] : even + odd;
}

/* a += s b + t c. */
static void cs_window_add_two(real *restrict a, real s, const real *restrict b, real t,
                              const real *restrict c, int n)
{
    for (int i = 0; i < n; ++i) a[i] += s * b[i] + t * c[i];
}

static void cs_window_add(real *restrict a, real s, const real *restrict b, int n)
{
    for (int i = 0; i < n; ++i) a[i] += s * b[i];
}

/* y += factor A x, where the columns of A lie `stride` apart and the elements of x `each`. Four
   columns make a pass, which compilers turn into vector instructions along the rows. */
static void cs_window_product(real *restrict y, real factor, const real *restrict A, int stride,
                              const real *restrict x, int each, int rows, int n)
{
    for (; n >= 4; n -= 4, A += 4 * stride, x += 4 * each) {
        const real *a = A, *b = a + stride, *c = b + stride, *d = c + stride;
        const real s = factor * x[0], t = factor * x[each];
        const real u = factor * x[2 * each], v = factor * x[3 * each];
        for (int i = 0; i < rows; ++i) y[i] += (s * a[i] + t * b[i]) + (u * c[i] + v * d[i]);
    }
    if (n == 3) {
        const real *a = A, *b = a + stride, *c = b + stride;
        const real s = factor * x[0], t = factor * x[each], u = factor * x[2 * each];
        for (int i = 0; i < rows; ++i) y[i] += s * a[i] + (t * b[i] + u * c[i]);
    }
    if (n == 2) cs_window_add_two(y, factor * x[0], A, factor * x[each], A + stride, rows);
    if (n == 1) cs_window_add(y, factor * x[0], A, rows);
}

/* y = A x, columns `stride` apart: what `cs_window_product` adds to zeros, which are not written. */
static void cs_window_applied(real *restrict y, const real *restrict A, int stride,
                              const real *restrict x, int rows, int n)
{
    if (n >= 4) {
        const real *a = A, *b = a + stride, *c = b + stride, *d = c + stride;
        for (int i = 0; i < rows; ++i)
            y[i] = (x[0] * a[i] + x[1] * b[i]) + (x[2] * c[i] + x[3] * d[i]);
        if (n > 4) cs_window_product(y, 1, d + stride, stride, x + 4, 1, rows, n - 4);
    } else if (n == 3) {
        const real *a = A, *b = a + stride, *c = b + stride;
        for (int i = 0; i < rows; ++i) y[i] = x[0] * a[i] + (x[1] * b[i] + x[2] * c[i]);
    } else if (n == 2) {
        const real *a = A, *b = a + stride;
        for (int i = 0; i < rows; ++i) y[i] = x[0] * a[i] + x[1] * b[i];
    } else {
        for (int i = 0; i < rows; ++i) y[i] = n == 1 ? x[0] * A[i] : 0;
    }
}

/* Lower factor of a positive semidefinite matrix in place, of which only the lower triangle is
   used; directions without variance are 0. */
static void cs_window_factor(real *A, int n)
{
    for (int j = 0; j < n; ++j) {
        real *column = A + j * n;
        const real least = 16 * real_epsilon * column[j];
        cs_window_product(column + j, -1, A + j, n, A + j, n, n - j, j);
        const real pivot = column[j], scale = pivot > least ? 1 / real_sqrt(pivot) : 0;
        for (int i = j; i < n; ++i) column[i] *= scale;
    }
}

/* Turn the diagonal of a factor into its reciprocals, as the following functions take it. */
static void cs_window_ready(real *L, int n)
{
    for (int j = 0; j < n; ++j) L[j + j * n] = L[j + j * n] > 0 ? 1 / L[j + j * n] : 0;
}

/* L^-1 b in place, for the rows and columns from `first` on. */
static void cs_window_forward(const real *L, int stride, real *b, int first, int n)
{
    int j = first;
    for (; j + 2 <= n; j += 2) {
        const real *one = L + j * stride, *two = one + stride;
        b[j] *= one[j];
        b[j + 1] = (b[j + 1] - b[j] * one[j + 1]) * two[j + 1];
        cs_window_add_two(b + j + 2, -b[j], one + j + 2, -b[j + 1], two + j + 2, n - j - 2);
    }
    if (j < n) b[j] *= L[j + j * stride];
}

/* L'^-1 b in place but for the elements before `first`, which get b - L' of those after them. The
   rows of L are taken from the columns above the diagonal. */
static void cs_window_backward(const real *L, int stride, real *b, int first, int n)
{
    int j = n - 1;
    for (; j > first; j -= 2) {
        const real *one = L + j * stride, *two = one - stride;
        b[j] *= one[j];
        b[j - 1] = (b[j - 1] - b[j] * one[j - 1]) * two[j - 1];
        cs_window_add_two(b, -b[j], one, -b[j - 1], two, j - 1);
    }
    if (j == first) {
        b[j] *= L[j + j * stride];
        cs_window_add(b, -b[j], L + j * stride, j);
    }
}

/* L'^-1 b in place; of L the lower triangle is used. */
static void cs_window_back(const real *L, real *b, int n)
{
    for (int j = n - 1; j >= 0; --j) {
        const real *column = L + (long)j * n;
        b[j] = (b[j] - cs_window_dot(column + j + 1, b + j + 1, n - 1 - j)) * column[j];
    }
}

/* X with X'X = (Pa^-1 + I)^-1 for Pa of any rank: C^-1 L', Pa = L L', C C' = 1 + L' I L; w takes
   3 n^2 numbers. */
static void cs_window_posterior(const real *Pa, const real *I, int stride, real *X, int n, real *w)
{
    real *L = w, *IL = L + n * n, *C = IL + n * n;
    for (int i = 0; i < n * n; ++i) L[i] = Pa[i];
    cs_window_factor(L, n);
    for (int j = 0; j < n; ++j) {
        for (int i = 0; i < j; ++i) L[i + j * n] = 0;
        for (int i = 0; i < n; ++i) IL[i + j * n] = 0;
        cs_window_product(IL + j * n, 1, I + j * stride, stride, L + j + j * n, 1, n, n - j);
        for (int i = j; i < n; ++i) C[i + j * n] = (real)(i == j);
    }
    for (int j = 0; j < n; ++j)
        for (int i = j; i < n; ++i)
            C[i + j * n] += cs_window_dot(L + i + i * n, IL + i + j * n, n - i);
    cs_window_factor(C, n);
    cs_window_ready(C, n);
    for (int j = 0; j < n; ++j) {
        real *column = X + j * n;
        for (int i = 0; i < n; ++i) column[i] = L[j + i * n];
        cs_window_forward(C, n, column, 0, n);
    }
}

/* X with X'X = I^-1, nothing known beforehand; 0 if the window does not determine its first state;
   w takes n^2 numbers. */
static int cs_window_unknown(const real *I, int stride, real *X, int n, real *w)
{
    real *L = w;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) L[i + j * n] = I[i + j * stride];
    cs_window_factor(L, n);
    for (int j = 0; j < n; ++j)
        if (!(L[j + j * n] * L[j + j * n] > (real)1e-12 * I[j + j * stride])) return 0;
    cs_window_ready(L, n);
    for (int j = 0; j < n; ++j) {
        for (int i = 0; i < n; ++i) X[i + j * n] = (real)(i == j);
        cs_window_forward(L, n, X + j * n, 0, n);
    }
    return 1;
}

#endif
