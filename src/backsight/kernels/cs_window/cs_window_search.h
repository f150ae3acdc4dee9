/* Feature-sign search among the atoms of a window. */
#ifndef CS_WINDOW_SEARCH_H
#define CS_WINDOW_SEARCH_H

#include "cs_window_active.h"

enum { DONE, NOT_CONVERGED, DEPENDENT };


/* The first state given the atoms, x0 = X' (xi of no atoms - sum of w a); w takes nx numbers. */
static void cs_window_first(const cs_window_active *A, real *x0, real *w)
{
    const int nx = A->nx;
    for (int i = 0; i < nx; ++i) w[i] = A->right[i];
    cs_window_product(w, -1, A->L + nx * A->stride, A->stride, A->a, 1, nx, A->count);
    for (int i = 0; i < nx; ++i) x0[i] = cs_window_dot(A->X + i * nx, w, nx);
}

/* u = the rows of v - J [x0; f] from `from` on. */
static void cs_window_explain(const cs_window_tables *tab, const cs_window_active *A, const real *v,
                              const real *x0, int from, int rows, real *u)
{
    for (int i = 0; i < rows; ++i) u[i] = v[from + i];
    cs_window_product(u, -1, tab->J + from, tab->rows, x0, 1, rows, A->nx);
    cs_window_product(u, -1, A->effect + from, tab->rows, A->a, 1, rows, A->count);
}

/* Correlation of all columns with what is given for the modal forces. */
static void cs_window_gradients(const cs_window_sizes *z, const cs_window_prior *prior,
                                const real *modal, real *g)
{
    const int atoms = z->atoms, whole = z->width * z->p;
    for (int j = 0; j < z->steps; ++j) {
        const int left = z->d - j * z->p, length = left < whole ? left : whole;
        cs_window_applied(g + j * atoms, prior->across, atoms, modal + j * z->p, atoms, length);
    }
}

/* The column that violates its condition most, by how much, and to which side; -1 if none does. */
static int cs_window_violated(const cs_window_sizes *z, const cs_window_prior *prior, const real *g,
                              const int *shut, real *restrict excess, real *worst,
                              real *sign)
{
    int column = -1;
    for (int i = 0; i < z->n; ++i) {
        const real slope = 2 * (g[i] + prior->q[i] * prior->c[i]), side = prior->side[i];
        excess[i] = (side == 0 ? real_fabs(slope) : side * slope) - prior->lam[i];
    }
    for (int i = 0; i < z->n; ++i) {
        if (!(excess[i] > *worst) || shut[i]) continue;
        *worst = excess[i];
        column = i;
    }
    if (column >= 0) *sign = g[column] + prior->q[column] * prior->c[column] > 0 ? 1 : -1;
    return column;
}

/* The weight from which on no atom would be found; w takes n numbers. Four maxima side by side: one
   alone would wait for every comparison. */
static real cs_window_strongest(const cs_window_sizes *z, const cs_window_prior *prior,
                                const real *g, real *restrict w)
{
    real most[4] = {0, 0, 0, 0};
    for (int i = 0; i < z->n; ++i) {
        const real side = prior->side[i];
        w[i] = 2 * (side == 0 ? real_fabs(g[i]) : side * g[i]);
    }
    int i = 0;
    for (; i + 4 <= z->n; i += 4)
        for (int k = 0; k < 4; ++k) most[k] = w[i + k] > most[k] ? w[i + k] : most[k];
    for (; i < z->n; ++i) most[0] = w[i] > most[0] ? w[i] : most[0];
    for (int k = 1; k < 4; ++k) most[0] = most[k] > most[0] ? most[k] : most[0];
    return most[0];
}

/* Start from what is certainly active, and from the atoms of the last window, but not from those that
   are held at a limit; 0 if there is no room for all that is certain. */
