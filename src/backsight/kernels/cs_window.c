/* One window of the compressive-sensing moving horizon estimator.

   With f the modal forces of all steps of the window, f = sum of the active atoms,

       r = O dx + G f + noise,   dx ~ (0, Pa),   noise ~ (0, S0),

   the atoms' factors a minimise, together with dx,

       (r - O dx - G f)' S0^-1 (r - O dx - G f) + dx' Pa^-1 dx + sum q (a - c)^2 + sum lam |a|.

   Nothing of the size of S0 is factorised where all samples were measured. The method is
   feature-sign search (Lee et al. 2007), started from the last window's atoms, with steps in the
   null space where atoms become dependent, and is exact.

   Matrices are stored column by column.

   Lee, Battle, Raina, Ng, "Efficient sparse coding algorithms", 2007. */

#include "kernels.h"

#include "cs_window_search.h"

enum {
    RES_ALPHA, RES_EXTRA, RES_VARIANCE, RES_X, RES_COVARIANCE, RES_FORCES, RES_INFO
};
enum { OPTION_THRESHOLD, OPTION_TOLERANCE, OPTION_LAG, OPTION_REFIT };

/* Covariances P of the states in the rows of the tables from `from` on, given X, and for each
   active atom its effect and its w, `each` and `apart` numbers from those of the next one. */
static void cs_window_covariances(const cs_window_tables *tab, const cs_window_active *A, int from,
                                  const real *X, const real *effect, int each, const real *lead,
                                  int apart, real *P, real *w)
{
    const int nx = tab->nx, s = A->count, known = nx + tab->d, rows = tab->rows - from;
    const int high = tab->rows - known;
    real *D = w; /* -Phi X', and then what each atom adds to the states, whitened */
    for (int i = 0; i < rows * nx; ++i) D[i] = 0;
    for (int j = 0; j < nx; ++j)
        cs_window_product(D + j * rows, 1, tab->J + from, tab->rows, X + j, nx, rows, nx);
    for (int i = 0; i < s; ++i) {
        const real *row = A->L + (nx + i) * A->stride, scale = row[nx + i];
        real *own = D + (nx + i) * rows;
        for (int k = 0; k < rows; ++k) own[k] = effect[from + k + i * each];
        cs_window_product(own, -1, D, rows, lead + i * apart, 1, rows, nx);
        cs_window_product(own, -1, D + nx * rows, rows, row + nx, 1, rows, i);
        for (int k = 0; k < rows; ++k) own[k] *= scale;
    }
    for (int q = 0; q < rows; q += nx, P += nx * nx)
        for (int j = 0; j < nx; ++j) {
            real *column = P + j * nx;
            for (int i = j; i < nx; ++i) column[i] = tab->V[from - known + q + i + j * high];
            cs_window_product(column + j, 1, D + q + j, rows, D + q + j, rows, nx - j, nx + s);
            for (int i = j; i < nx; ++i) P[j + i * nx] = column[i];
        }
}

/* The first state of the next window from this window's first sample alone. */
static void cs_window_filtered(const cs_window_sizes *z, const real *const *arg, const real *mask,
                               const real *r, const cs_window_prior *prior,
                               const cs_window_active *A, real *x, real *P, real *w)
{
    const int nx = z->nx, at = 1, known = nx + z->p, rows = known + nx, s = A->count;
    real *X = w + cs_window_tables_size(nx, z->p, z->ny, 1), *v = X + nx * nx, *x0 = v + rows;
    real *lead = x0 + nx, *effect = lead + nx * s, *rest = effect + rows * s;
    const cs_window_tables tab = cs_window_prepare(z, arg, mask, z->ny, z->p, &at, 1, w);
    cs_window_posterior(arg[ARG_PA], tab.J, rows, X, nx, rest);
    for (int i = 0; i < rows; ++i) v[i] = 0;
    cs_window_product(v, 1, tab.W, rows, r, 1, rows, z->ny);
    for (int i = 0; i < s; ++i) { /* what an atom does in the first step */
        real *own = effect + i * rows;
        const int length = cs_window_length(z, A, i, z->p);
        for (int k = 0; k < rows; ++k) own[k] = 0;
        for (int k = 0; k < nx; ++k) lead[k + i * nx] = 0;
        cs_window_product(own, 1, tab.J + (nx + A->start[i]) * rows, rows,
                          cs_window_values(z, prior, A, i), 1, rows, length);
        cs_window_product(lead + i * nx, 1, X, nx, own, 1, nx, length > 0 ? nx : 0);
    }
    cs_window_product(v, -1, effect, rows, A->a, 1, rows, s);
    for (int i = 0; i < nx; ++i) rest[i] = 0;
    cs_window_product(rest, 1, X, nx, v, 1, nx, nx);
    for (int i = 0; i < nx; ++i) x0[i] = cs_window_dot(X + i * nx, rest, nx);
    for (int i = 0; i < nx; ++i) x[i] = v[known + i];
    cs_window_product(x, -1, tab.J + known, rows, x0, 1, nx, nx);
    cs_window_covariances(&tab, A, known, X, effect, rows, lead, nx, P, rest);
}

