/* One window of the compressive-sensing moving horizon estimator.

   With f the modal forces of all steps of the window, f = sum of the active atoms,

       r = O dx + G f + noise,   dx ~ (0, Pa),   noise ~ (0, S0),

   the atoms' factors a minimise, together with dx,

       (r - O dx - G f)' S0^-1 (r - O dx - G f) + dx' Pa^-1 dx + sum q (a - c)^2 + sum lam |a|,

   and sums of states, residuals and noise, and the factors, stay within limits (eq. 14).

   Nothing of the size of S0 is factorised where all samples were measured. The method is
   feature-sign search (Lee et al. 2007), started from the last window's atoms, with steps in the
   null space where atoms become dependent, and is exact.

   Matrices are stored column by column.

   Lee, Battle, Raina, Ng, "Efficient sparse coding algorithms", 2007. */

#include "kernels.h"

#include "cs_window_choice.h"
#include "cs_window_shown.h"

enum {
    RES_ALPHA, RES_EXTRA, RES_VARIANCE, RES_X, RES_COVARIANCE, RES_FORCES, RES_INFO, RES_MOTION
};
enum {
    INFO_STATUS, INFO_KKT, INFO_STEPS, INFO_NONZEROS, INFO_STRONGEST, INFO_UNOBSERVED, INFO_GAP,
    INFO_CLIPPED, INFO_INFEASIBLE, INFO_CONTRADICTED /* and so on for every limited sum */
};

KERNEL void cs_window_work(const int *sizes, long *reals, long *ints)
{
    const cs_window_sizes z = cs_window_read(sizes);
    const long nx = z.nx, d = z.d, m = z.m, most = z.most, rows = nx + d + PLACES * nx;
    const long filtered = cs_window_tables_size(nx, z.p, z.outputs, 1) + nx * nx + 3 * nx + z.p
                          + (3 * nx + z.p) * most;
    const long covariances = PLACES * nx * (nx + most), inverse = most * most;
    *reals = cs_window_active_size(&z) + nx * nx + rows + 7 * m + 5 * z.n + 2 * d + z.columns
             + z.forces + 3 * nx + m + cs_window_limits_size(&z) + 3 * z.n
             + cs_window_tables_size(nx, d, m, PLACES) + filtered + covariances + inverse
             + 3 * nx * nx + nx + cs_window_candidates_size(&z);
    *ints = 4 * z.most + 2 * z.n + 2 * z.m + z.columns + z.chosen;
}

/* The window before anything is active: what was measured, and nothing else counts. A window that is
   not full yet has its samples first, the coming ones are not measured. */
