/* What comes after the l1 norm: weights that shrink, and the number of atoms in place of their sizes.

   Candes, Wakin, Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008; Miller, "Subset
   Selection in Regression", 2002, section 3.6 (exchanges). */
#ifndef CS_WINDOW_CHOICE_H
#define CS_WINDOW_CHOICE_H

#include "cs_window_candidates.h"

#define LESS ((real)1e-9) /* a change must lower the cost by this share of the price of an atom */

/* Sizes of the groups of atoms, at the place of every atom; w takes n numbers. */
static void cs_window_groups(const cs_window_sizes *z, const real *group, const real *alpha,
                             real *size, real *w)
{
    for (int i = 0; i < z->n; ++i) w[i] = 0;
    for (int i = 0; i < z->n; ++i) w[(int)group[i]] += alpha[i] * alpha[i];
    for (int i = 0; i < z->n; ++i) size[i] = real_sqrt(w[(int)group[i]]);
}

/* The l1 norm again and again, with the weights lam f / (f + size) of the last pass, f a share of the
   largest size of the first; a status. `weights` takes 3 n numbers and holds the last weights. */
static int cs_window_reweighted(cs_window_problem *k, real *alpha, real *extra, real *weights,
                                int before, int *steps)
{
    const cs_window_sizes *z = k->z;
    int status = before;
    const real *lam = k->prior.lam, *group = k->arg[ARG_GROUP];
    real *size = weights + z->n, *space = size + z->n, floor = 0;
    int reached = status;
    for (int pass = 0; pass < z->passes && k->A.count > 0; ++pass) {
        cs_window_groups(z, group, alpha, size, space);
        for (int i = 0; i < z->n && pass == 0; ++i) floor = real_fmax(floor, size[i]);
        const real f = k->arg[ARG_OPTIONS][OPTION_FLOOR] * floor;
        for (int i = 0; i < z->n; ++i) weights[i] = lam[i] * (f / (f + size[i]));
        k->prior.lam = weights;
        k->A.count = 0;
        reached = cs_window_optimum(k, alpha, steps);
        cs_window_factors(k, alpha, extra);
    }
    return reached;
}

/* What the chosen atoms lower the cost by, less what they cost. */
static real cs_window_worth(const cs_window_candidates *t, real price)
{
    return cs_window_dot(t->y, t->y, t->count) - price * (real)t->count;
}

/* Put an atom in the place of the first chosen one, in turn, for which that betters the cost; 0 if there
   is none. */
static int cs_window_exchange(const cs_window_problem *k, cs_window_candidates *t, real price)
{
    const int n = k->z->n, count = t->count;
    for (int j = 0; j < count; ++j) {
        real gain;
        const int column = t->column[j];
        const real a = t->a[j], variance = cs_window_shared(t, n, j);
        const int in = cs_window_better(k, t, a, variance, &gain);
        if (in < 0 || in == column || !(gain > a * a / variance + price * LESS)) continue;
        for (int before = 0; before <= j; ++before) cs_window_put_last(t, n, 0);
        cs_window_refactor(t, n, count - 1);
        if (cs_window_choose(k, t, in)) return 1;
        cs_window_take(k, t, column);
        for (int after = j + 1; after < count; ++after) cs_window_put_last(t, n, 0);
        cs_window_refactor(t, n, count);
        cs_window_settle(t);
    }
    return 0;
}

/* The chosen atom that is worth least, if that is less than its price; else -1. */
static int cs_window_least(const cs_window_candidates *t, real price)
{
    real least = price * (1 - LESS);
    int out = -1;
    for (int j = 0; j < t->count; ++j) {
        real variance = 0;
        for (int s = j; s < t->count; ++s) variance += t->M[j + s * t->room] * t->M[j + s * t->room];
        const real worth = t->a[j] * t->a[j] / variance;
        if (!(worth < least)) continue;
        least = worth;
        out = j;
    }
    return out;
}

