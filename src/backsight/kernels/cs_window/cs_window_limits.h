/* Limits of a window, by a dual active set.

   With a limit active the window is one whose limited sum was measured, nearly exactly, to be at the
   limit, or whose atom is held there: both are windows with an exact l1 norm. Limits enter one after
   the other, the most violated first; where a multiplier would change its sign on the way, its limit
   is left. The cost rises in every pass, so that this ends.

   Goldfarb, Idnani, "A numerically stable dual method for solving strictly convex quadratic
   programs", 1983, doi:10.1007/BF02591962. */
#ifndef CS_WINDOW_LIMITS_H
#define CS_WINDOW_LIMITS_H

#include "cs_window_problem.h"

#define SOFTNESS ((real)1e-6) /* variance of an active limit, as a share of what it limits */
#define SLACK ((real)1e-7) /* standard deviations by which a limit is missed and still kept */
#define SHARPENED 3 /* times that active limits are aimed at anew */
#define MISSED ((real)1e-4) /* the same of active limits: beyond it they contradict each other */

typedef struct {
    real *low, *high, *size; /* of all rows; NO_LIMIT where there is none; standard deviation */
    real *by_row, *by_column; /* multipliers */
    real *now; /* the same of the active limits as they are, rows and then columns */
} cs_window_limits;

static long cs_window_limits_size(const cs_window_sizes *z)
{
    return 5L * z->m + 2L * z->columns;
}

/* Limits of the rows, and how much what is limited may vary, given the covariance of the first state. */
static cs_window_limits cs_window_limited(cs_window_problem *k, real *w)
{
    const cs_window_sizes *z = k->z;
    const int m = z->m, nx = z->nx, outputs = z->outputs;
    const real *Pa = k->arg[ARG_PA];
    cs_window_limits l = {w, w + m, w + 2 * m, w + 3 * m, w + 4 * m, w + 4 * m + z->columns};
    for (int i = 0; i < m; ++i) {
        const int of = i % z->ny - outputs, sample = i / z->ny + k->absent;
        const int there = of >= 0 && sample <= z->N;
        l.low[i] = there ? k->arg[ARG_LOW][of + sample * z->limits] : -NO_LIMIT;
        l.high[i] = there ? k->arg[ARG_HIGH][of + sample * z->limits] : NO_LIMIT;
        l.by_row[i] = l.size[i] = 0;
        if (!(l.low[i] > -NO_LIMIT) && !(l.high[i] < NO_LIMIT)) continue;
        const real *O = k->arg[ARG_O] + i;
        real variance = k->arg[ARG_S0][i + (long)i * m];
        for (int a = 0; a < nx; ++a)
            for (int b = 0; b < nx; ++b) variance += O[a * m] * Pa[a + b * nx] * O[b * m];
        l.size[i] = real_sqrt(real_fmax(variance, 0));
        k->counting.soft[i] = SOFTNESS * variance;
    }
    for (int i = 0; i < z->columns; ++i) l.by_column[i] = 0;
    return l;
}

/* What a row of the window is. */
static real cs_window_value(const cs_window_problem *k, int row)
{
    real value = k->fit[row];
    const real *S = k->arg[ARG_S0] + (long)row * k->z->m;
    for (int i = 0; i < k->counting.count; ++i) {
        const int of = k->counting.used[i];
        value += k->counting.weight[of] * S[of] * k->e[i];
    }
    return value;
}

/* Multipliers of the active limits, positive where they push. */
static void cs_window_multipliers(const cs_window_problem *k, real *by_row, real *by_column)
{
    for (int i = 0; i < k->counting.count; ++i) {
        const int of = k->counting.used[i];
        if (k->z->limits && k->row[of]) by_row[of] = -(real)k->row[of] * k->e[i];
    }
    for (int i = 0; i < k->z->columns; ++i) {
        if (!k->held[i]) continue;
        const real a = k->at_limit[i], sign = a != 0 ? (a > 0 ? 1 : -1) : (real)k->held[i];
        by_column[i] = (real)k->held[i] * (cs_window_slope(k, i, a)
                                     - cs_window_half(k->z, &k->prior, i, sign));
    }
}

