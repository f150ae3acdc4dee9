/* One window of the compressive-sensing moving horizon estimator.

   With f the modal forces of all steps of the window, f = sum of the active atoms,

       r = O dx + G f + noise,   dx ~ (0, Pa),   noise ~ (0, S0),

   the atoms' factors a minimise (r - G f)' S^-1 (r - G f) + sum q (a - c)^2 + sum lam |a| with
   S = S0 + O Pa O'. Nothing of the size of S is factorised where all samples were measured: with

       Z = S0^-1 [O G],  I = O' S0^-1 O,  F = O' S0^-1 G,  H = G' S0^-1 G,  T = (Pa^-1 + I)^-1

   the Gram matrix of the modal forces is H - F' T F. It is used column by column, where an atom
   becomes active. The method is feature-sign search (Lee et al. 2007), started from the last
   window's atoms, with steps in the null space where atoms become dependent, and is exact.

   Matrices are stored column by column.

   Lee, Battle, Raina, Ng, "Efficient sparse coding algorithms", 2007. */

#include "kernels.h"

enum { AT_ARRIVAL, AT_OUTPUT, AT_NEXT, PLACES }; /* the first is left out if it is filtered */
enum { ARRIVAL_NONE, ARRIVAL_CONSTANT, ARRIVAL_FILTERED, ARRIVAL_SMOOTHED };
enum { DONE, NOT_CONVERGED, DEPENDENT };

/* Arguments: the problem; its tables where all was measured; the atoms; the window. */
enum {
    ARG_O, ARG_G, ARG_S0, ARG_POWERS, ARG_P, ARG_CROSS, ARG_MOVED,
    ARG_Z, ARG_I, ARG_FT, ARG_H, ARG_PHI, ARG_KT, ARG_V, ARG_E,
    ARG_ATOMS, ARG_ACROSS, ARG_PSI, ARG_SIDE, ARG_OPTIONS,
    ARG_R, ARG_MASK, ARG_ABSENT, ARG_PA, ARG_LAM, ARG_Q, ARG_C, ARG_EXTRA_Q, ARG_EXTRA_C, ARG_WARM
};
enum {
    RES_ALPHA, RES_EXTRA, RES_VARIANCE, RES_X, RES_COVARIANCE, RES_FORCES, RES_INFO
};
enum { OPTION_THRESHOLD, OPTION_TOLERANCE, OPTION_LAG };

typedef struct {
    int nx, ny, p, width, atoms, steps, N, forces, most, limit, arrival, correction;
    int m, d, n; /* rows, modal forces, atoms of the whole window */
} cs_window_sizes;

/* What does not depend on the data but on what was measured. */
typedef struct {
    const real *Z, *I, *Ft, *H;
} cs_window_tables;

/* A state of the window: x = Phi dx + K r + E f, with the covariance V where dx and f are known. */
typedef struct {
    const real *Phi, *Kt, *V, *E;
} cs_window_point;

/* The active atoms. */
typedef struct {
    int count;
    int *column; /* place among the atoms; beyond n: the extra state of that atom */
    int *start, *which; /* its first modal force, and which atom it is */
    real *a, *slope, *target, *sign; /* slope: correlation with the residual without atoms */
    real *h, *t, *row;
    real *L, *inverse; /* factor of their Gram matrix, with reciprocal diagonal, and its inverse */
} cs_window_active;

typedef struct {
    const real *atoms, *across, *lam, *q, *c, *extra_q, *extra_c, *side;
} cs_window_prior;

static cs_window_sizes cs_window_read(const int *s)
{
    cs_window_sizes z = {s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8],
                         s[9], s[10], s[11], 0, 0, 0};
    z.m = z.ny * (z.N + 1);
    z.d = z.p * z.steps;
    z.n = z.atoms * z.steps;
    return z;
}

