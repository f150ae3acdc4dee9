/* A window as it stands, its solution, and how near to the optimum that is. */
#ifndef CS_WINDOW_PROBLEM_H
#define CS_WINDOW_PROBLEM_H

#include "cs_window_search.h"

/* OPTION_GAP: up to which a gap need not be known. */
enum {
    OPTION_THRESHOLD, OPTION_TOLERANCE, OPTION_LAG, OPTION_REFIT, OPTION_GAP, OPTION_FLOOR, OPTION_PRICE
};

#define NO_LIMIT ((real)1e30) /* a limit that is none */
#define CHANGES 8 /* of the chosen atoms, at most so many for each that may be chosen */

/* Limits are active where `row` and `held` are -1 (lower end) or 1 (upper end); held atoms and extra
   states stay at their limits, whose values are in `at_limit`. */
typedef struct {
    const cs_window_sizes *z;
    const real *const *arg;
    cs_window_prior prior;
    cs_window_rows counting;
    cs_window_tables tab;
    cs_window_active A;
    int at[PLACES];
    int absent, complete, unobserved, room, *shut, *row, *held, *best, *doubt;
    real least; /* violation of an optimality condition that is rounding */
    real *X, *r, *v, *g; /* of all rows: measured, or the end of the active limit */
    real *x0, *f, *fit; /* first state, modal forces, and what both explain of all rows */
    real *given, *white, *e; /* of the rows that count: what W takes, and L^-1, S0^-1 times residuals */
    real *at_limit, *weights, *rest, *tables; /* the last three: work space */
} cs_window_problem;

/* Take the effect of a held atom out of what is to be explained. */
static void cs_window_hold(const cs_window_problem *k, int column, real value, real *v)
{
    const cs_window_sizes *z = k->z;
    const int place = column % z->n, start = place / z->atoms * z->p, whole = z->width * z->p;
    const int length = z->d - start < whole ? z->d - start : whole, rows = k->tab.rows;
    cs_window_product(v, -value, k->tab.J + (long)(z->nx + start) * rows, rows,
                      k->prior.atoms + place % z->atoms * whole, 1, rows, length);
}

/* Make the problem of the rows that count, without active atoms. */
static void cs_window_look(cs_window_problem *k)
{
    const cs_window_sizes *z = k->z;
    const real *const *arg = k->arg;
    const int nx = z->nx, rows = nx + z->d + PLACES * nx;
    real *rest = k->rest;
    int limited = 0;
    for (int i = 0; i < z->m && z->limits; ++i) limited |= k->row[i] != 0;
    const int whole = k->complete && !limited, every = whole && !z->limits;
    if (!every) cs_window_number(&k->counting, z->m);
    const int count = every ? z->m : k->counting.count;
    if (whole) {
        const cs_window_tables all = {nx,         z->d,       count,      rows,      1,
                                      arg[ARG_W], arg[ARG_J], arg[ARG_V], arg[ARG_L]};
        k->tab = all;
    } else
        k->tab = cs_window_prepare(z, arg, &k->counting, z->d, k->at, PLACES, k->tables);
    const int free = z->arrival == ARRIVAL_NONE && !k->absent;
    const int unknown = free && !cs_window_unknown(k->tab.J, rows, k->X, nx, rest);
    if (!free || unknown) cs_window_posterior(arg[ARG_PA], k->tab.J, rows, k->X, nx, rest);
    k->unobserved = unknown;
    for (int i = 0; i < count && !every; ++i) k->given[i] = k->r[k->counting.used[i]];
    if (!k->tab.whole) cs_window_forward(k->tab.L, count, k->given, 0, count);
    cs_window_applied(k->v, k->tab.W, rows, every ? k->r : k->given, rows, count);
    for (int i = 0; i < z->columns && z->bounded; ++i)
        if (k->held[i]) cs_window_hold(k, i, k->at_limit[i], k->v);
    k->A.X = k->X;
    k->A.count = 0;
    cs_window_applied(k->A.right, k->X, nx, k->v, nx, nx);
}

