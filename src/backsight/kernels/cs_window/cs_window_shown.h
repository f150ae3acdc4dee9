/* What is shown of a window: states, forces, and how sure they are. */
#ifndef CS_WINDOW_SHOWN_H
#define CS_WINDOW_SHOWN_H

#include "cs_window_limits.h"

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
static void cs_window_filtered(cs_window_problem *k, real *x, real *P, real *w)
{
    const cs_window_sizes *z = k->z;
    const cs_window_active *A = &k->A;
    const real *const *arg = k->arg;
    const int nx = z->nx, at = 1, known = nx + z->p, rows = known + nx, s = A->count;
    real *X = w + cs_window_tables_size(nx, z->p, z->outputs, 1), *v = X + nx * nx, *x0 = v + rows;
    real *lead = x0 + nx, *effect = lead + nx * s, *rest = effect + rows * s;
    cs_window_number(&k->counting, z->outputs);
    const cs_window_tables tab = cs_window_prepare(z, arg, &k->counting, z->p, &at, 1, w);
    cs_window_posterior(arg[ARG_PA], tab.J, rows, X, nx, rest);
    for (int i = 0; i < rows; ++i) v[i] = 0;
    for (int i = 0; i < tab.m; ++i) rest[i] = k->r[k->counting.used[i]];
    cs_window_forward(tab.L, tab.m, rest, 0, tab.m);
    cs_window_product(v, 1, tab.W, rows, rest, 1, rows, tab.m);
    for (int i = 0; i < z->columns && z->bounded; ++i) /* what a held atom does in the first step */
        if (k->held[i] && i % z->n < z->atoms)
            cs_window_product(v, -k->at_limit[i], tab.J + nx * rows, rows,
                              k->prior.atoms + i % z->n * z->width * z->p, 1, rows, z->p);
    for (int i = 0; i < s; ++i) { /* what an atom does in the first step */
        real *own = effect + i * rows;
        const int length = cs_window_length(z, A, i, z->p);
        for (int j = 0; j < rows; ++j) own[j] = 0;
        for (int j = 0; j < nx; ++j) lead[j + i * nx] = 0;
        cs_window_product(own, 1, tab.J + (nx + A->start[i]) * rows, rows,
                          cs_window_values(z, &k->prior, A, i), 1, rows, length);
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

#endif
