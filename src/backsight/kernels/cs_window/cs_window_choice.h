/* What comes after the l1 norm: weights that shrink, and the number of atoms in place of their sizes.

   Candes, Wakin, Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008; Miller, "Subset
   Selection in Regression", 2002, section 3.6 (exchanges). */
#ifndef CS_WINDOW_CHOICE_H
#define CS_WINDOW_CHOICE_H

#include "cs_window_problem.h"

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
static real cs_window_worth(const cs_window_active *A, real price)
{
    return cs_window_dot(A->right, A->right, A->nx + A->count) - price * (real)A->count;
}

/* Variance of a chosen atom, the others free. */
static real cs_window_variance(const cs_window_active *A, int at)
{
    real *v = A->goal;
    const int first = A->nx + at, last = A->nx + A->count;
    for (int i = first; i < last; ++i) v[i] = (real)(i == first);
    cs_window_forward(A->L, A->stride, v, first, last);
    return cs_window_dot(v + first, v + first, last - first);
}

/* By how much an atom beside the chosen ones lowers the cost; 0 if its sign is not allowed or it
   depends on them. */
static real cs_window_gain(cs_window_problem *k, int column)
{
    cs_window_active *A = &k->A;
    if (k->held[column] || !cs_window_append(k->z, &k->tab, &k->prior, A, k->v, column, 0, 1)) return 0;
    const real gained = A->right[A->nx + --A->count];
    return k->prior.side[column] * gained < 0 ? 0 : gained * gained;
}

/* The atom that lowers the cost most beside the chosen ones, and by how much; -1 if none does. */
static int cs_window_best(cs_window_problem *k, real *gain)
{
    int best = -1;
    *gain = 0;
    for (int i = 0; i < k->z->n && k->A.count < k->A.most; ++i) {
        const real gained = cs_window_gain(k, i);
        if (!(gained > *gain)) continue;
        *gain = gained;
        best = i;
    }
    return best;
}

/* Choose an atom; 0, and all is as before, if one of a known sign would change it. */
static int cs_window_choose(cs_window_problem *k, int column)
{
    cs_window_active *A = &k->A;
    if (!cs_window_append(k->z, &k->tab, &k->prior, A, k->v, column, 0, 1)) return 0;
    cs_window_minimise(A);
    for (int i = 0; i < A->count && k->z->sided; ++i)
        if (k->prior.side[A->column[i]] * A->goal[A->nx + i] < 0) return --A->count, 0;
    return 1;
}

/* Add, exchange and take out atoms one by one as long as that lowers cost + price count; 0 if there
   were too many changes. */
static int cs_window_exchanged(cs_window_problem *k, real price, int *steps)
{
    cs_window_active *A = &k->A;
    const int room = k->z->chosen < A->most ? k->z->chosen : A->most;
    for (int change = 0; change < CHANGES * room + 1; ++change, ++*steps) {
        real least = price * (1 - LESS), gain;
        int out = -1;
        cs_window_minimise(A);
        for (int i = 0; i < A->count; ++i) A->a[i] = A->goal[A->nx + i];
        for (int i = 0; i < A->count; ++i) {
            const real worth = A->a[i] * A->a[i] / cs_window_variance(A, i);
            if (!(worth < least)) continue;
            least = worth;
            out = i;
        }
        if (out >= 0) { /* one that is not worth its price */
            cs_window_remove(&k->tab, A, out);
            continue;
        }
        if (A->count < room) {
            const int in = cs_window_best(k, &gain);
            if (in >= 0 && gain > price * (1 + LESS) && cs_window_choose(k, in)) continue;
        }
        int better = 0;
        for (int i = 0, count = A->count; i < count && !better; ++i) { /* the first of them, in turn */
            const int column = A->column[0];
            const real before = cs_window_worth(A, 0);
            cs_window_remove(&k->tab, A, 0);
            const int in = cs_window_best(k, &gain);
            better = in >= 0 && in != column
                     && cs_window_worth(A, 0) + gain > before + price * LESS
                     && cs_window_choose(k, in);
            if (!better) cs_window_append(k->z, &k->tab, &k->prior, A, k->v, column, 0, 1);
        }
        if (!better) return 1;
    }
    return 0;
}

/* Few atoms that explain most: the search from those of the l1 norm, and from none, whichever is
   better; a status. Nothing in the least squares has an l1 norm then: `none` takes n zeros. `best`
   takes as many numbers as may be active. */
static int cs_window_chosen(cs_window_problem *k, real *none, int *best, real *alpha, real *extra,
                            int *steps)
{
    const cs_window_sizes *z = k->z;
    cs_window_active *A = &k->A;
    const real price = k->arg[ARG_OPTIONS][OPTION_PRICE];
    int count = 0, complete = 1;
    real most = 0;
    for (int i = 0; i < z->n; ++i) none[i] = 0;
    k->prior.lam = none;
    for (int from = 0; from < 2; ++from) {
        A->count = 0;
        for (int i = 0; i < z->n && from == 0; ++i)
            if (alpha[i] != 0 && A->count < z->chosen) cs_window_choose(k, i);
        complete &= cs_window_exchanged(k, price, steps);
        const real worth = cs_window_worth(A, price);
        if (from > 0 && !(worth > most + price * LESS)) continue;
        most = worth;
        count = A->count;
        for (int i = 0; i < count; ++i) best[i] = A->column[i];
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
static void cs_window_doubtful(cs_window_problem *k, int *doubt)
{
    const cs_window_sizes *z = k->z;
    cs_window_active *A = &k->A;
    const real price = k->arg[ARG_OPTIONS][OPTION_PRICE];
    for (int i = 0; i < z->n; ++i) doubt[i] = 0;
    for (int j = 0, count = A->count; j < count; ++j) {
        const int column = A->column[0];
        const real a = A->a[0], sign = A->sign[0], before = cs_window_worth(A, 0);
        cs_window_remove(&k->tab, A, 0);
        const real left = before - cs_window_worth(A, 0) - price;
        for (int i = 0; i < z->n; ++i) {
            const real gain = cs_window_gain(k, i);
            doubt[i] |= gain > 0 && gain > left;
        }
        cs_window_append(z, &k->tab, &k->prior, A, k->v, column, a, sign);
    }
    for (int i = 0; i < A->count; ++i) doubt[A->column[i]] = 0;
    for (int i = 0; i < z->n; ++i)
        if (doubt[i] && cs_window_append(z, &k->tab, &k->prior, A, k->v, i, 0, 1))
            cs_window_told_apart(A);
}

#endif