/* Gradients where no atom is active. */
static void cs_window_quiet(cs_window_problem *k)
{
    real *rest = k->rest;
    cs_window_first(&k->A, k->x0, rest);
    cs_window_explain(&k->tab, &k->A, k->v, k->x0, k->z->nx, k->z->d, rest);
    cs_window_gradients(k->z, &k->prior, rest, k->g);
}

/* The optimum without limits that are not active; a status. */
static int cs_window_optimum(cs_window_problem *k, const real *warm, int *steps)
{
    int more;
    k->room = cs_window_start(k->z, &k->tab, &k->prior, k->v, warm, k->held, &k->A, k->shut);
    const int status = cs_window_search(k->z, &k->tab, &k->prior, &k->A, k->v, k->g, k->shut,
                                        k->least, &more, k->rest);
    *steps += more;
    return k->room ? status : NOT_CONVERGED;
}

/* Factors of all atoms, and of their extra states; held ones, too. */
static void cs_window_factors(const cs_window_problem *k, real *alpha, real *extra)
{
    const int n = k->z->n;
    for (int i = 0; i < n; ++i) alpha[i] = extra[i] = 0;
    for (int i = 0; i < k->A.count; ++i) {
        const int column = k->A.column[i];
        (column < n ? alpha : extra)[column % n] = k->A.a[i];
    }
    for (int i = 0; i < k->z->columns && k->z->bounded; ++i)
        if (k->held[i]) (i < n ? alpha : extra)[i % n] = k->at_limit[i];
}

/* First state and modal forces of the solution, what they explain, and what is left. */
static void cs_window_residuals(cs_window_problem *k, const real *alpha, const real *extra)
{
    const cs_window_sizes *z = k->z;
    const int whole = z->width * z->p;
    cs_window_number(&k->counting, z->m);
    const int count = k->counting.count;
    cs_window_first(&k->A, k->x0, k->rest);
    for (int i = 0; i < z->d; ++i) k->f[i] = 0;
    for (int i = 0; i < z->n; ++i) {
        const real a = alpha[i] + extra[i];
        if (a == 0) continue;
        const int start = i / z->atoms * z->p;
        cs_window_add(k->f + start, a, k->prior.atoms + i % z->atoms * whole,
                      z->d - start < whole ? z->d - start : whole);
    }
    for (int i = 0; i < z->m; ++i) k->fit[i] = 0;
    cs_window_product(k->fit, 1, k->arg[ARG_O], z->m, k->x0, 1, z->m, z->nx);
    for (int j = 0; j < z->d; ++j)
        if (k->f[j] != 0) cs_window_add(k->fit, k->f[j], k->arg[ARG_G] + (long)j * z->m, z->m);
    for (int i = 0; i < count; ++i) {
        const int of = k->counting.used[i];
        k->white[i] = k->r[of] - k->counting.weight[of] * k->fit[of];
    }
    cs_window_forward(k->tab.L, count, k->white, 0, count);
    if (!z->bounded && !z->varying) return;
    for (int i = 0; i < count; ++i) k->e[i] = k->white[i];
    cs_window_back(k->tab.L, k->e, count);
}

/* Half the slope of the cost by a column, downwards, without its l1 norm; g are the gradients. */
static real cs_window_slope(const cs_window_problem *k, int column, real a)
{
    return k->g[column % k->z->n] + cs_window_pull(k->z, &k->prior, column, a);
}

/* Between which values a column may be. */
static void cs_window_box(const cs_window_problem *k, int column, real *low, real *high)
{
    const cs_window_sizes *z = k->z;
    const int place = column % z->n, extra = column >= z->n, atom = place % z->atoms;
    const real cap = extra ? NO_LIMIT : k->prior.caps[atom];
    const real change = k->prior.caps[z->atoms + atom];
    const real *known = extra ? k->prior.extra_q : k->prior.q;
    const real *mean = extra ? k->prior.extra_c : k->prior.c;
    *low = -cap;
    *high = cap;
    if (known[place] > 0 && change < NO_LIMIT) { /* where both contradict each other the cap counts */
        *low = real_fmin(real_fmax(mean[place] - change, -cap), cap);
        *high = real_fmax(real_fmin(mean[place] + change, cap), -cap);
    }
}

