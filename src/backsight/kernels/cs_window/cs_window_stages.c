/* The problem of a window whose samples are linearised along a motion, as `cs_window` takes it.

   sizes: nx, ny (outputs and limited sums), p, steps, N, lag. With w = E_k b + q and the background forces
   b ~ (0, Sigma), q ~ (0, Q), v ~ (0, R), the deviation from the motion without forces is

       x_{k+1} = A_k x_k + E_k f_k + w_k,    y_k = C_k x_k + F_k (f_k + b_k) + N w_k + v_k.

   Arguments: A, E, C, F of all samples side by side; Sigma, Q, R, N; samples before the first one.
   Results: what follows for outputs and states of the first state (O, Phi), of the forces (G, and
   those of all states), and of the noise: covariances of outputs, of the states, and between them. */

#include "kernels.h"

#include "cs_window_algebra.h"

enum { OF_A, OF_E, OF_C, OF_F, OF_SIGMA, OF_Q, OF_R, OF_N, OF_ABSENT };
enum { TO_O, TO_G, TO_S0, TO_POWERS, TO_P, TO_CROSS, TO_MOVED };

KERNEL void cs_window_stages_work(const int *sizes, long *reals, long *ints)
{
    const long nx = sizes[0], ny = sizes[1], p = sizes[2];
    *reals = nx * p + ny * p + nx * nx + nx * ny + ny * ny + (nx + ny) * (p + nx);
    *ints = 0;
}

/* Y = A B (rows, columns), of A with n columns; cleared first. */
static void cs_window_stages_times(real *Y, const real *A, const real *B, int rows, int n, int columns)
{
    for (int i = 0; i < rows * columns; ++i) Y[i] = 0;
    for (int j = 0; j < columns; ++j) cs_window_product(Y + j * rows, 1, A, rows, B + j * n, 1, rows, n);
}

/* Y += A B' with B (columns, n). */
static void cs_window_stages_add(real *Y, const real *A, const real *B, int rows, int n, int columns)
{
    for (int j = 0; j < columns; ++j)
        cs_window_product(Y + j * rows, 1, A, rows, B + j, columns, rows, n);
}

