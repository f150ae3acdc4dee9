/* The atoms of a window beside those that are chosen: what each would lower the cost by.

   With the first state minimised out, atoms have the products G and the data the products b with
   them. Of the chosen atoms S, G_SS = L L' is factorised, and the factor is continued to all atoms,

       U = L^-1 G_S,  y = L^-1 b_S,   s = b - U' y,  d = diag(G) - (sum of squares of U),

   so that an atom i lowers the cost by s_i^2 / d_i (Gram-Schmidt; Chen, Billings, Luo 1989,
   doi:10.1080/00207178908953472). With the inverse M of L, the chosen atom j has the factor
   a_j = (M' y)_j and the variance v_j = (M' M)_jj; all others share (M' U)_j of it, and without it

       s_i -> s_i + (M' U)_ji a_j / v_j,   d_i -> d_i + (M' U)_ji^2 / v_j.

   So an exchange is looked at for all atoms by one row, without another factor. */
#ifndef CS_WINDOW_CANDIDATES_H
#define CS_WINDOW_CANDIDATES_H

#include "cs_window_problem.h"

/* Matrices have a row of n numbers for each chosen atom, or for each number of the first state. */
typedef struct {
    int count, room, *column; /* chosen atoms, how many there may be, and which they are */
    real *lead; /* X F u of all atoms, as in `cs_window_active` */
    real *base, *factor; /* G_S and U */
    real *product, *size; /* b and diag(G) */
    real *slope, *left; /* s and d */
    real *share; /* of a chosen atom, in all others */
    real *y, *a, *M; /* M row by row, `room` numbers each */
    real *effect; /* modal forces */
} cs_window_candidates;

static int cs_window_candidates_room(const cs_window_sizes *z)
{
    return z->chosen < z->most ? z->chosen : z->most;
}

static long cs_window_candidates_size(const cs_window_sizes *z)
{
    const long room = cs_window_candidates_room(z), n = z->n;
    return z->chosen ? n * (z->nx + 2 * room + 5) + room * (room + 2) + z->d + 2 * z->nx : 0;
}

/* All atoms, none of them chosen; w takes `cs_window_candidates_size`, `column` as many as there may
   be. */
static cs_window_candidates cs_window_offer(cs_window_problem *k, real *w, int *column)
{
    const cs_window_sizes *z = k->z;
    const int n = z->n, nx = z->nx, rows = k->tab.rows, whole = z->width * z->p;
    cs_window_candidates t;
    t.count = 0;
    t.room = cs_window_candidates_room(z);
    t.column = column;
    t.lead = w;
    t.base = t.lead + n * nx;
    t.factor = t.base + t.room * n;
    t.product = t.factor + t.room * n;
    t.size = t.product + n;
    t.slope = t.size + n;
    t.left = t.slope + n;
    t.share = t.left + n;
    t.y = t.share + n;
    t.a = t.y + t.room;
    t.M = t.a + t.room;
    t.effect = t.M + t.room * t.room;
    real *pull = t.effect + z->d, *lead = pull + nx;
    k->A.count = 0;
    cs_window_first(&k->A, k->x0, pull);
    cs_window_explain(&k->tab, &k->A, k->v, k->x0, nx, z->d, t.effect);
    cs_window_gradients(z, &k->prior, t.effect, t.product);
    for (int i = 0; i < n; ++i) {
        const int from = i / z->atoms * z->p, rest = z->d - from, length = rest < whole ? rest : whole;
        const real *values = k->prior.atoms + i % z->atoms * whole;
        const real *J = k->tab.J + (long)(nx + from) * rows;
        for (int q = 0; q < nx; ++q) pull[q] = lead[q] = 0;
        for (int q = 0; q < length; ++q) t.effect[q] = 0;
        cs_window_product(pull, 1, J, rows, values, 1, nx, length);
        cs_window_product(lead, 1, k->X, nx, pull, 1, nx, nx);
        cs_window_product(t.effect, 1, J + nx + from, rows, values, 1, length, length);
        for (int q = 0; q < nx; ++q) t.lead[i + q * n] = lead[q];
        t.size[i] = cs_window_dot(values, t.effect, length) - cs_window_dot(lead, lead, nx);
        t.slope[i] = t.product[i];
        t.left[i] = t.size[i];
    }
    return t;
}

/* Whether an atom is no sum of those that are chosen. */
static int cs_window_apart(const cs_window_candidates *t, int i, real left)
{
    return left > 4096 * real_epsilon * t->size[i];
}

/* Row s of the factor, of a chosen atom behind those before it. */
static void cs_window_continue(cs_window_candidates *t, int n, int s)
{
    real *row = t->factor + s * n, *M = t->M + s * t->room;
    const real *base = t->base + s * n;
    const int column = t->column[s];
    const real scale = 1 / real_sqrt(t->left[column]);
    for (int i = 0; i < n; ++i) row[i] = base[i];
    cs_window_product(row, -1, t->factor, n, t->factor + column, n, n, s);
    for (int i = 0; i < n; ++i) row[i] *= scale;
    for (int j = 0; j < s; ++j) M[j] = 0;
    for (int j = 0; j < s; ++j) /* row s of L, and of its inverse */
        cs_window_add(M, -scale * t->factor[column + j * n], t->M + j * t->room, j + 1);
    M[s] = scale;
    t->y[s] = t->slope[column] * scale;
    cs_window_add(t->slope, -t->y[s], row, n);
    for (int i = 0; i < n; ++i) t->left[i] -= row[i] * row[i];
    t->left[column] = 0;
    t->count = s + 1;
}