/* Make the limit active that is violated most; 0 if none is. */
static int cs_window_enter_limit(cs_window_problem *k, const cs_window_limits *l, const real *alpha,
                                 const real *extra)
{
    const cs_window_sizes *z = k->z;
    real worst = SLACK;
    int which = -1, end = 0;
    for (int i = 0; i < z->m && z->limits; ++i) {
        if (!(l->size[i] > 0) || k->row[i]) continue;
        const real value = cs_window_value(k, i);
        const real below = (l->low[i] - value) / l->size[i], above = (value - l->high[i]) / l->size[i];
        const real most = below > above ? below : above;
        if (most > worst) { worst = most; which = i; end = below > above ? -1 : 1; }
    }
    for (int i = 0; i < z->columns; ++i) {
        real low, high;
        cs_window_box(k, i, &low, &high);
        if (high - low >= NO_LIMIT || k->held[i]) continue;
        const real a = (i < z->n ? alpha : extra)[i % z->n], size = real_fmax(high - low, 0);
        const real unit = size > 0 ? size : 1, below = (low - a) / unit, above = (a - high) / unit;
        const real most = below > above ? below : above;
        if (most > worst) { worst = most; which = z->m + i; end = below > above ? -1 : 1; }
    }
    if (which < 0) return 0;
    if (which < z->m) {
        k->row[which] = end;
        k->counting.weight[which] = 1;
        k->r[which] = end < 0 ? l->low[which] : l->high[which];
        l->by_row[which] = 0;
    } else {
        real low, high;
        cs_window_box(k, which - z->m, &low, &high);
        k->held[which - z->m] = end;
        k->at_limit[which - z->m] = end < 0 ? low : high;
        l->by_column[which - z->m] = 0;
    }
    return 1;
}

/* Go from the multipliers before to those of the active limits as they are, or until one would change
   its sign, whose limit is left: then 1. */
static int cs_window_leave_limit(cs_window_problem *k, const cs_window_limits *l)
{
    const int m = k->z->m, all = m + k->z->columns;
    real *now = l->now, first = 1, most = 0;
    int which = -1;
    cs_window_multipliers(k, now, now + m);
    for (int i = 0; i < all; ++i) {
        if (!(i < m ? k->row[i] : k->held[i - m])) continue;
        most = real_fmax(most, real_fabs(now[i]));
    }
    for (int i = 0; i < all; ++i) {
        if (!(i < m ? k->row[i] : k->held[i - m])) continue;
        const real before = i < m ? l->by_row[i] : l->by_column[i - m];
        if (!(now[i] < -16 * real_epsilon * most)) continue;
        const real length = before / (before - now[i]);
        if (which < 0 || length < first) { first = length; which = i; }
    }
    for (int i = 0; i < all; ++i) {
        if (!(i < m ? k->row[i] : k->held[i - m])) continue;
        real *before = i < m ? l->by_row + i : l->by_column + i - m;
        *before += first * (now[i] - *before);
    }
    if (which < 0) return 0;
    if (which < m) {
        k->row[which] = 0;
        k->counting.weight[which] = 0;
        l->by_row[which] = 0;
    } else {
        k->held[which - m] = 0;
        l->by_column[which - m] = 0;
    }
    return 1;
}

/* Which limited sums miss an active limit: these contradict each other, or others; whether any does. */
static int cs_window_contradicted(const cs_window_problem *k, const cs_window_limits *l, real *which)
{
    int some = 0;
    for (int i = 0; i < k->z->m && k->z->limits; ++i) {
        if (!k->row[i]) continue;
        const real end = (k->row[i] < 0 ? l->low : l->high)[i];
        if (!(real_fabs(cs_window_value(k, i) - end) > MISSED * l->size[i])) continue;
        which[i % k->z->ny - k->z->outputs] = 1;
        some = 1;
    }
    return some;
}

/* An active limit is missed by its softness times its multiplier: aim beyond it by as much. */
static void cs_window_sharpen(cs_window_problem *k, const cs_window_limits *l)
{
    for (int i = 0; i < k->counting.count && k->z->limits; ++i) {
        const int of = k->counting.used[i];
        if (!k->row[of]) continue;
        k->r[of] = (k->row[of] < 0 ? l->low : l->high)[of] + k->counting.soft[of] * k->e[i];
    }
}

#endif