/* Variances of all atoms, from the inverse of their factor; w takes `most` squared numbers. */
static void cs_window_variances(const cs_window_sizes *z, const cs_window_active *A, real *variance,
                                real *w)
{
    const int s = A->count, nx = A->nx, most = A->most;
    real *sum = A->goal;
    for (int i = 0; i < s; ++i) sum[i] = 0;
    for (int i = 0; i < s; ++i) { /* a row of the inverse as a column */
        const real *row = A->L + nx + (nx + i) * A->stride;
        real *own = w + i * most;
        for (int k = 0; k < s; ++k) own[k] = (real)(k == i);
        cs_window_product(own, -1, w, most, row, 1, i, i);
        for (int k = 0; k <= i; ++k) {
            own[k] *= row[i];
            sum[k] += own[k] * own[k];
        }
    }
    for (int j = 0; j < s; ++j) variance[A->column[j] % z->n] += sum[j];
    for (int j = 0; j < s; ++j) /* both parts of an atom are active: add their covariance twice */
        for (int i = 0; i < j; ++i) {
            const int apart = A->column[i] - A->column[j];
            if (apart != z->n && apart != -z->n) continue;
            real both = 0;
            for (int k = j; k < s; ++k) both += w[i + k * most] * w[j + k * most];
            variance[A->column[j] % z->n] += 2 * both;
        }
}

/* Forces over the step `at`: of the atoms above the threshold, corrected, and as they are; given the
   factors of the atoms, and those that the threshold judges. */
static void cs_window_forces(const cs_window_sizes *z, const real *Psi, const real *factor_of,
                             const real *judged, real threshold, int at, real *forces)
{
    const int nf = z->forces;
    real kept = 0, lost = 0, factor = 1;
    for (int i = 0; i < z->n && z->correction; ++i) {
        const real size = real_fabs(factor_of[i]), part = z->correction == 2 ? size * size : size;
        if (real_fabs(judged[i]) >= threshold) kept += part; else lost += part;
    }
    if (z->correction && kept > 0) factor = 1 + lost / kept;
    if (z->correction == 2) factor = real_sqrt(factor);
    for (int i = 0; i < 2 * nf; ++i) forces[i] = 0;
    for (int since = 0; since < z->width; ++since) {
        const int j = at - since;
        if (j < 0 || j >= z->steps) continue;
        for (int a = 0; a < z->atoms; ++a) {
            const real total = factor_of[a + j * z->atoms];
            const real *shape = Psi + (a * z->width + since) * nf;
            if (total == 0) continue;
            if (real_fabs(judged[a + j * z->atoms]) >= threshold)
                cs_window_add(forces, factor * total, shape, nf);
            cs_window_add(forces + nf, total, shape, nf);
        }
    }
}

