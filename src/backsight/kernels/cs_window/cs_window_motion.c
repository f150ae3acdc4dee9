/* The whole motion of a window from its solution: adjoints backward give the noise, and the motion is
   then simulated.

   sizes and the first nine arguments are those of `cs_window_stages`; then what `cs_window` says:
   weighted residuals e = S0^-1 (...) of all rows, modal forces, first state. With

       l_k = A_k' l_{k+1} + C_k' e_k,    w_k = cov(w, w) l_{k+1} + cov(w, y) e_k

   the result is x_{k+1} = A_k x_k + E_k f_k + w_k, all states side by side, those of samples that are
   absent equal to the first one, and the modal forces of all samples. */

#include "kernels.h"

#include "cs_window_algebra.h"

enum { IN_A, IN_E, IN_C, IN_F, IN_SIGMA, IN_Q, IN_R, IN_N, IN_ABSENT, IN_SOLUTION };

KERNEL void cs_window_motion_work(const int *sizes, long *reals, long *ints)
{
    const long nx = sizes[0], p = sizes[2], N = sizes[4];
    *reals = nx * (N + 2) + 2 * p + nx;
    *ints = 0;
}

KERNEL void cs_window_motion(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int nx = sizes[0], ny = sizes[1], p = sizes[2], steps = sizes[3], N = sizes[4];
    const int absent = (int)arg[IN_ABSENT][0], count = N + 1 - absent, m = ny * (N + 1);
    const real *e = arg[IN_SOLUTION], *f = e + m, *first = f + p * steps;
    real *l = w, *b = l + nx * (N + 2), *c = b + p, *q = c + p, *x = res[0], *forces = res[1];
    (void)iw;
    for (int i = 0; i < nx; ++i) l[count * nx + i] = 0;
    for (int k = count - 1; k >= 0; --k) {
        const real *A = arg[IN_A] + (k + absent) * nx * nx, *C = arg[IN_C] + (k + absent) * ny * nx;
        for (int i = 0; i < nx; ++i)
            l[k * nx + i] = cs_window_dot(A + i * nx, l + (k + 1) * nx, nx)
                            + cs_window_dot(C + i * ny, e + k * ny, ny);
    }
    for (int k = 0; k <= absent; ++k)
        for (int i = 0; i < nx; ++i) x[k * nx + i] = first[i];
    for (int i = 0; i < p * (N + 1); ++i) forces[i] = 0;
    for (int k = 0; k < count; ++k) {
        const real *A = arg[IN_A] + (k + absent) * nx * nx, *E = arg[IN_E] + (k + absent) * nx * p;
        const real *F = arg[IN_F] + (k + absent) * ny * p, *own = l + (k + 1) * nx, *ek = e + k * ny;
        const real *now = x + (k + absent) * nx;
        real *next = x + (k + absent + 1) * nx;
        for (int i = 0; i < nx; ++i) q[i] = own[i]; /* what the process noise moves: l + N' e */
        for (int i = 0; i < nx; ++i) q[i] += cs_window_dot(arg[IN_N] + i * ny, ek, ny);
        for (int j = 0; j < p; ++j)
            b[j] = cs_window_dot(E + j * nx, q, nx) + cs_window_dot(F + j * ny, ek, ny);
        for (int j = 0; j < p; ++j) c[j] = 0;
        cs_window_product(c, 1, arg[IN_SIGMA], p, b, 1, p, p);
        for (int j = 0; j < p && k < steps; ++j) {
            c[j] += f[k * p + j];
            forces[(k + absent) * p + j] = f[k * p + j];
        }
        for (int i = 0; i < nx; ++i) next[i] = 0;
        cs_window_product(next, 1, A, nx, now, 1, nx, nx);
        cs_window_product(next, 1, E, nx, c, 1, nx, p);
        cs_window_product(next, 1, arg[IN_Q], nx, q, 1, nx, nx);
    }
}