static int cs_window_start(const cs_window_sizes *z, const cs_window_tables *tab,
                           const cs_window_prior *prior, const real *v, const real *warm,
                           const int *held, cs_window_active *A, int *shut)
{
    int complete = 1;
    for (int i = 0; i < z->n; ++i) shut[i] = held[i] != 0;
    for (int i = 0; i < z->n && z->carries; ++i)
        if (prior->extra_q[i] > 0 && !held[z->n + i])
            complete &= cs_window_append(z, tab, prior, A, v, z->n + i, prior->extra_c[i], 0);
    for (int i = 0; i < z->n; ++i) {
        const real a = warm[i], side = prior->side[i];
        if (a == 0 && prior->lam[i] > 0) continue; /* most of them */
        if (held[i]) continue;
        const int kinked = prior->lam[i] > 0 || side != 0;
        const int use = kinked ? a != 0 && side * a >= 0 : prior->q[i] > 0;
        if (use) shut[i] = cs_window_append(z, tab, prior, A, v, i, a, a > 0 ? 1 : -1);
        complete &= kinked || !use || shut[i];
    }
    return complete;
}

/* Make a column active; if it depends on the active ones, it takes the place of one of them. */
static int cs_window_enter(const cs_window_sizes *z, const cs_window_tables *tab,
                           const cs_window_prior *prior, cs_window_active *A, const real *v,
                           int column, real sign, int *shut)
{
    const int all = A->nx + A->count;
    shut[column] = 1; /* for good, if it cannot enter */
    if (A->count == A->most) return NOT_CONVERGED;
    if (cs_window_append(z, tab, prior, A, v, column, 0, sign)) return DONE;
    for (int i = 0; i < all; ++i) A->goal[i] = -sign * A->row[i];
    cs_window_backward(A->L, A->stride, A->goal, A->nx, all);
    real length;
    const int at = cs_window_move(z, prior, A, 0, &length);
    if (at < 0) return DEPENDENT;
    shut[A->column[at]] = 0;
    cs_window_remove(tab, A, at);
    const int entered = cs_window_append(z, tab, prior, A, v, column, sign * length, sign);
    return entered ? DONE : DEPENDENT;
}

/* Feature-sign search; the number of steps and a status. The gradients g belong to the result; w
   takes d + n + 2 nx numbers. */
static int cs_window_search(const cs_window_sizes *z, const cs_window_tables *tab,
                            const cs_window_prior *prior, cs_window_active *A, const real *v,
                            real *g, int *shut, real least, int *steps, real *w)
{
    const int nx = z->nx;
    real *excess = w, *gamma = excess + z->n, *x0 = gamma + z->d, *rest = x0 + nx, length, sign;
    int status = DONE, fresh = -1;
    for (*steps = 1; *steps <= z->limit; ++*steps) {
        cs_window_minimise(A);
        const int at = cs_window_move(z, prior, A, 1, &length);
        if (at >= 0) { /* what would leave at once, though it should enter, stays out for good */
            shut[A->column[at]] = A->column[at] == fresh && !(length > 0);
            if (shut[A->column[at]]) status = DEPENDENT;
            cs_window_remove(tab, A, at);
            continue;
        }
        cs_window_first(A, x0, rest);
        cs_window_explain(tab, A, v, x0, nx, z->d, gamma);
        real worst = least;
        cs_window_gradients(z, prior, gamma, g);
        fresh = cs_window_violated(z, prior, g, shut, excess, &worst, &sign);
        if (fresh < 0) return status;
        const int entered = cs_window_enter(z, tab, prior, A, v, fresh, sign, shut);
        if (entered == NOT_CONVERGED) break;
        if (entered == DEPENDENT) status = DEPENDENT;
    }
    cs_window_first(A, x0, rest);
    cs_window_explain(tab, A, v, x0, nx, z->d, gamma);
    cs_window_gradients(z, prior, gamma, g);
    return NOT_CONVERGED;
}

/* The active atoms without the l1 norm: least squares where the others stay zero. An atom of a known
   sign that would pass zero is left out. */