/* Variances of the forces over the step `at`. */
static void cs_window_spread(const cs_window_sizes *z, const cs_window_active *A, const real *Psi,
                             int at, real *variance)
{
    for (int f = 0; f < z->forces; ++f) {
        real *v = A->goal + A->nx;
        int first = A->count;
        for (int i = A->count - 1; i >= 0; --i) {
            const int since = at * z->p - A->start[i];
            const int acts = since >= 0 && since < z->width * z->p;
            v[i] = acts ? Psi[f + (A->which[i] * z->width + since / z->p) * z->forces] : 0;
            if (v[i] != 0) first = i;
        }
        cs_window_forward(A->L, A->stride, A->goal, A->nx + first, A->nx + A->count);
        variance[f] = cs_window_dot(v + first, v + first, A->count - first);
    }
}

KERNEL void cs_window_work(const int *sizes, long *reals, long *ints)
{
    const cs_window_sizes z = cs_window_read(sizes);
    const long nx = z.nx, d = z.d, m = z.m, most = z.most, rows = nx + d + PLACES * nx;
    const long filtered = cs_window_tables_size(nx, z.p, z.ny, 1) + nx * nx + 3 * nx + z.p
                          + (3 * nx + z.p) * most;
    const long covariances = PLACES * nx * (nx + most), inverse = most * most;
    *reals = cs_window_active_size(&z) + nx * nx + rows + 2 * m + 4 * z.n + d + z.forces + 2 * nx
             + cs_window_tables_size(nx, d, m, PLACES) + filtered + covariances + inverse
             + 3 * nx * nx + nx;
    *ints = 3 * z.most + z.n;
}