KERNEL void cs_window_stages(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const int nx = sizes[0], ny = sizes[1], p = sizes[2], steps = sizes[3], N = sizes[4];
    const int m = ny * (N + 1), d = p * steps, absent = (int)arg[OF_ABSENT][0];
    real *own = w, *seen = own + nx * p, *Qk = seen + ny * p, *M = Qk + nx * nx, *R = M + nx * ny;
    real *by_state = R + ny * ny, *by_force = by_state + nx * nx, *by_output = by_force + nx * p;
    real *powers = res[TO_POWERS], *P = res[TO_P], *cross = res[TO_CROSS], *moved = res[TO_MOVED];
    (void)iw;
    for (int i = 0; i < nx * nx; ++i) powers[i] = (real)(i % nx == i / nx), P[i] = 0;
    for (int i = 0; i < nx * d * (N + 2); ++i) moved[i] = 0;
    for (int i = 0; i < m * nx * (N + 2); ++i) cross[i] = 0;
    for (int i = 0; i < m * d; ++i) res[TO_G][i] = 0;
    for (int k = 0; k <= N; ++k) {
        const int from = k + absent < N ? k + absent : N; /* what comes after the end is not measured */
        const real *A = arg[OF_A] + from * nx * nx, *E = arg[OF_E] + from * nx * p;
        const real *C = arg[OF_C] + from * ny * nx, *F = arg[OF_F] + from * ny * p;
        real *Pk = P + k * nx * nx, *Pn = Pk + nx * nx;

        /* 1. noise of the sample: seen = F + N E, M = cov(w, y), R = cov(y) but for the state's part */
        for (int i = 0; i < ny * p; ++i) seen[i] = F[i];
        for (int j = 0; j < p; ++j)
            cs_window_product(seen + j * ny, 1, arg[OF_N], ny, E + j * nx, 1, ny, nx);
        cs_window_stages_times(own, E, arg[OF_SIGMA], nx, p, p);
        for (int i = 0; i < nx * nx; ++i) Qk[i] = arg[OF_Q][i];
        cs_window_stages_add(Qk, own, E, nx, p, nx);
        for (int i = 0; i < nx * ny; ++i) M[i] = 0;
        cs_window_stages_add(M, own, seen, nx, p, ny);
        cs_window_stages_add(M, arg[OF_Q], arg[OF_N], nx, nx, ny);
        cs_window_stages_times(by_force, seen, arg[OF_SIGMA], ny, p, p);
        for (int i = 0; i < ny * ny; ++i) R[i] = arg[OF_R][i];
        cs_window_stages_add(R, by_force, seen, ny, p, ny);
        cs_window_stages_times(by_output, arg[OF_N], arg[OF_Q], ny, nx, nx);
        cs_window_stages_add(R, by_output, arg[OF_N], ny, nx, ny);

        /* 2. outputs: by the first state, by forces, and their covariance with what came before */
        for (int j = 0; j < nx; ++j) {
            real *O = res[TO_O] + k * ny + j * m;
            for (int i = 0; i < ny; ++i) O[i] = 0;
            cs_window_product(O, 1, C, ny, powers + (k * nx + j) * nx, 1, ny, nx);
        }
        for (int j = 0; j < d && j < (k + 1) * p; ++j) {
            real *G = res[TO_G] + k * ny + (long)j * m;
            cs_window_product(G, 1, C, ny, moved + ((long)k * d + j) * nx, 1, ny, nx);
            if (j / p == k) cs_window_add(G, 1, F + (j % p) * ny, ny);
        }
        for (int j = 0; j < k * ny; ++j) { /* the state's covariance with outputs before, as rows */
            real *S = res[TO_S0] + k * ny + (long)j * m;
            for (int i = 0; i < ny; ++i) S[i] = 0;
            cs_window_product(S, 1, C, ny, cross + j + (long)k * nx * m, m, ny, nx);
            for (int i = 0; i < ny; ++i) res[TO_S0][j + (long)(k * ny + i) * m] = S[i];
        }
        cs_window_stages_times(by_output, C, Pk, ny, nx, nx);
        for (int j = 0; j < ny; ++j) {
            real *S = res[TO_S0] + k * ny + (long)(k * ny + j) * m;
            for (int i = 0; i < ny; ++i) S[i] = R[i + j * ny];
            cs_window_product(S, 1, by_output, ny, C + j, ny, ny, nx);
        }

        /* 3. the next state: by the first one, by forces, its covariance with all outputs so far */
        for (int j = 0; j < nx; ++j) {
            real *next = powers + ((k + 1) * nx + j) * nx;
            for (int i = 0; i < nx; ++i) next[i] = 0;
            cs_window_product(next, 1, A, nx, powers + (k * nx + j) * nx, 1, nx, nx);
        }
        for (int j = 0; j < d && j < k * p; ++j)
            cs_window_product(moved + ((long)(k + 1) * d + j) * nx, 1, A, nx,
                              moved + ((long)k * d + j) * nx, 1, nx, nx);
        for (int j = k * p; j < d && j < (k + 1) * p; ++j)
            cs_window_add(moved + ((long)(k + 1) * d + j) * nx, 1, E + (j - k * p) * nx, nx);
        for (int a = 0; a < nx; ++a)
            cs_window_product(cross + ((long)(k + 1) * nx + a) * m, 1, cross + (long)k * nx * m, m, A + a,
                              nx, k * ny, nx);
        cs_window_stages_times(by_state, A, Pk, nx, nx, nx);
        for (int j = 0; j < ny; ++j) {
            real *with = by_force; /* A P C' + M, a column of it */
            for (int i = 0; i < nx; ++i) with[i] = M[i + j * nx];
            cs_window_product(with, 1, by_state, nx, C + j, ny, nx, nx);
            for (int i = 0; i < nx; ++i) cross[k * ny + j + ((long)(k + 1) * nx + i) * m] = with[i];
        }
        for (int i = 0; i < nx * nx; ++i) Pn[i] = Qk[i];
        cs_window_stages_add(Pn, by_state, A, nx, nx, nx);
    }
    /* 4. covariances of the states of interest with outputs after them: C_i A_{i-1} ... A_k P_k */
    const int newest = N - absent, lag = sizes[5], shown = newest > lag ? newest - lag : 0;
    for (int k = 0; k <= N; ++k) {
        if (k != 1 && k != shown) continue;
        real *ahead = by_state, *next = Qk;
        for (int i = 0; i < nx * nx; ++i) ahead[i] = P[k * nx * nx + i];
        for (int i = k; i <= N; ++i) {
            const int from = i + absent < N ? i + absent : N;
            const real *C = arg[OF_C] + from * ny * nx;
            for (int j = 0; j < nx; ++j)
                cs_window_product(cross + i * ny + ((long)k * nx + j) * m, 1, C, ny, ahead + j * nx, 1,
                                  ny, nx);
            cs_window_stages_times(next, arg[OF_A] + from * nx * nx, ahead, nx, nx, nx);
            for (int j = 0; j < nx * nx; ++j) ahead[j] = next[j];
        }
    }
}
