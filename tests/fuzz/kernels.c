/* Kernels of matrices on sizes and numbers of any kind, in buffers with no room to spare.
 *
 * The first byte of a case chooses the kernel, the next ones its sizes, and each of the others is a
 * number. Every call is made twice, on work space and results that hold different rubbish: what it
 * writes must be the same to the last bit. With libFuzzer compile as it is; else with MAIN, which
 * draws cases itself: ./kernels SEED COUNT.
 */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kernels.h"

#define LARGEST 9 /* rows */
#define MOST 10   /* arguments */

typedef void kernel(const int *, const real *const *, real *const *, real *, int *);
typedef void work(const int *, long *, long *);

#define KNOWN(name) kernel matrix_##name; work matrix_##name##_work
KNOWN(cholesky); KNOWN(compress); KNOWN(congruence); KNOWN(downdate); KNOWN(gain);
KNOWN(innovations); KNOWN(near); KNOWN(product); KNOWN(solve); KNOWN(triangle); KNOWN(turn);

/* Sizes of arguments and results, ended by -1; sizes[2] and [3] were drawn below 2. */
static void shapes(int which, int *s, int *args, int *results)
{
    const int n = s[0], m = s[1];
    int *a = args, *r = results;
    switch (which) {
    case 0: *a++ = n * n; *r++ = n * n; break;
    case 1: *a++ = n * m; *r++ = n * n; break;
    case 2: *a++ = n * n; *a++ = n; *r++ = n * n; *r++ = 1; break;
    case 3:
        *a++ = n * m; *a++ = m * m; *a++ = m * m; *a++ = m; if (s[2]) *a++ = n * n;
        *r++ = n * m; *r++ = m * m; *r++ = m * m; if (s[2]) *r++ = n * n; break;
    case 4: *a++ = n * n; *a++ = n * n; *a++ = n; *a++ = 1; *r++ = 1; break;
    case 5: *a++ = n * s[2]; *a++ = s[2] * m; if (s[6]) *a++ = n * m; *r++ = n * m; break;
    case 6: *a++ = n * n; *a++ = n * m; *r++ = n * m; break;
    case 7: s[1] = m % 2; *a++ = s[1] ? n * (n + 1) / 2 : n * n; *a++ = n; *r++ = n * (n + 1) / 2; break;
    case 8:
        *a++ = n * n; *a++ = m * n; *a++ = n * n; *a++ = m * m; *a++ = n; *a++ = n * n;
        *a++ = n * s[2]; *a++ = m * s[2]; *a++ = m * s[2]; *a++ = s[2];
        *r++ = m * s[2]; *r++ = m * s[2]; *r++ = n; *r++ = n * n; break;
    case 10: *a++ = n * n; *a++ = n * n; *a++ = n * n; *r++ = n * n; break;
    default: if (s[2]) s[1] = n; *a++ = n * s[1]; *r++ = n * s[1];
    }
    *a = *r = -1;
}

static const struct { kernel *run; work *need; } kernels[] = {
    {matrix_cholesky, matrix_cholesky_work}, {matrix_compress, matrix_compress_work},
    {matrix_downdate, matrix_downdate_work}, {matrix_gain, matrix_gain_work},
    {matrix_near, matrix_near_work}, {matrix_product, matrix_product_work},
    {matrix_solve, matrix_solve_work}, {matrix_triangle, matrix_triangle_work},
    {matrix_innovations, matrix_innovations_work}, {matrix_turn, matrix_turn_work},
    {matrix_congruence, matrix_congruence_work},
};

#define KERNELS ((int)(sizeof kernels / sizeof kernels[0]))

static real number(uint8_t code)
{
    static const double odd[] = {0.0, -0.0, 4.9e-324, -1e-310, DBL_MAX, -1e200, INFINITY, -INFINITY,
                                 NAN, 1e-160, 1.0, 1.0, 1e-8, 1e8, -1.0, 0.5};
    return (real)(code < 16 ? odd[code] : (code - 128) / 32.0);
}

static real *block(long size, int fill)
{
    real *to = malloc(size * sizeof(real) + !size);
    memset(to, fill, size * sizeof(real));
    return to;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int s[7] = {0}, args[MOST + 1], results[MOST + 1], which, k;
    real *arg[MOST] = {0}, *res[2][MOST] = {{0}};
    size_t at = 8;
    long reals, ints;
    if (size < 8)
        return 0;
    which = data[0] % KERNELS;
    for (k = 0; k < 7; ++k)
        s[k] = data[k + 1] % (k < 2 || (k == 2 && (which == 5 || which == 8)) ? LARGEST + 1 : 2);
    shapes(which, s, args, results);
    kernels[which].need(s, &reals, &ints);
    for (k = 0; args[k] >= 0; ++k) {
        arg[k] = block(args[k], 0);
        for (int i = 0; i < args[k]; ++i, ++at)
            arg[k][i] = number(size > 8 ? data[8 + (at - 8) % (size - 8)] : 40);
    }
    for (int run = 0; run < 2; ++run) {
        const int rubbish = run ? 0x55 : 0xff;
        real *w = block(reals, rubbish);
        int *iw = malloc(ints * sizeof(int) + !ints);
        memset(iw, rubbish, ints * sizeof(int));
        for (k = 0; results[k] >= 0; ++k)
            res[run][k] = block(results[k], rubbish);
        kernels[which].run(s, (const real *const *)arg, res[run], w, iw);
        free(w);
        free(iw);
    }
    for (k = 0; results[k] >= 0; ++k) {
        for (int i = 0; i < results[k]; ++i) {
            const real one = res[0][k][i], two = res[1][k][i];
            if (!(one == two || (isnan(one) && isnan(two)))) {
                fprintf(stderr, "kernel %d leaves result %d, number %d as it was\n", which, k, i);
                abort();
            }
        }
        free(res[0][k]);
        free(res[1][k]);
    }
    for (k = 0; args[k] >= 0; ++k)
        free(arg[k]);
    return 0;
}

#ifdef MAIN
int main(int count, char **words)
{
    static uint8_t data[8 + 1024];
    uint64_t state = count > 1 ? strtoull(words[1], 0, 10) : 1;
    const long trials = count > 2 ? atol(words[2]) : 100000;
    state = state * 2654435769u + 88172645463325252u;
    for (long k = 0; k < trials; ++k) {
        const size_t size = 8 + k % 300;
        for (size_t i = 0; i < size; ++i) {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            /* Most numbers are plain, or else every result is none. */
            data[i] = (uint8_t)(state >> 24);
            if (i >= 8 && data[i] < 16 && state >> 56 > 20)
                data[i] += 100;
        }
        LLVMFuzzerTestOneInput(data, size);
    }
    printf("%ld calls\n", trials);
    return 0;
}
#endif