KERNEL void cs_window(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const cs_window_sizes z = cs_window_read(sizes);
    const int nx = z.nx, m = z.m, known = nx + z.d, rows = known + PLACES * nx;
    const int absent = (int)arg[ARG_ABSENT][0];
    const real *options = arg[ARG_OPTIONS];
    const cs_window_prior prior = {arg[ARG_ATOMS], arg[ARG_ACROSS],  arg[ARG_LAM],
                                   arg[ARG_Q],     arg[ARG_C],       arg[ARG_EXTRA_Q],
                                   arg[ARG_EXTRA_C], arg[ARG_SIDE]};
    cs_window_active A = cs_window_room(&z, w, iw);
    int *shut = iw + 3 * z.most;
    real *X = w + cs_window_active_size(&z), *v = X + nx * nx, *r = v + rows, *mask = r + m;
    real *g = mask + m, *x0 = g + z.n, *rest = x0 + nx;

    /* A window that is not full yet: its samples first, the coming ones not measured. */
    int complete = absent == 0;
    for (int i = 0; i < m; ++i) {
        const int from = i + absent * z.ny;
        mask[i] = from < m ? arg[ARG_MASK][from] : 0;
        r[i] = from < m && mask[i] != 0 ? arg[ARG_R][from] : 0;
        if (mask[i] != 1) complete = 0;
    }
    const int lag = (int)options[OPTION_LAG], newest = z.N - absent;
    const int at[PLACES] = {1, newest > lag ? newest - lag : 0, newest + 1};
    cs_window_tables tab = {nx, z.d, m, rows, arg[ARG_W], arg[ARG_J], arg[ARG_V]};
    if (!complete) {
        tab = cs_window_prepare(&z, arg, mask, m, z.d, at, PLACES, rest);
        rest += cs_window_tables_size(nx, z.d, m, PLACES);
    }
    const int free = z.arrival == ARRIVAL_NONE && !absent;
    const int unobserved = free && !cs_window_unknown(tab.J, rows, X, nx, rest);
    if (!free || unobserved) cs_window_posterior(arg[ARG_PA], tab.J, rows, X, nx, rest);
    A.X = X;
    for (int i = 0; i < rows; ++i) v[i] = 0;
    cs_window_product(v, 1, tab.W, rows, r, 1, rows, m);
    for (int i = 0; i < nx; ++i) A.right[i] = 0;
    cs_window_product(A.right, 1, X, nx, v, 1, nx, nx);

    int steps;
    cs_window_first(&A, x0, rest);
    cs_window_explain(&tab, &A, v, x0, nx, z.d, rest);
    cs_window_gradients(&z, &prior, rest, g);
    const real strongest = cs_window_strongest(&z, &prior, g);
    const real rounding = 16 * real_epsilon * strongest, asked = options[OPTION_TOLERANCE];
    const int room = cs_window_start(&z, &tab, &prior, v, arg[ARG_WARM], &A, shut);
    const int status = cs_window_search(&z, &tab, &prior, &A, v, g, shut,
                                        asked > rounding ? asked : rounding, &steps, rest);

    const int own = z.arrival == ARRIVAL_FILTERED || z.arrival == ARRIVAL_NONE;
    real *info = res[RES_INFO], *x = res[RES_X], *P = res[RES_COVARIANCE];
    for (int k = RES_ALPHA; k <= RES_VARIANCE; ++k)
        for (int i = 0; i < z.n; ++i) res[k][i] = 0;
    for (int i = 0; i < A.count; ++i)
        res[A.column[i] < z.n ? RES_ALPHA : RES_EXTRA][A.column[i] % z.n] = A.a[i];
    if (z.carries) cs_window_variances(&z, &A, res[RES_VARIANCE], rest);
    if (own) cs_window_filtered(&z, arg, mask, r, &prior, &A, x, P, rest);
    const int from = known + own * nx;
    cs_window_first(&A, x0, rest);
    cs_window_explain(&tab, &A, v, x0, from, rows - from, x + own * nx);
    cs_window_covariances(&tab, &A, from, X, A.effect, rows, A.L + nx * A.stride, A.stride,
                          P + own * nx * nx, rest);
    info[1] = cs_window_kkt(&z, &prior, &A, g, shut, rest);
    const int shown = at[AT_OUTPUT];
    const real threshold = options[OPTION_THRESHOLD];
    real *forces = res[RES_FORCES], *spread = forces + 2 * z.forces, *found = rest;
    for (int i = 0; i < z.n; ++i) found[i] = res[RES_ALPHA][i] + res[RES_EXTRA][i];
    cs_window_forces(&z, arg[ARG_PSI], found, found, threshold, shown, forces);
    cs_window_spread(&z, &A, arg[ARG_PSI], shown, spread);
    if (options[OPTION_REFIT] != 0) { /* what is shown; the next window starts from the optimum */
        real *fitted = found + z.n, *biased = fitted + z.n;
        for (int f = 0; f < z.forces; ++f) biased[f] = forces[z.forces + f];
        cs_window_refit(&z, &tab, &prior, &A);
        for (int i = 0; i < z.n; ++i) fitted[i] = 0;
        for (int i = 0; i < A.count; ++i) fitted[A.column[i] % z.n] += A.a[i];
        cs_window_forces(&z, arg[ARG_PSI], fitted, found, threshold, shown, forces);
        real *shift = biased + z.forces, *both = shift + 2 * nx, *room_left = both + 2 * nx * nx;
        const int output = known + nx; /* and behind it the state after the window */
        cs_window_first(&A, x0, room_left);
        cs_window_explain(&tab, &A, v, x0, output, rows - output, shift);
        cs_window_alternatives(&z, &tab, &prior, &A, v, g, shut);
        cs_window_spread(&z, &A, arg[ARG_PSI], shown, spread);
        cs_window_covariances(&tab, &A, output, X, A.effect, rows, A.L + nx * A.stride, A.stride,
                              both, room_left);
        for (int i = 0; i < nx; ++i) shift[i] -= x[nx + i];
        for (int i = 0; i < nx; ++i)
            for (int j = 0; j < nx; ++j)
                P[nx * nx + i + j * nx] = both[i + j * nx] + shift[i] * shift[j];
        for (int f = 0; f < z.forces; ++f) { /* the l1 norm could hide as much */
            const real bias = forces[z.forces + f] - biased[f];
            spread[f] += bias * bias;
        }
    }
    int nonzeros = 0;
    for (int i = 0; i < z.n; ++i) nonzeros += res[RES_ALPHA][i] + res[RES_EXTRA][i] != 0;
    info[0] = (real)(room ? status : NOT_CONVERGED);
    info[2] = (real)steps;
    info[3] = (real)nonzeros;
    info[4] = strongest;
    info[5] = (real)unobserved;
}