static real cs_window_dot(const real *restrict a, const real *restrict b, int n)
{
    real sum = 0;
    for (int i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
}

static void cs_window_add(real *restrict a, real factor, const real *restrict b, int n)
{
    for (int i = 0; i < n; ++i) a[i] += factor * b[i];
}

/* Lower factor of a positive semidefinite matrix in place; directions without variance are 0. */
static void cs_window_factor(real *A, int n)
{
    for (int j = 0; j < n; ++j) {
        const real least = 16 * real_epsilon * A[j + j * n];
        for (int k = 0; k < j; ++k)
            cs_window_add(A + j + j * n, -A[j + k * n], A + j + k * n, n - j);
        const real pivot = A[j + j * n];
        const real scale = pivot > least ? 1 / real_sqrt(pivot) : 0;
        for (int i = j; i < n; ++i) A[i + j * n] *= scale;
        for (int i = 0; i < j; ++i) A[i + j * n] = 0;
    }
}

/* Turn the diagonal of a factor into its reciprocals, as the following functions take it. */
static void cs_window_ready(real *L, int n)
{
    for (int j = 0; j < n; ++j) L[j + j * n] = L[j + j * n] > 0 ? 1 / L[j + j * n] : 0;
}

/* L^-1 b in place. */
static void cs_window_forward(const real *L, int stride, real *b, int n)
{
    for (int j = 0; j < n; ++j) {
        b[j] *= L[j + j * stride];
        cs_window_add(b + j + 1, -b[j], L + j + 1 + j * stride, n - j - 1);
    }
}

/* L'^-1 b in place. */
static void cs_window_backward(const real *L, int stride, real *b, int n)
{
    for (int j = n - 1; j >= 0; --j)
        b[j] = L[j + j * stride]
               * (b[j] - cs_window_dot(L + j + 1 + j * stride, b + j + 1, n - j - 1));
}

/* T = (Pa^-1 + I)^-1 for Pa of any rank, as L (1 + L' I L)^-1 L' with Pa = L L'. */
static void cs_window_posterior(const real *Pa, const real *I, real *T, int n, real *w)
{
    real *L = w, *IL = L + n * n, *C = IL + n * n;
    for (int i = 0; i < n * n; ++i) L[i] = Pa[i];
    cs_window_factor(L, n);
    for (int j = 0; j < n; ++j) {
        for (int i = 0; i < n; ++i) IL[i + j * n] = cs_window_dot(I + i * n, L + j * n, n);
        for (int i = j; i < n; ++i)
            C[i + j * n] = cs_window_dot(L + i * n, IL + j * n, n) + (real)(i == j);
    }
    cs_window_factor(C, n);
    cs_window_ready(C, n);
    for (int j = 0; j < n; ++j) { /* columns of (L C'^-1)', then T = its product with itself */
        for (int i = 0; i < n; ++i) IL[i + j * n] = L[j + i * n];
        cs_window_forward(C, n, IL + j * n, n);
    }
    for (int j = 0; j < n; ++j)
        for (int i = 0; i <= j; ++i)
            T[i + j * n] = T[j + i * n] = cs_window_dot(IL + i * n, IL + j * n, n);
}

/* T = I^-1, nothing known beforehand; 0 if the window does not determine its first state. */
static int cs_window_unknown(const real *I, real *T, int n, real *w)
{
    real *L = w, *column = L + n * n;
    for (int i = 0; i < n * n; ++i) L[i] = I[i];
    cs_window_factor(L, n);
    for (int j = 0; j < n; ++j)
        if (!(L[j + j * n] * L[j + j * n] > (real)1e-12 * I[j + j * n])) return 0;
    cs_window_ready(L, n);
    for (int j = 0; j < n; ++j) {
        for (int i = 0; i < n; ++i) column[i] = (real)(i == j);
        cs_window_forward(L, n, column, n);
        cs_window_backward(L, n, column, n);
        for (int i = 0; i < n; ++i) T[i + j * n] = column[i];
    }
    return 1;
}

/* Factor of S0 of the first m rows; a row that was not measured gets unit variance. */
static void cs_window_noise(const real *S0, int stride, const real *mask, int m, real *L)
{
    for (int j = 0; j < m; ++j)
        for (int i = 0; i < m; ++i)
            L[i + j * m] = mask[i] * mask[j] != 0 ? S0[i + j * stride] : (real)(i == j);
    cs_window_factor(L, m);
    cs_window_ready(L, m);
}

/* Tables of the first m rows and d modal forces, as far as they were measured. Z takes m (nx + d)
   numbers, I nx^2, Ft nx d, H d^2. */
static void cs_window_prepare(const cs_window_sizes *z, const real *const *arg, const real *mask,
                              const real *L, int m, int d, real *Z, real *I, real *Ft, real *H)
{
    const int nx = z->nx, columns = nx + d;
    for (int j = 0; j < columns; ++j) {
        const real *from = j < nx ? arg[ARG_O] + j * z->m : arg[ARG_G] + (j - nx) * z->m;
        for (int i = 0; i < m; ++i) Z[i + j * m] = mask[i] * from[i];
        cs_window_forward(L, m, Z + j * m, m);
    }
    for (int j = 0; j < columns; ++j)
        for (int i = 0; i <= j; ++i) {
            const real value = cs_window_dot(Z + i * m, Z + j * m, m);
            if (j < nx) I[i + j * nx] = I[j + i * nx] = value;
            else if (i < nx) Ft[j - nx + i * d] = value;
            else H[i - nx + (j - nx) * d] = H[j - nx + (i - nx) * d] = value;
        }
    for (int j = 0; j < columns; ++j) cs_window_backward(L, m, Z + j * m, m);
}

/* The point of a state of the window, as far as measured; w takes nx (2 nx + m + d) numbers. */
static cs_window_point cs_window_place(const cs_window_sizes *z, const real *const *arg,
                                       const real *mask, const real *L, int m, int d, int at,
                                       real *w)
{
    const int nx = z->nx;
    real *Phi = w, *V = Phi + nx * nx, *Kt = V + nx * nx, *E = Kt + nx * m;
    const real *power = arg[ARG_POWERS] + at * nx * nx, *P = arg[ARG_P] + at * nx * nx;
    const real *cross = arg[ARG_CROSS] + at * nx * z->m, *moved = arg[ARG_MOVED];
    for (int j = 0; j < nx; ++j) {
        for (int i = 0; i < m; ++i) Kt[i + j * m] = mask[i] * cross[i + j * z->m];
        cs_window_forward(L, m, Kt + j * m, m);
    }
    for (int j = 0; j < nx; ++j)
        for (int i = 0; i < nx; ++i)
            V[i + j * nx] = P[i + j * nx] - cs_window_dot(Kt + i * m, Kt + j * m, m);
    for (int i = 0; i < nx; ++i) {
        cs_window_backward(L, m, Kt + i * m, m);
        for (int k = 0; k < m; ++k) Kt[k + i * m] *= mask[k];
        for (int j = 0; j < nx; ++j)
            Phi[i + j * nx] = power[i + j * nx]
                              - cs_window_dot(Kt + i * m, arg[ARG_O] + j * z->m, m);
        for (int j = 0; j < d; ++j) { /* a force of step j / p has moved on for so many steps: */
            const int on = at - 1 - j / z->p;
            E[i + j * nx] = (on < 0 ? 0 : moved[i + (on * z->p + j % z->p) * nx])
                            - cs_window_dot(Kt + i * m, arg[ARG_G] + j * z->m, m);
        }
    }
    const cs_window_point point = {Phi, Kt, V, E};
    return point;
}

/* Modal forces of an active column that lie inside the window. */
static int cs_window_length(const cs_window_sizes *z, const cs_window_active *A, int k)
{
    const int left = z->d - A->start[k], whole = z->width * z->p;
    return left < whole ? left : whole;
}

static const real *cs_window_values(const cs_window_sizes *z, const cs_window_prior *prior,
                                    const cs_window_active *A, int k)
{
    return prior->atoms + A->which[k] * z->width * z->p;
}

/* Correlation of an active column with something given for the modal forces. */
static real cs_window_along(const cs_window_sizes *z, const cs_window_prior *prior,
                            const cs_window_active *A, int k, const real *modal)
{
    return cs_window_dot(cs_window_values(z, prior, A, k), modal + A->start[k],
                         cs_window_length(z, A, k));
}

/* Append a column to the factor of the active ones; 0 if it depends on them (its row is kept). */
static int cs_window_append(const cs_window_sizes *z, const cs_window_tables *tab, const real *T,
                            const cs_window_prior *prior, cs_window_active *A, const real *g0,
                            int column, real a, real sign)
{
    const int s = A->count, nx = z->nx, d = z->d, most = z->most, place = column % z->n;
    if (s == most) return 0;
    A->column[s] = column;
    A->start[s] = place / z->atoms * z->p;
    A->which[s] = place % z->atoms;
    A->a[s] = a;
    A->sign[s] = sign;
    A->slope[s] = g0[place];
    const real *values = cs_window_values(z, prior, A, s);
    const int start = A->start[s], length = cs_window_length(z, A, s);
    real *h = A->h + s * d, *t = A->t + s * nx, *row = A->row;
    for (int i = 0; i < nx; ++i)
        A->target[i] = cs_window_dot(values, tab->Ft + start + i * d, length);
    for (int i = 0; i < nx; ++i) t[i] = cs_window_dot(T + i * nx, A->target, nx);
    for (int i = 0; i < d; ++i) h[i] = 0;
    for (int k = 0; k < length; ++k) cs_window_add(h, values[k], tab->H + (start + k) * d, d);
    for (int k = 0; k < nx; ++k) cs_window_add(h, -t[k], tab->Ft + k * d, d);
    for (int k = 0; k < s; ++k) row[k] = cs_window_along(z, prior, A, k, h);
    cs_window_forward(A->L, most, row, s);
    const real own = cs_window_dot(values, h + start, length);
    const real q = column < z->n ? prior->q[place] : prior->extra_q[place];
    const real pivot = own + q - cs_window_dot(row, row, s);
    if (!(pivot > 4096 * real_epsilon * (own + q))) return 0;
    for (int k = 0; k < s; ++k) A->L[s + k * most] = row[k];
    A->L[s + s * most] = 1 / real_sqrt(pivot);
    A->count = s + 1;
    return 1;
}

/* Take an active column out; the rest of the factor is mended by a rank-one update. */
static void cs_window_remove(const cs_window_sizes *z, cs_window_active *A, int at)
{
    const int most = z->most, last = --A->count;
    real *L = A->L, *v = A->row;
    for (int i = at; i < last; ++i) v[i] = L[i + 1 + at * most];
    for (int i = at; i < last; ++i) {
        A->column[i] = A->column[i + 1];
        A->start[i] = A->start[i + 1];
        A->which[i] = A->which[i + 1];
        A->a[i] = A->a[i + 1];
        A->sign[i] = A->sign[i + 1];
        A->slope[i] = A->slope[i + 1];
        for (int k = 0; k < z->d; ++k) A->h[k + i * z->d] = A->h[k + (i + 1) * z->d];
        for (int k = 0; k < z->nx; ++k) A->t[k + i * z->nx] = A->t[k + (i + 1) * z->nx];
        for (int k = 0; k < at; ++k) L[i + k * most] = L[i + 1 + k * most];
        for (int k = at; k <= i; ++k) L[i + k * most] = L[i + 1 + (k + 1) * most];
    }
    for (int j = at; j < last; ++j) {
        const real inverse = L[j + j * most], s = v[j] * inverse;
        const real c = real_sqrt(1 + s * s), shrink = 1 / c;
        L[j + j * most] = inverse * shrink;
        for (int i = j + 1; i < last; ++i) {
            L[i + j * most] = (L[i + j * most] + s * v[i]) * shrink;
            v[i] = c * v[i] - s * L[i + j * most];
        }
    }
}

/* Half the weight of the absolute value, with its sign; 0 for the extra states. */
static real cs_window_half(const cs_window_sizes *z, const cs_window_prior *prior, int column,
                           real sign)
{
    return column < z->n ? sign * prior->lam[column] / 2 : 0;
}

/* Whether an active column has to stay on its side of zero. */
static int cs_window_kinked(const cs_window_sizes *z, const cs_window_prior *prior,
                            const cs_window_active *A, int k)
{
    const int column = A->column[k];
    return column < z->n && (prior->lam[column] > 0 || prior->side[A->which[k]] != 0);
}

/* Half the slope of the prior of a column, downwards. */
static real cs_window_pull(const cs_window_sizes *z, const cs_window_prior *prior, int column,
                           real a)
{
    const int extra = column - z->n;
    return extra < 0 ? prior->q[column] * (prior->c[column] - a)
                     : prior->extra_q[extra] * (prior->extra_c[extra] - a);
}

/* gamma = gamma0 - the part of the active atoms. */
static void cs_window_explain(const cs_window_sizes *z, const cs_window_active *A,
                              const real *gamma0, real *gamma)
{
    for (int i = 0; i < z->d; ++i) gamma[i] = gamma0[i];
    for (int i = 0; i < A->count; ++i) cs_window_add(gamma, -A->a[i], A->h + i * z->d, z->d);
}

/* The minimiser on the active columns with the signs they have, as `target`. */
static void cs_window_minimise(const cs_window_sizes *z, const cs_window_prior *prior,
                               cs_window_active *A)
{
    for (int i = 0; i < A->count; ++i)
        A->target[i] = A->slope[i]
                       - cs_window_half(z, prior, A->column[i], A->sign[i])
                       + cs_window_pull(z, prior, A->column[i], 0);
    cs_window_forward(A->L, z->most, A->target, A->count);
    cs_window_backward(A->L, z->most, A->target, A->count);
}

/* Go along `target` (a direction, or with `whole` a goal) until a column reaches zero; that column,
   or -1. A direction without an end is not gone. */
static int cs_window_move(const cs_window_sizes *z, const cs_window_prior *prior,
                          cs_window_active *A, int whole, real *length)
{
    int at = -1;
    *length = whole ? 1 : 0;
    for (int i = 0; i < A->count; ++i) {
        const real slope = whole ? A->target[i] - A->a[i] : A->target[i];
        const real end = whole ? A->target[i] * A->sign[i] : slope * A->sign[i];
        if (!(end < 0) || !cs_window_kinked(z, prior, A, i)) continue;
        const real step = -A->a[i] / slope;
        if (at < 0 || step < *length) { *length = step; at = i; }
    }
    for (int i = 0; i < A->count; ++i) {
        const real slope = whole ? A->target[i] - A->a[i] : A->target[i];
        A->a[i] = whole && at < 0 ? A->target[i] : A->a[i] + *length * slope;
    }
    if (at >= 0) A->a[at] = 0;
    return at;
}

/* Correlation of all columns with what is given for the modal forces. */
static void cs_window_gradients(const cs_window_sizes *z, const cs_window_prior *prior,
                                const real *modal, real *g)
{
    const int atoms = z->atoms, whole = z->width * z->p;
    for (int j = 0; j < z->steps; ++j, g += atoms) {
        const int left = z->d - j * z->p, length = left < whole ? left : whole;
        for (int a = 0; a < atoms; ++a) g[a] = 0;
        for (int k = 0; k < length; ++k)
            cs_window_add(g, modal[k + j * z->p], prior->across + k * atoms, atoms);
    }
}

/* The column that violates its condition most, by how much, and to which side; -1 if none does. */
static int cs_window_violated(const cs_window_sizes *z, const cs_window_prior *prior, const real *g,
                              const int *shut, real *worst, real *sign)
{
    int column = -1;
    for (int j = 0, i = 0; j < z->steps; ++j)
        for (int a = 0; a < z->atoms; ++a, ++i) {
            const real slope = 2 * (g[i] + prior->q[i] * prior->c[i]), side = prior->side[a];
            const real excess = (side == 0 ? real_fabs(slope) : side * slope) - prior->lam[i];
            if (!(excess > *worst) || shut[i]) continue;
            *worst = excess;
            *sign = slope > 0 ? 1 : -1;
            column = i;
        }
    return column;
}

/* The weight from which on no atom would be found. */
static real cs_window_strongest(const cs_window_sizes *z, const cs_window_prior *prior,
                                const real *g)
{
    real most = 0;
    for (int j = 0, i = 0; j < z->steps; ++j)
        for (int a = 0; a < z->atoms; ++a, ++i) {
            const real side = prior->side[a];
            const real size = 2 * (side == 0 ? real_fabs(g[i]) : side * g[i]);
            if (size > most) most = size;
        }
    return most;
}

/* Start from what is certainly active, and from the atoms of the last window; 0 if there is no room
   for all that is certain. */
static int cs_window_start(const cs_window_sizes *z, const cs_window_tables *tab, const real *T,
                            const cs_window_prior *prior, const real *g0, const real *warm,
                           cs_window_active *A, int *shut)
{
    int complete = 1;
    A->count = 0;
    for (int i = 0; i < z->n; ++i) {
        shut[i] = 0;
        if (prior->extra_q[i] > 0)
            complete &= cs_window_append(z, tab, T, prior, A, g0, z->n + i, prior->extra_c[i], 0);
    }
    for (int j = 0, i = 0; j < z->steps; ++j)
        for (int k = 0; k < z->atoms; ++k, ++i) {
            const real a = warm[i], side = prior->side[k];
            const int kinked = prior->lam[i] > 0 || side != 0;
            const int use = kinked ? a != 0 && side * a >= 0 : prior->q[i] > 0;
            if (use) shut[i] = cs_window_append(z, tab, T, prior, A, g0, i, a, a > 0 ? 1 : -1);
            complete &= kinked || !use || shut[i];
        }
    return complete;
}

/* Make a column active; if it depends on the active ones, it takes the place of one of them. */
static int cs_window_enter(const cs_window_sizes *z, const cs_window_tables *tab, const real *T,
                           const cs_window_prior *prior, cs_window_active *A, const real *g0,
                           int column, real sign, int *shut)
{
    shut[column] = 1; /* for good, if it cannot enter */
    if (A->count == z->most) return NOT_CONVERGED;
    if (cs_window_append(z, tab, T, prior, A, g0, column, 0, sign)) return DONE;
    for (int i = 0; i < A->count; ++i) A->target[i] = -sign * A->row[i];
    cs_window_backward(A->L, z->most, A->target, A->count);
    real length;
    const int at = cs_window_move(z, prior, A, 0, &length);
    if (at < 0) return DEPENDENT;
    shut[A->column[at]] = 0;
    cs_window_remove(z, A, at);
    const int entered = cs_window_append(z, tab, T, prior, A, g0, column, sign * length, sign);
    return entered ? DONE : DEPENDENT;
}

/* Feature-sign search; the number of steps and a status. gamma belongs to the result. */
static int cs_window_search(const cs_window_sizes *z, const cs_window_tables *tab, const real *T,
                            const cs_window_prior *prior, cs_window_active *A, const real *gamma0,
                            const real *g0, real *gamma, real *g, int *shut, real least,
                            int *steps)
{
    int status = DONE, fresh = -1;
    real length, sign;
    for (*steps = 1; *steps <= z->limit; ++*steps) {
        cs_window_minimise(z, prior, A);
        const int at = cs_window_move(z, prior, A, 1, &length);
        if (at >= 0) { /* what would leave at once, though it should enter, stays out for good */
            shut[A->column[at]] = A->column[at] == fresh && !(length > 0);
            if (shut[A->column[at]]) status = DEPENDENT;
            cs_window_remove(z, A, at);
            continue;
        }
        cs_window_explain(z, A, gamma0, gamma);
        real worst = least;
        cs_window_gradients(z, prior, gamma, g);
        fresh = cs_window_violated(z, prior, g, shut, &worst, &sign);
        if (fresh < 0) return status;
        const int entered = cs_window_enter(z, tab, T, prior, A, g0, fresh, sign, shut);
        if (entered == NOT_CONVERGED) break;
        if (entered == DEPENDENT) status = DEPENDENT;
    }
    cs_window_explain(z, A, gamma0, gamma);
    cs_window_gradients(z, prior, gamma, g);
    return NOT_CONVERGED;
}

/* Largest violation of the optimality conditions. */
static real cs_window_kkt(const cs_window_sizes *z, const cs_window_prior *prior,
                          const cs_window_active *A, const real *g, int *shut)
{
    real worst = 0, sign;
    for (int i = 0; i < z->n; ++i) shut[i] = 0;
    for (int i = 0; i < A->count; ++i)
        if (A->column[i] < z->n) shut[A->column[i]] = 1;
    cs_window_violated(z, prior, g, shut, &worst, &sign);
    for (int i = 0; i < A->count; ++i) {
        const int k = A->column[i], place = k < z->n ? k : k - z->n;
        const real slope = g[place] + cs_window_pull(z, prior, k, A->a[i]);
        const real off = 2 * real_fabs(slope - cs_window_half(z, prior, k, A->sign[i]));
        if (off > worst) worst = off;
    }
    return worst;
}

/* Means and covariances of states side by side, given the atoms and their covariance; x0 is the
   mean of the first state. */
static void cs_window_states(const cs_window_sizes *z, const cs_window_tables *tab,
                             const cs_window_point *points, int places, const real *T,
                             const real *x0, const real *r, const real *f,
                             const cs_window_prior *prior, const cs_window_active *A, int m, int d,
                             real *const *x, real *const *P, real *w)
{
    const int nx = z->nx, s = A->count, rows = places * nx;
    real *PhiT = w, *D = PhiT + rows * nx;
    for (int q = 0; q < places; ++q) {
        const cs_window_point *at = points + q;
        for (int i = 0; i < nx; ++i) x[q][i] = cs_window_dot(at->Kt + i * m, r, m);
        for (int k = 0; k < nx; ++k) cs_window_add(x[q], x0[k], at->Phi + k * nx, nx);
        for (int k = 0; k < d; ++k)
            if (f[k] != 0) cs_window_add(x[q], f[k], at->E + k * nx, nx);
        for (int j = 0; j < nx; ++j) {
            real *column = PhiT + q * nx + j * rows;
            for (int i = 0; i < nx; ++i) column[i] = 0;
            for (int k = 0; k < nx; ++k) cs_window_add(column, T[k + j * nx], at->Phi + k * nx, nx);
        }
        for (int i = 0; i < nx * nx; ++i) P[q][i] = at->V[i];
        for (int k = 0; k < nx; ++k)
            for (int j = 0; j < nx; ++j)
                cs_window_add(P[q] + j + j * nx, at->Phi[j + k * nx], PhiT + q * nx + j + k * rows,
                              nx - j);
    }
    int any = 0;
    for (int i = 0; i < s; ++i) { /* what an atom adds to the states, E m - Phi T F m, whitened */
        const real *values = cs_window_values(z, prior, A, i);
        const int start = A->start[i], whole = cs_window_length(z, A, i);
        const int left = d - start, length = left < whole ? left : whole;
        real *own = D + i * rows;
        for (int k = 0; k < rows; ++k) own[k] = 0;
        if (length <= 0 && !any) continue;
        any = 1;
        for (int q = 0; q < places; ++q)
            for (int k = 0; k < length; ++k)
                cs_window_add(own + q * nx, values[k], points[q].E + (start + k) * nx, nx);
        for (int k = 0; k < nx && length > 0; ++k)
            cs_window_add(own, -cs_window_dot(values, tab->Ft + start + k * d, length),
                          PhiT + k * rows, rows);
        for (int k = 0; k < i; ++k) cs_window_add(own, -A->L[i + k * z->most], D + k * rows, rows);
        for (int k = 0; k < rows; ++k) own[k] *= A->L[i + i * z->most];
        for (int q = 0; q < places; ++q)
            for (int k = 0; k < nx; ++k)
                cs_window_add(P[q] + k + k * nx, own[q * nx + k], own + q * nx + k, nx - k);
    }
    for (int q = 0; q < places; ++q)
        for (int j = 0; j < nx; ++j)
            for (int i = 0; i < j; ++i) P[q][i + j * nx] = P[q][j + i * nx];
}

/* Mean of the first state, T (Z' r - F f). */
static void cs_window_first(const cs_window_sizes *z, const cs_window_tables *tab, const real *T,
                            const real *r, const real *f, int m, int d, real *x0, real *w)
{
    const int nx = z->nx;
    for (int i = 0; i < nx; ++i)
        w[i] = cs_window_dot(tab->Z + i * m, r, m) - cs_window_dot(tab->Ft + i * d, f, d);
    for (int i = 0; i < nx; ++i) x0[i] = cs_window_dot(T + i * nx, w, nx);
}

/* Factors and variances of all atoms. */
static void cs_window_write(const cs_window_sizes *z, const cs_window_active *A, real *alpha,
                            real *extra, real *variance)
{
    const int s = A->count, most = z->most;
    for (int i = 0; i < z->n; ++i) alpha[i] = extra[i] = variance[i] = 0;
    for (int j = 0; j < s; ++j) {
        real *column = A->inverse + j * most;
        for (int i = 0; i < s; ++i) column[i] = (real)(i == j);
        cs_window_forward(A->L + j * (most + 1), most, column + j, s - j);
        const int extended = A->column[j] >= z->n, place = A->column[j] - extended * z->n;
        variance[place] += cs_window_dot(column + j, column + j, s - j);
        (extended ? extra : alpha)[place] = A->a[j];
    }
    for (int j = 0; j < s; ++j) /* both parts of an atom are active: add their covariance twice */
        for (int i = 0; i < j; ++i) {
            const int apart = A->column[i] - A->column[j];
            if (apart != z->n && apart != -z->n) continue;
            variance[apart > 0 ? A->column[j] : A->column[i]] +=
                2 * cs_window_dot(A->inverse + j * most + j, A->inverse + i * most + j, s - j);
        }
}

/* Forces over the step `at`: above the threshold and corrected, as they are, and their variance. */
static void cs_window_forces(const cs_window_sizes *z, const cs_window_active *A, const real *Psi,
                             const real *alpha, const real *extra, real threshold, int at,
                             real *forces, real *w)
{
    const int nf = z->forces;
    real kept = 0, lost = 0, factor = 1;
    for (int i = 0; i < z->n; ++i) {
        const real size = real_fabs(alpha[i] + extra[i]);
        const real part = z->correction == 2 ? size * size : size;
        if (size >= threshold) kept += part; else lost += part;
    }
    if (z->correction && kept > 0) factor = 1 + lost / kept;
    if (z->correction == 2) factor = real_sqrt(factor);
    for (int i = 0; i < 3 * nf; ++i) forces[i] = 0;
    for (int since = 0; since < z->width; ++since) {
        const int j = at - since;
        if (j < 0 || j >= z->steps) continue;
        for (int a = 0; a < z->atoms; ++a) {
            const real total = alpha[a + j * z->atoms] + extra[a + j * z->atoms];
            const real *shape = Psi + (a * z->width + since) * nf;
            if (total == 0) continue;
            if (real_fabs(total) >= threshold) cs_window_add(forces, factor * total, shape, nf);
            cs_window_add(forces + nf, total, shape, nf);
        }
    }
    for (int f = 0; f < nf; ++f) {
        for (int k = 0; k < A->count; ++k) w[k] = 0;
        for (int i = 0; i < A->count; ++i) {
            const int since = at * z->p - A->start[i];
            if (since < 0 || since >= z->width * z->p) continue;
            const real size = Psi[f + (A->which[i] * z->width + since / z->p) * nf];
            if (size != 0) cs_window_add(w + i, size, A->inverse + i * z->most + i, A->count - i);
        }
        forces[2 * nf + f] = cs_window_dot(w, w, A->count);
    }
}

static cs_window_active cs_window_room(const cs_window_sizes *z, real *w, int *iw)
{
    cs_window_active A;
    A.count = 0;
    A.column = iw;
    A.start = A.column + z->most;
    A.which = A.start + z->most;
    A.a = w;
    A.slope = A.a + z->most;
    A.target = A.slope + z->most;
    A.sign = A.target + z->most + z->nx;
    A.row = A.sign + z->most;
    A.h = A.row + z->most;
    A.t = A.h + z->most * z->d;
    A.L = A.t + z->most * z->nx;
    A.inverse = A.L + z->most * z->most;
    return A;
}

static long cs_window_room_size(const cs_window_sizes *z)
{
    const long most = z->most;
    return 5 * most + z->nx + most * (z->d + z->nx) + 2 * most * most;
}

KERNEL void cs_window_work(const int *sizes, long *reals, long *ints)
{
    const cs_window_sizes z = cs_window_read(sizes);
    const long nx = z.nx, ny = z.ny, m = z.m, d = z.d, p = z.p;
    const long place = nx * (2 * nx + m + d), state = PLACES * nx * (nx + z.most) + 2 * nx;
    const long tables = m * m + m * (nx + d) + nx * nx + nx * d + d * d + PLACES * place;
    const long filtered = 2 * nx * nx + ny * ny + ny * (nx + p) + nx * p + p * p
                          + nx * (2 * nx + ny + p) + nx;
    *reals = cs_window_room_size(&z) + nx * nx + 3 * d + 2 * m + 2 * z.n + tables + filtered + state
             + 3 * nx * nx + nx;
    *ints = 3 * z.most + z.n;
}

/* The first state of the next window from this window's first sample alone. */
static void cs_window_filtered(const cs_window_sizes *z, const real *const *arg, const real *mask,
                               const real *Pa, const real *r, const real *f,
                               const cs_window_prior *prior, const cs_window_active *A, real *x,
                               real *P, real *w)
{
    const int nx = z->nx, m = z->ny, d = z->p;
    real *T = w, *L = T + nx * nx, *Z = L + m * m, *I = Z + m * (nx + d), *Ft = I + nx * nx;
    real *H = Ft + nx * d, *place = H + d * d, *x0 = place + nx * (2 * nx + m + d);
    real *rest = x0 + nx;
    const cs_window_tables tab = {Z, I, Ft, H};
    cs_window_noise(arg[ARG_S0], z->m, mask, m, L);
    cs_window_prepare(z, arg, mask, L, m, d, Z, I, Ft, H);
    const cs_window_point point = cs_window_place(z, arg, mask, L, m, d, 1, place);
    cs_window_posterior(Pa, I, T, nx, rest);
    cs_window_first(z, &tab, T, r, f, m, d, x0, rest);
    cs_window_states(z, &tab, &point, 1, T, x0, r, f, prior, A, m, d, &x, &P, rest);
}

KERNEL void cs_window(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw)
{
    const cs_window_sizes z = cs_window_read(sizes);
    const int nx = z.nx, m = z.m, d = z.d, absent = (int)arg[ARG_ABSENT][0];
    const real *Pa = arg[ARG_PA], *options = arg[ARG_OPTIONS];
    const cs_window_prior prior = {arg[ARG_ATOMS], arg[ARG_ACROSS],  arg[ARG_LAM],
                                   arg[ARG_Q],     arg[ARG_C],       arg[ARG_EXTRA_Q],
                                   arg[ARG_EXTRA_C], arg[ARG_SIDE]};
    cs_window_active A = cs_window_room(&z, w, iw);
    int *shut = iw + 3 * z.most;
    real *T = w + cs_window_room_size(&z), *gamma0 = T + nx * nx, *gamma = gamma0 + d;
    real *f = gamma + d;
    real *r = f + d, *mask = r + m, *g0 = mask + m, *g = g0 + z.n, *rest = g + z.n;

    /* A window that is not full yet: its samples first, the coming ones not measured. */
    int complete = absent == 0;
    for (int i = 0; i < m; ++i) {
        const int from = i + absent * z.ny;
        mask[i] = from < m ? arg[ARG_MASK][from] : 0;
        r[i] = from < m && mask[i] != 0 ? arg[ARG_R][from] : 0;
        if (mask[i] == 0) complete = 0;
    }
    const int lag = (int)options[OPTION_LAG], newest = z.N - absent;
    const int at[PLACES] = {1, newest > lag ? newest - lag : 0, newest + 1};

    cs_window_tables tab = {arg[ARG_Z], arg[ARG_I], arg[ARG_FT], arg[ARG_H]};
    cs_window_point points[PLACES];
    if (complete) {
        for (int k = 0; k < PLACES; ++k) {
            points[k].Phi = arg[ARG_PHI] + k * nx * nx;
            points[k].Kt = arg[ARG_KT] + k * nx * m;
            points[k].V = arg[ARG_V] + k * nx * nx;
            points[k].E = arg[ARG_E] + k * nx * d;
        }
    } else {
        real *L = rest, *Z = L + m * m, *I = Z + m * (nx + d), *Ft = I + nx * nx;
        real *H = Ft + nx * d;
        rest = H + d * d;
        cs_window_noise(arg[ARG_S0], m, mask, m, L);
        cs_window_prepare(&z, arg, mask, L, m, d, Z, I, Ft, H);
        tab.Z = Z; tab.I = I; tab.Ft = Ft; tab.H = H;
        for (int k = 0; k < PLACES; ++k, rest += nx * (2 * nx + m + d))
            points[k] = cs_window_place(&z, arg, mask, L, m, d, at[k], rest);
    }

    int unobserved = 0;
    if (z.arrival != ARRIVAL_NONE || absent) cs_window_posterior(Pa, tab.I, T, nx, rest);
    else if (!cs_window_unknown(tab.I, T, nx, rest)) {
        unobserved = 1;
        cs_window_posterior(Pa, tab.I, T, nx, rest);
    }
    real *x0 = rest;
    rest += nx;
    for (int i = 0; i < d; ++i) f[i] = 0;
    cs_window_first(&z, &tab, T, r, f, m, d, x0, rest);
    for (int i = 0; i < d; ++i) gamma0[i] = cs_window_dot(tab.Z + (nx + i) * m, r, m);
    for (int k = 0; k < nx; ++k) cs_window_add(gamma0, -x0[k], tab.Ft + k * d, d);

    int steps;
    cs_window_gradients(&z, &prior, gamma0, g0);
    const real strongest = cs_window_strongest(&z, &prior, g0);
    const real rounding = 16 * real_epsilon * strongest, asked = options[OPTION_TOLERANCE];
    const int room = cs_window_start(&z, &tab, T, &prior, g0, arg[ARG_WARM], &A, shut);
    const int status = cs_window_search(&z, &tab, T, &prior, &A, gamma0, g0, gamma, g, shut,
                                        asked > rounding ? asked : rounding, &steps);
    for (int i = 0; i < A.count; ++i)
        cs_window_add(f + A.start[i], A.a[i], cs_window_values(&z, &prior, &A, i),
                      cs_window_length(&z, &A, i));
    cs_window_first(&z, &tab, T, r, f, m, d, x0, rest);

    cs_window_write(&z, &A, res[RES_ALPHA], res[RES_EXTRA], res[RES_VARIANCE]);
    real *x[PLACES], *P[PLACES];
    for (int k = 0; k < PLACES; ++k) {
        x[k] = res[RES_X] + k * nx;
        P[k] = res[RES_COVARIANCE] + k * nx * nx;
    }
    const int own = z.arrival == ARRIVAL_FILTERED || z.arrival == ARRIVAL_NONE;
    if (own) cs_window_filtered(&z, arg, mask, Pa, r, f, &prior, &A, x[0], P[0], rest);
    cs_window_states(&z, &tab, points + own, PLACES - own, T, x0, r, f, &prior, &A, m, d, x + own,
                     P + own, rest);
    cs_window_forces(&z, &A, arg[ARG_PSI], res[RES_ALPHA], res[RES_EXTRA],
                     options[OPTION_THRESHOLD], at[AT_OUTPUT], res[RES_FORCES], rest);
    real *info = res[RES_INFO];
    int nonzeros = 0;
    for (int i = 0; i < z.n; ++i) nonzeros += res[RES_ALPHA][i] + res[RES_EXTRA][i] != 0;
    info[0] = (real)(room ? status : NOT_CONVERGED);
    info[1] = cs_window_kkt(&z, &prior, &A, g, shut);
    info[2] = (real)steps;
    info[3] = (real)nonzeros;
    info[4] = strongest;
    info[5] = (real)unobserved;
}