static cs_window_problem cs_window_begin(const cs_window_sizes *z, const real *const *arg, real *w,
                                         int *iw)
{
    const int nx = z->nx, m = z->m, rows = nx + z->d + PLACES * nx;
    cs_window_problem k;
    k.z = z;
    k.arg = arg;
    const cs_window_prior prior = {arg[ARG_ATOMS], arg[ARG_ACROSS],  arg[ARG_LAM],
                                   arg[ARG_Q],     arg[ARG_C],       arg[ARG_EXTRA_Q],
                                   arg[ARG_EXTRA_C], arg[ARG_SIDE],  arg[ARG_CAPS]};
    k.prior = prior;
    k.A = cs_window_room(z, w, iw);
    k.shut = iw + 3 * z->most;
    k.counting.used = k.shut + z->n;
    k.row = k.counting.used + m;
    k.held = k.row + m;
    k.best = k.held + z->columns;
    k.doubt = k.best + z->most;
    k.X = w + cs_window_active_size(z);
    k.v = k.X + nx * nx;
    k.r = k.v + rows;
    k.counting.weight = k.r + m;
    k.counting.soft = k.counting.weight + m;
    k.fit = k.counting.soft + m;
    k.given = k.fit + m;
    k.white = k.given + m;
    k.e = k.white + m;
    k.g = k.e + m;
    k.x0 = k.g + z->n;
    k.f = k.x0 + nx;
    k.at_limit = k.f + z->d;
    k.weights = k.at_limit + z->columns + cs_window_limits_size(z);
    k.tables = k.weights + 3 * z->n + cs_window_candidates_size(z);
    k.rest = k.tables + cs_window_tables_size(nx, z->d, m, PLACES);
    k.absent = (int)arg[ARG_ABSENT][0];
    k.complete = k.absent == 0 && !z->varying;
    const int there = (z->N + 1 - k.absent) * z->outputs; /* measurements */
    const real *mask = arg[ARG_MASK] + k.absent * z->outputs;
    const real *given = arg[ARG_R] + k.absent * z->outputs;
    for (int i = 0; i < m; ++i) k.counting.weight[i] = k.r[i] = 0;
    for (int i = 0; i < m && z->limits; ++i) k.row[i] = 0, k.counting.soft[i] = 0;
    int partly = 0;
    for (int i = 0; i < there; ++i) {
        const int row = z->limits ? i / z->outputs * z->ny + i % z->outputs : i;
        k.counting.weight[row] = mask[i];
        k.r[row] = mask[i] != 0 ? given[i] : 0;
        partly += mask[i] != 1;
    }
    k.complete = k.complete && !partly;
    for (int i = 0; i < z->columns; ++i) k.held[i] = 0;
    const int lag = (int)arg[ARG_OPTIONS][OPTION_LAG], newest = z->N - k.absent;
    k.at[AT_ARRIVAL] = 1;
    k.at[AT_OUTPUT] = newest > lag ? newest - lag : 0;
    k.at[AT_NEXT] = newest + 1;
    return k;
}

/* The problem with the limits that are active now, and its optimum; a status. */
static int cs_window_again(cs_window_problem *k, real *alpha, real *extra, int *steps)
{
    cs_window_look(k);
    const int status = cs_window_optimum(k, alpha, steps);
    cs_window_factors(k, alpha, extra);
    cs_window_residuals(k, alpha, extra);
    return status;
}

/* No limit is active. */
static void cs_window_set_free(cs_window_problem *k)
{
    for (int i = 0; i < k->z->m && k->z->limits; ++i) {
        if (k->row[i]) k->counting.weight[i] = 0;
        k->row[i] = 0;
    }
}

/* The optimum within all limits, or without them, if they contradict each other; a status. */
static int cs_window_within(cs_window_problem *k, real *alpha, real *extra, real *room, int *steps,
                            real *contradicted)
{
    const cs_window_limits limits = cs_window_limited(k, room);
    int status = DONE;
    cs_window_residuals(k, alpha, extra);
    for (int pass = 0; pass < k->z->limit; ++pass) {
        if (pass > 0 && cs_window_leave_limit(k, &limits)) {
            status = cs_window_again(k, alpha, extra, steps);
            continue;
        }
        if (!cs_window_enter_limit(k, &limits, alpha, extra)) {
            for (int last = 0; last < SHARPENED && pass > 0; ++last) {
                cs_window_sharpen(k, &limits);
                status = cs_window_again(k, alpha, extra, steps);
            }
            if (!cs_window_contradicted(k, &limits, contradicted)) return status;
            cs_window_set_free(k);
            return cs_window_again(k, alpha, extra, steps);
        }
        status = cs_window_again(k, alpha, extra, steps);
    }
    return NOT_CONVERGED;
}

/* The same support where no sum is at a limit: bands do not count on it that one is. */
static void cs_window_without_limits(cs_window_problem *k, const real *alpha, const real *extra)
{
    const cs_window_sizes *z = k->z;
    cs_window_set_free(k);
    cs_window_look(k);
    for (int i = 0; i < z->columns; ++i) {
        const real a = (i < z->n ? alpha : extra)[i % z->n];
        const int certain = i >= z->n && k->prior.extra_q[i - z->n] > 0;
        if ((a != 0 || certain) && !k->held[i])
            cs_window_append(z, &k->tab, &k->prior, &k->A, k->v, i, a, a > 0 ? 1 : -1);
    }
}

