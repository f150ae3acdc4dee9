/* The active atoms of a window and their factor. */
#ifndef CS_WINDOW_ACTIVE_H
#define CS_WINDOW_ACTIVE_H

#include "cs_window_tables.h"

typedef struct {
    const real *atoms, *across, *lam, *q, *c, *extra_q, *extra_c, *side, *caps;
} cs_window_prior;

/* The least squares in the first state and the active atoms: with dx = X' xi, X'X = (Pa^-1 + I)^-1,
   the information of xi is 1, so that the factor of all is [1, 0; w, L] with w = X F u for an atom
   with the modal forces u. Both triangles hold it: columns below the diagonal, rows above it, and
   reciprocals on it. The right side belongs to the factor as one more row. */
typedef struct {
    int nx, most, stride, count;
    int *column; /* place among the atoms; beyond n: the extra state of that atom */
    int *start, *which; /* its first modal force, and which atom it is */
    real *a, *sign;
    real *effect; /* what it adds to all rows of J */
    real *L, *right;
    real *row, *goal; /* of the last atom that was tried; what is to be solved for */
    const real *X;
    real *all; /* information about the factor of each, if everything else were known */
} cs_window_active;

static long cs_window_active_size(const cs_window_sizes *z)
{
    const long all = z->nx + z->most, rows = z->nx * (1 + PLACES) + z->d;
    return 3 * z->most + (z->most + 1) * rows + all * all + 3 * all;
}

static cs_window_active cs_window_room(const cs_window_sizes *z, real *w, int *iw)
{
    const int all = z->nx + z->most;
    cs_window_active A;
    A.nx = z->nx;
    A.most = z->most;
    A.stride = all;
    A.count = 0;
    A.column = iw;
    A.start = A.column + z->most;
    A.which = A.start + z->most;
    A.L = w;
    A.right = A.L + (long)all * all;
    A.row = A.right + all;
    A.goal = A.row + all;
    A.a = A.goal + all;
    A.sign = A.a + z->most;
    A.all = A.sign + z->most;
    A.effect = A.all + z->most;
    return A;
}

/* Modal forces of an active column among the first d. */
static int cs_window_length(const cs_window_sizes *z, const cs_window_active *A, int k, int d)
{
    const int left = d - A->start[k], whole = z->width * z->p;
    return left < 0 ? 0 : left < whole ? left : whole;
}

static const real *cs_window_values(const cs_window_sizes *z, const cs_window_prior *prior,
                                    const cs_window_active *A, int k)
{
    return prior->atoms + A->which[k] * z->width * z->p;
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
    return column < z->n && (prior->lam[column] > 0 || prior->side[column] != 0);
}

/* Half the slope of the prior of a column, downwards. */
static real cs_window_pull(const cs_window_sizes *z, const cs_window_prior *prior, int column,
                           real a)
{
    const int extra = column - z->n;
    return extra < 0 ? prior->q[column] * (prior->c[column] - a)
                     : prior->extra_q[extra] * (prior->extra_c[extra] - a);
}

/* Append a column to the factor, given v = W r; 0 if it depends on those before (`row` is kept). */
static int cs_window_append(const cs_window_sizes *z, const cs_window_tables *tab,
                            const cs_window_prior *prior, cs_window_active *A, const real *v,
                            int column, real a, real sign)
{
    const int s = A->count, nx = z->nx, all = nx + s, place = column % z->n;
    if (s == A->most) return 0;
    A->column[s] = column;
    A->start[s] = place / z->atoms * z->p;
    A->which[s] = place % z->atoms;
    A->a[s] = a;
    A->sign[s] = sign;
    const real *values = cs_window_values(z, prior, A, s);
    const int start = nx + A->start[s], length = cs_window_length(z, A, s, z->d);
    real *effect = A->effect + s * tab->rows, *row = A->row, *L = A->L;
    cs_window_applied(effect, tab->J + start * tab->rows, tab->rows, values, tab->rows, length);
    cs_window_applied(row, A->X, nx, effect, nx, nx);
    for (int k = 0; k < s; ++k)
        row[nx + k] = cs_window_dot(cs_window_values(z, prior, A, k), effect + nx + A->start[k],
                                    cs_window_length(z, A, k, z->d));
    cs_window_product(row + nx, -1, L + nx, A->stride, row, 1, s, nx);
    cs_window_forward(L, A->stride, row, nx, all);
    const real q = column < z->n ? prior->q[place] : prior->extra_q[place];
    A->all[s] = q + cs_window_dot(values, effect + start, length);
    const real own = A->all[s] - cs_window_dot(row, row, nx);
    const real pivot = own - cs_window_dot(row + nx, row + nx, s);
    if (!(pivot > 4096 * real_epsilon * own)) return 0;
    const real inverse = 1 / real_sqrt(pivot);
    for (int k = 0; k < all; ++k) L[k + all * A->stride] = row[k];
    for (int k = 0; k < all; ++k) L[all + k * A->stride] = row[k];
    L[all + all * A->stride] = inverse;
    A->right[all] = (cs_window_dot(values, v + start, length)
                     - cs_window_half(z, prior, column, sign) + cs_window_pull(z, prior, column, 0)
                     - cs_window_dot(row, A->right, all)) * inverse;
    A->count = s + 1;
    return 1;
}