static int cs_window_boxed(const cs_window_problem *k, int column)
{
    real low, high;
    cs_window_box(k, column, &low, &high);
    return high - low < NO_LIMIT;
}

/* Most that y b - lam |b| can be for b in a box. */
static real cs_window_support(real y, real lam, real low, real high)
{
    const real below = y * low - lam * real_fabs(low), above = y * high - lam * real_fabs(high);
    const real most = below > above ? below : above;
    return low <= 0 && high >= 0 && most < 0 ? 0 : most;
}

/* Whether the largest violation v of an optimality condition says that the duality gap, as a share of
   the cost, is no larger than `most`. With t = v / lam, the scale s of `cs_window_gap` is 1 / (1 + t)
   or more, and active atoms have s c a >= (1 - 2 t) lam |a|, so that

       gap <= t^2 r'r + 2 t sum lam |a| <= 2 t cost.

   Limits have terms of their own. */
static int cs_window_near(const cs_window_sizes *z, const cs_window_prior *prior, real v, real most)
{
    int not_near = z->bounded;
    for (int i = 0; i < z->n; ++i) not_near += !(2 * v <= most * prior->lam[i]);
    return !not_near;
}

/* Duality gap as a share of the cost. With the residual r of all that is least squares and
   the slope c of it by an atom, s r belongs to a point of the dual problem if s |c| <= lam:

       gap = (1 - s)^2 r'r + sum (lam |a| - s c a + sup {s c b - lam |b|, b in its box}). */
static real cs_window_gap(const cs_window_problem *k, const real *alpha, const real *extra)
{
    const cs_window_sizes *z = k->z;
    const int nx = z->nx;
    real square = cs_window_dot(k->white, k->white, k->counting.count);
    real s = 1, sum, norm = 0, slope = 0;
    real *pull = k->rest; /* of the first state: its gradient is what its prior pulls with */
    cs_window_explain(&k->tab, &k->A, k->v, k->x0, 0, nx, pull);
    if (z->arrival != ARRIVAL_NONE || k->absent || k->unobserved)
        square += real_fmax(cs_window_dot(k->x0, pull, nx), 0);
    for (int i = 0; i < z->n; ++i) {
        const real off = alpha[i] - k->prior.c[i], off_extra = extra[i] - k->prior.extra_c[i];
        square += k->prior.q[i] * off * off + k->prior.extra_q[i] * off_extra * off_extra;
        norm += k->prior.lam[i] * real_fabs(alpha[i]);
    }
    for (int i = 0; i < z->n; ++i) {
        const real c = 2 * (k->g[i] + k->prior.q[i] * (k->prior.c[i] - alpha[i]));
        const real side = k->prior.side[i], size = side == 0 ? real_fabs(c) : side * c;
        if (size * s > k->prior.lam[i] && k->prior.lam[i] > 0 && !(z->bounded && cs_window_boxed(k, i)))
            s = k->prior.lam[i] / size;
        if (alpha[i] != 0) slope += c * alpha[i];
    }
    sum = norm - s * slope;
    for (int i = 0; i < z->columns && z->bounded; ++i) {
        const int extra_state = i >= z->n, place = i % z->n;
        const real lam = extra_state ? 0 : k->prior.lam[i], a = (extra_state ? extra : alpha)[place];
        const real y = 2 * s * cs_window_slope(k, i, a);
        real low, high;
        if (!cs_window_boxed(k, i) || (extra_state && !(k->prior.extra_q[place] > 0))) continue;
        cs_window_box(k, i, &low, &high);
        if (!extra_state && k->prior.side[i] > 0) low = 0;
        if (!extra_state && k->prior.side[i] < 0) high = 0;
        sum += cs_window_support(y, lam, low, high) - (extra_state ? y * a : 0);
    }
    const real cost = square + norm;
    return cost > 0 ? real_fabs((1 - s) * (1 - s) * square + sum) / cost : 0;
}

#endif