/* Choose an atom that is apart from the chosen ones. */
static void cs_window_take(const cs_window_problem *k, cs_window_candidates *t, int column)
{
    const cs_window_sizes *z = k->z;
    const int n = z->n, s = t->count, whole = z->width * z->p, rows = k->tab.rows;
    const int from = column / z->atoms * z->p, rest = z->d - from, length = rest < whole ? rest : whole;
    real *base = t->base + s * n;
    t->column[s] = column;
    for (int i = 0; i < z->d; ++i) t->effect[i] = 0;
    cs_window_product(t->effect, 1, k->tab.J + (long)(z->nx + from) * rows + z->nx, rows,
                      k->prior.atoms + column % z->atoms * whole, 1, z->d, length);
    cs_window_gradients(z, &k->prior, t->effect, base);
    cs_window_product(base, -1, t->lead, n, t->lead + column, n, n, z->nx);
    cs_window_continue(t, n, s);
}

/* The factor of the first atoms anew, as they are in `column` and `base`. */
static void cs_window_refactor(cs_window_candidates *t, int n, int count)
{
    for (int i = 0; i < n; ++i) {
        t->slope[i] = t->product[i];
        t->left[i] = t->size[i];
    }
    for (int s = 0; s < count; ++s) cs_window_continue(t, n, s);
    t->count = count;
}

/* Put a chosen atom behind the others, which keep their order; the factor is that of another order
   then. */
static void cs_window_put_last(cs_window_candidates *t, int n, int at)
{
    const int column = t->column[at], last = t->count - 1;
    for (int i = 0; i < n; ++i) {
        const real own = t->base[i + at * n];
        for (int s = at; s < last; ++s) t->base[i + s * n] = t->base[i + (s + 1) * n];
        t->base[i + last * n] = own;
    }
    for (int s = at; s < last; ++s) t->column[s] = t->column[s + 1];
    t->column[last] = column;
}

/* Factors of the chosen atoms. */
static void cs_window_settle(cs_window_candidates *t)
{
    for (int j = 0; j < t->count; ++j) t->a[j] = 0;
    for (int s = 0; s < t->count; ++s) cs_window_add(t->a, t->y[s], t->M + s * t->room, s + 1);
}

/* Variance of a chosen atom, the others free, and what all others share of it. */
static real cs_window_shared(cs_window_candidates *t, int n, int at)
{
    const real *M = t->M + at;
    real variance = 0;
    for (int i = 0; i < n; ++i) t->share[i] = 0;
    for (int s = at; s < t->count; ++s) variance += M[s * t->room] * M[s * t->room];
    cs_window_product(t->share, 1, t->factor + at * n, n, M + at * t->room, t->room, n,
                      t->count - at);
    return variance;
}

/* Whether an atom lowers the cost by more than `least`, given what is left of its product with the data
   and of its square; not if its sign is not allowed or it depends on the chosen ones. */
static int cs_window_gains(const cs_window_problem *k, const cs_window_candidates *t, int i, real slope,
                           real left, real least)
{
    return slope * slope > least * left && cs_window_apart(t, i, left)
           && !(k->prior.side[i] * slope < 0);
}

/* The atom that lowers the cost most beside the chosen ones, and by how much; -1 if none does. */
static int cs_window_best(const cs_window_problem *k, const cs_window_candidates *t, real *gain)
{
    int best = -1;
    *gain = 0;
    for (int i = 0; i < k->z->n; ++i) {
        if (!cs_window_gains(k, t, i, t->slope[i], t->left[i], *gain)) continue;
        *gain = t->slope[i] * t->slope[i] / t->left[i];
        best = i;
    }
    return best;
}

/* The same in place of a chosen one, given its factor, its variance and what all share of it. */
static int cs_window_better(const cs_window_problem *k, const cs_window_candidates *t, real a,
                            real variance, real *gain)
{
    int best = -1;
    const real information = 1 / variance;
    *gain = 0;
    for (int i = 0; i < k->z->n; ++i) {
        const real part = t->share[i] * information, slope = t->slope[i] + part * a;
        const real left = t->left[i] + part * t->share[i];
        if (!cs_window_gains(k, t, i, slope, left, *gain)) continue;
        *gain = slope * slope / left;
        best = i;
    }
    return best;
}

/* Choose an atom; 0, and all is as before, if one of a known sign would change it. */
static int cs_window_choose(const cs_window_problem *k, cs_window_candidates *t, int column)
{
    if (!cs_window_apart(t, column, t->left[column])) return 0;
    cs_window_take(k, t, column);
    cs_window_settle(t);
    for (int i = 0; i < t->count && k->z->sided; ++i)
        if (k->prior.side[t->column[i]] * t->a[i] < 0) {
            cs_window_refactor(t, k->z->n, t->count - 1);
            cs_window_settle(t);
            return 0;
        }
    return 1;
}

#endif