/* Take an active column out; the rest of the factor is mended by a rank-one update. */
static void cs_window_remove(const cs_window_tables *tab, cs_window_active *A, int at)
{
    const int S = A->stride, first = A->nx + at, last = A->nx + --A->count;
    real *L = A->L, *v = A->row, *right = A->right, rest = right[first];
    for (int i = first; i < last; ++i) v[i] = L[i + 1 + first * S];
    for (int i = at; i < A->count; ++i) {
        A->column[i] = A->column[i + 1];
        A->start[i] = A->start[i + 1];
        A->which[i] = A->which[i + 1];
        A->a[i] = A->a[i + 1];
        A->sign[i] = A->sign[i + 1];
        A->all[i] = A->all[i + 1];
    }
    for (int k = at * tab->rows; k < A->count * tab->rows; ++k)
        A->effect[k] = A->effect[k + tab->rows];
    for (int k = 0; k < first; ++k)
        for (int i = first; i < last; ++i) L[i + k * S] = L[i + 1 + k * S];
    for (int j = first; j < last; ++j) {
        real *column = L + j * S;
        const real *next = column + S + 1;
        const real s = v[j] * next[j], scale = 1 / real_sqrt(1 + s * s);
        for (int k = 0; k < first; ++k) column[k] = next[k - 1];
        column[j] = next[j] * scale;
        for (int i = j + 1; i < last; ++i) {
            const real below = next[i], other = v[i];
            column[i] = L[j + i * S] = (below + s * other) * scale;
            v[i] = (other - s * below) * scale;
        }
        const real below = right[j + 1];
        right[j] = (below + s * rest) * scale;
        rest = (rest - s * below) * scale;
    }
}

/* goal = the minimiser, the first state and then the atoms with the signs they have. */
static void cs_window_minimise(cs_window_active *A)
{
    const int all = A->nx + A->count;
    for (int i = 0; i < all; ++i) A->goal[i] = A->right[i];
    cs_window_backward(A->L, A->stride, A->goal, A->nx, all);
}

/* Go along `goal` (a direction, or with `whole` a goal) until a column reaches zero; that column,
   or -1. A direction without an end is not gone. */
static int cs_window_move(const cs_window_sizes *z, const cs_window_prior *prior,
                          cs_window_active *A, int whole, real *length)
{
    const real *goal = A->goal + A->nx;
    int at = -1;
    *length = whole ? 1 : 0;
    for (int i = 0; i < A->count; ++i) {
        const real slope = whole ? goal[i] - A->a[i] : goal[i];
        const real end = whole ? goal[i] * A->sign[i] : slope * A->sign[i];
        if (!(end < 0) || !cs_window_kinked(z, prior, A, i)) continue;
        const real step = -A->a[i] / slope;
        if (at < 0 || step < *length) { *length = step; at = i; }
    }
    for (int i = 0; i < A->count; ++i) {
        const real slope = whole ? goal[i] - A->a[i] : goal[i];
        A->a[i] = whole && at < 0 ? goal[i] : A->a[i] + *length * slope;
    }
    if (at >= 0) A->a[at] = 0;
    return at;
}

#endif