/* The forces found as they are without the l1 norm, and how far that moves the states. */
static void cs_window_unbiased(cs_window_problem *k, const real *found, const real *x, real *fitted,
                               real *forces, real *shift, real *rest)
{
    const cs_window_sizes *z = k->z;
    const int nx = z->nx, output = 2 * nx + z->d; /* and behind it the state after the window */
    cs_window_refit(z, &k->tab, &k->prior, &k->A);
    for (int i = 0; i < z->n; ++i) fitted[i] = 0;
    for (int i = 0; i < z->columns; ++i)
        if (k->held[i]) fitted[i % z->n] += k->at_limit[i];
    for (int i = 0; i < k->A.count; ++i) fitted[k->A.column[i] % z->n] += k->A.a[i];
    cs_window_forces(z, k->arg[ARG_PSI], fitted, found, k->arg[ARG_OPTIONS][OPTION_THRESHOLD],
                     k->at[AT_OUTPUT], forces);
    cs_window_first(&k->A, k->x0, rest);
    cs_window_explain(&k->tab, &k->A, k->v, k->x0, output, 2 * nx, shift);
    for (int i = 0; i < 2 * nx; ++i) shift[i] -= x[nx + i];
}

KERNEL void cs_window(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const cs_window_sizes z = cs_window_read(sizes);
    const int nx = z.nx, known = nx + z.d, rows = known + PLACES * nx, shown_rows = 2 * nx;
    const real *options = arg[ARG_OPTIONS];
    cs_window_problem k = cs_window_begin(&z, arg, w, iw);
    cs_window_candidates candidates = {0};
    cs_window_active *A = &k.A;
    real *alpha = res[RES_ALPHA], *extra = res[RES_EXTRA], *info = res[RES_INFO];
    real *x = res[RES_X], *P = res[RES_COVARIANCE], *rest = k.rest;

    /* 1. the optimum */
    int steps = 0, limited = 0;
    for (int i = 0; i < INFO_CONTRADICTED + z.limits; ++i) info[i] = 0;
    cs_window_look(&k);
    cs_window_quiet(&k);
    const int unobserved = k.unobserved;
    const real strongest = cs_window_strongest(&z, &k.prior, k.g, rest);
    const real rounding = 16 * real_epsilon * strongest, asked = options[OPTION_TOLERANCE];
    k.least = asked > rounding ? asked : rounding;
    int status = cs_window_optimum(&k, arg[ARG_WARM], &steps);
    cs_window_factors(&k, alpha, extra);
    if (z.passes) status = cs_window_reweighted(&k, alpha, extra, k.weights, status, &steps);
    if (z.bounded)
        status = cs_window_within(&k, alpha, extra, k.at_limit + z.columns, &steps,
                                  info + INFO_CONTRADICTED);
    else if (z.varying)
        cs_window_residuals(&k, alpha, extra);
    else
        cs_window_first(A, k.x0, rest);
    for (int i = 0; i < z.m && z.limits; ++i) limited |= k.row[i] != 0;
    info[INFO_KKT] = cs_window_kkt(&z, &k.prior, A, k.g, k.held, k.shut, rest);
    info[INFO_GAP] = options[OPTION_GAP];
    if (!cs_window_near(&z, &k.prior, info[INFO_KKT], options[OPTION_GAP])) {
        if (!z.bounded && !z.varying) cs_window_residuals(&k, alpha, extra);
        info[INFO_GAP] = cs_window_gap(&k, alpha, extra);
    }
    if (z.chosen) { /* the l1 norm was the start only */
        candidates = cs_window_offer(&k, k.weights + 3 * z.n, k.doubt + z.n);
        const int chosen
            = cs_window_chosen(&k, &candidates, k.weights, k.best, alpha, extra, &steps);
        status = chosen == DONE ? status : chosen;
        cs_window_residuals(&k, alpha, extra);
    }
    real *motion = res[RES_MOTION];
    motion[0] = 0;
    if (z.varying) { /* weighted residuals of all rows, modal forces, first state */
        for (int i = 0; i < z.m; ++i) motion[i] = 0;
        for (int i = 0; i < k.counting.count; ++i) {
            const int of = k.counting.used[i];
            motion[of] = k.counting.weight[of] * k.e[i];
        }
        for (int i = 0; i < z.d; ++i) motion[z.m + i] = k.f[i];
        for (int i = 0; i < nx; ++i) motion[z.m + z.d + i] = k.x0[i];
    }

    /* 2. states and forces */
    const int own = z.arrival == ARRIVAL_FILTERED || z.arrival == ARRIVAL_NONE;
    const int from = known + own * nx, shown = k.at[AT_OUTPUT], refits = options[OPTION_REFIT] != 0;
    const real threshold = options[OPTION_THRESHOLD];
    real *forces = res[RES_FORCES], *spread = forces + 2 * z.forces;
    real *found = rest, *fitted = found + z.n, *biased = fitted + z.n, *shift = biased + z.forces;
    real *both = shift + shown_rows, *space = both + 2 * nx * nx;
    cs_window_explain(&k.tab, A, k.v, k.x0, from, rows - from, x + own * nx);
    for (int i = 0; i < z.n; ++i) found[i] = alpha[i] + extra[i];
    cs_window_forces(&z, arg[ARG_PSI], found, found, threshold, shown, forces);
    for (int f = 0; f < z.forces; ++f) biased[f] = forces[z.forces + f];
    if (limited) {
        if (refits) cs_window_unbiased(&k, found, x, fitted, forces, shift, space);
        k.rest = space;
        cs_window_without_limits(&k, alpha, extra);
    }

    /* 3. covariances */
    for (int i = 0; i < z.n; ++i) res[RES_VARIANCE][i] = 0;
    if (z.carries) cs_window_variances(&z, A, res[RES_VARIANCE], space);
    if (own) cs_window_filtered(&k, x, P, space);
    cs_window_covariances(&k.tab, A, from, k.X, A->effect, rows, A->L + nx * A->stride, A->stride,
                          P + own * nx * nx, space);
    cs_window_spread(&z, A, arg[ARG_PSI], shown, spread);
    if (refits) { /* what is shown; the next window starts from the optimum */
        if (!limited) cs_window_unbiased(&k, found, x, fitted, forces, shift, space);
        if (z.chosen) cs_window_doubtful(&k, &candidates, k.doubt);
        else cs_window_alternatives(&z, &k.tab, &k.prior, A, k.v, k.g, k.shut);
        cs_window_spread(&z, A, arg[ARG_PSI], shown, spread);
        cs_window_covariances(&k.tab, A, known + nx, k.X, A->effect, rows, A->L + nx * A->stride,
                              A->stride, both, space);
        for (int i = 0; i < nx; ++i)
            for (int j = 0; j < nx; ++j)
                P[nx * nx + i + j * nx] = both[i + j * nx] + shift[i] * shift[j];
        for (int f = 0; f < z.forces; ++f) { /* the l1 norm could hide as much */
            const real bias = forces[z.forces + f] - biased[f];
            spread[f] += bias * bias;
        }
    }
    int nonzeros = 0, clipped = limited;
    for (int i = 0; i < z.n; ++i) nonzeros += alpha[i] + extra[i] != 0;
    for (int i = 0; i < z.columns && z.bounded; ++i) clipped |= k.held[i] != 0;
    info[INFO_STATUS] = (real)status;
    info[INFO_STEPS] = (real)steps;
    info[INFO_NONZEROS] = (real)nonzeros;
    info[INFO_STRONGEST] = strongest;
    info[INFO_UNOBSERVED] = (real)unobserved;
    info[INFO_CLIPPED] = (real)clipped;
    for (int i = 0; i < z.limits; ++i)
        if (info[INFO_CONTRADICTED + i] != 0) info[INFO_INFEASIBLE] = 1;
}