static void cs_window_refit(const cs_window_sizes *z, const cs_window_tables *tab,
                            const cs_window_prior *prior, cs_window_active *A)
{
    const int nx = A->nx;
    real *pull = A->row; /* half the weights of the l1 norm, L^-1 times them is in the right side */
    for (int i = 0; i < nx; ++i) pull[i] = 0;
    for (int k = 0; k < A->count; ++k)
        pull[nx + k] = cs_window_half(z, prior, A->column[k], A->sign[k]);
    cs_window_forward(A->L, A->stride, pull, nx, nx + A->count);
    for (int k = nx; k < nx + A->count; ++k) A->right[k] += pull[k];
    for (int at = 0; at >= 0;) {
        real first = 1;
        cs_window_minimise(A);
        at = -1;
        for (int k = 0; k < A->count && z->sided; ++k) {
            const int column = A->column[k];
            const real side = column < z->n ? prior->side[column] : 0, goal = A->goal[nx + k];
            if (!(side * goal < 0)) continue;
            const real length = A->a[k] / (A->a[k] - goal);
            if (at < 0 || length < first) { first = length; at = k; }
        }
        for (int k = 0; k < A->count; ++k) A->a[k] += first * (A->goal[nx + k] - A->a[k]);
        if (at >= 0) cs_window_remove(tab, A, at);
    }
}

/* Out with the last active atom if what it adds is next to nothing, one in TOLD_APART, beside the sum
   of others that comes closest to it: a deviation made of such a difference has lost as many digits,
   and whether there is a difference must not be decided by rounding. */
#define TOLD_APART ((real)1e6)
static void cs_window_told_apart(cs_window_active *A)
{
    const int s = A->count - 1, last = A->nx + s;
    const real inverse = A->L[last + last * A->stride];
    real size = A->all[s];
    for (int i = 0; i < last; ++i) A->goal[i] = A->row[i];
    cs_window_backward(A->L, A->stride, A->goal, A->nx, last);
    for (int i = 0; i < s; ++i) size += A->goal[A->nx + i] * A->goal[A->nx + i] * A->all[i];
    if (size * inverse * inverse > TOLD_APART) A->count = s;
}

/* Append the atoms that could nearly as well have been chosen: given the data, those whose gradient
   reaches half its bound. What they share with the chosen ones is then not certain. */
static void cs_window_alternatives(const cs_window_sizes *z, const cs_window_tables *tab,
                                   const cs_window_prior *prior, cs_window_active *A,
                                   const real *v, const real *g, const int *active)
{
    for (int i = 0; i < z->n; ++i) {
        const real slope = 2 * (g[i] + prior->q[i] * prior->c[i]), side = prior->side[i];
        const real size = side == 0 ? real_fabs(slope) : side * slope;
        if (active[i] || size < prior->lam[i] / 2) continue;
        if (cs_window_append(z, tab, prior, A, v, i, 0, slope > 0 ? 1 : -1))
            cs_window_told_apart(A);
    }
}

/* Largest violation of the optimality conditions beside the atoms that are held at a limit; w takes n
   numbers. */
static real cs_window_kkt(const cs_window_sizes *z, const cs_window_prior *prior,
                          const cs_window_active *A, const real *g, const int *held, int *shut,
                          real *w)
{
    real worst = 0, sign;
    for (int i = 0; i < z->n; ++i) shut[i] = held[i] != 0;
    for (int i = 0; i < A->count; ++i)
        if (A->column[i] < z->n) shut[A->column[i]] = 1;
    cs_window_violated(z, prior, g, shut, w, &worst, &sign);
    for (int i = 0; i < A->count; ++i) {
        const int k = A->column[i], place = k < z->n ? k : k - z->n;
        const real slope = g[place] + cs_window_pull(z, prior, k, A->a[i]);
        const real off = 2 * real_fabs(slope - cs_window_half(z, prior, k, A->sign[i]));
        if (off > worst) worst = off;
    }
    return worst;
}

#endif