/* Add, exchange and take out atoms one by one as long as that lowers cost + price count; 0 if there
   were too many changes. */
static int cs_window_exchanged(const cs_window_problem *k, cs_window_candidates *t, real price,
                               int *steps)
{
    for (int change = 0; change < CHANGES * t->room + 1; ++change, ++*steps) {
        cs_window_settle(t);
        const int out = cs_window_least(t, price);
        if (out >= 0) { /* one that is not worth its price */
            cs_window_put_last(t, k->z->n, out);
            cs_window_refactor(t, k->z->n, t->count - 1);
            continue;
        }
        if (t->count < t->room) {
            real gain;
            const int in = cs_window_best(k, t, &gain);
            if (in >= 0 && gain > price * (1 + LESS) && cs_window_choose(k, t, in)) continue;
        }
        if (!cs_window_exchange(k, t, price)) return 1;
    }
    return 0;
}

/* Few atoms that explain most: the search from those of the l1 norm, and from none, whichever is
   better; a status. Nothing in the least squares has an l1 norm then: `none` takes n zeros. `best`
   takes as many numbers as may be active. */
static int cs_window_chosen(cs_window_problem *k, cs_window_candidates *t, real *none, int *best,
                            real *alpha, real *extra, int *steps)
{
    const cs_window_sizes *z = k->z;
    cs_window_active *A = &k->A;
    const real price = k->arg[ARG_OPTIONS][OPTION_PRICE];
    int count = 0, complete = 1;
    real most = 0;
    for (int i = 0; i < z->n; ++i) none[i] = 0;
    k->prior.lam = none;
    for (int from = 0; from < 2; ++from) {
        cs_window_refactor(t, z->n, 0);
        for (int i = 0; i < z->n && from == 0; ++i)
            if (alpha[i] != 0 && t->count < t->room) cs_window_choose(k, t, i);
        complete &= cs_window_exchanged(k, t, price, steps);
        const real worth = cs_window_worth(t, price);
        if (from > 0 && !(worth > most + price * LESS)) continue;
        most = worth;
        count = t->count;
        for (int i = 0; i < count; ++i) best[i] = t->column[i];
    }
    A->count = 0;
    for (int i = 0; i < count; ++i)
        cs_window_append(z, &k->tab, &k->prior, A, k->v, best[i], 0, 1);
    cs_window_minimise(A);
    for (int i = 0; i < A->count; ++i) {
        A->a[i] = A->goal[A->nx + i];
        A->sign[i] = A->a[i] > 0 ? 1 : -1;
    }
    cs_window_factors(k, alpha, extra);
    return complete ? DONE : NOT_CONVERGED;
}

/* Append the atoms that could nearly as well have been chosen: in place of one that was, they would
   raise the cost by less than the price of one. `doubt` takes n numbers. */
static void cs_window_doubtful(cs_window_problem *k, cs_window_candidates *t, int *doubt)
{
    const int n = k->z->n;
    cs_window_active *A = &k->A;
    const real price = k->arg[ARG_OPTIONS][OPTION_PRICE];
    for (int i = 0; i < n; ++i) doubt[i] = 0;
    cs_window_refactor(t, n, 0);
    for (int j = 0; j < A->count; ++j) cs_window_take(k, t, A->column[j]);
    cs_window_settle(t);
    for (int j = 0; j < t->count; ++j) {
        const real a = t->a[j], variance = cs_window_shared(t, n, j), left = a * a / variance - price;
        for (int i = 0; i < n; ++i) {
            const real part = t->share[i] / variance;
            doubt[i] |= cs_window_gains(k, t, i, t->slope[i] + part * a,
                                        t->left[i] + part * t->share[i], real_fmax(left, 0));
        }
    }
    for (int i = 0; i < A->count; ++i) doubt[A->column[i]] = 0;
    for (int i = 0; i < n; ++i)
        if (doubt[i] && cs_window_append(k->z, &k->tab, &k->prior, A, k->v, i, 0, 1))
            cs_window_told_apart(A);
}

#endif
