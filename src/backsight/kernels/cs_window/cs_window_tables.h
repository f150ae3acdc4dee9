/* The problem of a window, and what follows from its model and from what was measured. */
#ifndef CS_WINDOW_TABLES_H
#define CS_WINDOW_TABLES_H

#include "cs_window_algebra.h"

enum { AT_ARRIVAL, AT_OUTPUT, AT_NEXT, PLACES }; /* the first is left out if it is filtered */
enum { ARRIVAL_NONE, ARRIVAL_CONSTANT, ARRIVAL_FILTERED, ARRIVAL_SMOOTHED };

/* Arguments: the problem; its tables where all was measured; the atoms; the window. */
enum {
    ARG_O, ARG_G, ARG_S0, ARG_POWERS, ARG_P, ARG_CROSS, ARG_MOVED, ARG_NOISE,
    ARG_W, ARG_J, ARG_V, ARG_L,
    ARG_ATOMS, ARG_ACROSS, ARG_PSI, ARG_SIDE, ARG_CAPS, ARG_GROUP, ARG_OPTIONS,
    ARG_R, ARG_MASK, ARG_LOW, ARG_HIGH, ARG_ABSENT, ARG_PA, ARG_LAM, ARG_Q, ARG_C, ARG_EXTRA_Q,
    ARG_EXTRA_C, ARG_WARM
};

/* The rows of a sample are its outputs, and then the sums that have limits. */
typedef struct {
    int nx, ny, p, width, atoms, steps, N, forces, most, limit, arrival, correction, carries;
    int limits, bounded; /* sums with limits of a sample; whether there are any, or atoms with limits */
    int varying; /* whether the tables are those of this window alone */
    int sided; /* whether some atoms have a known sign */
    int passes, chosen; /* with weights that shrink; most atoms if their number is what counts */
    int outputs, m, d, n, columns; /* rows, modal forces, atoms of the window; with extra states */
} cs_window_sizes;

/* Given the forces f and the first state dx, the states of interest are K r + Phi dx + E f with
   covariance V. Rows lie on top of each other:

       W = [O'; G'; cross'] L'^-1,   J = [O' S0^-1 O, O' S0^-1 G; G' S0^-1 O, G' S0^-1 G; -Phi, -E]

   so that W L^-1 r - J [dx; f] is the gradient, halved, and the states, with S0 = L L'. r has the rows
   that count. `whole`: W has L^-1 in it and takes r itself. */
typedef struct {
    int nx, d, m, rows, whole;
    const real *W, *J, *V; /* V: the covariances on top of each other */
    const real *L; /* factor of S0, with reciprocals on its diagonal */
} cs_window_tables;

/* Rows that count: measured outputs with the weight of their sample, limits that are active. */
typedef struct {
    int count;
    int *used;
    real *weight, *soft; /* of all rows: 0 does not count; variance of an active limit */
} cs_window_rows;

static cs_window_sizes cs_window_read(const int *s)
{
    cs_window_sizes z = {s[0],  s[1],  s[2],  s[3],  s[4],  s[5], s[6], s[7], s[8], s[9], s[10],
                         s[11], s[12], s[13], s[14], s[15], s[16], s[17], s[18], 0, 0, 0, 0, 0};
    z.outputs = z.ny - z.limits;
    z.m = z.ny * (z.N + 1);
    z.d = z.p * z.steps;
    z.n = z.atoms * z.steps;
    z.columns = z.n * (1 + z.carries);
    return z;
}

/* Numbers that the tables take, and the work space to make them. */
static long cs_window_tables_size(long nx, long d, long m, long places)
{
    const long rows = nx + d + places * nx;
    return m * m + rows * (m + rows) + places * nx * nx;
}

/* Number the first m rows that count. */
static void cs_window_number(cs_window_rows *rows, int m)
{
    rows->count = 0;
    for (int i = 0; i < m; ++i)
        if (rows->weight[i] != 0) rows->used[rows->count++] = i;
}

/* Covariance of two rows, each times its weight: what the motion adds is weighted with them, the noise
   of the sensors is as large as it nominally is. */
static real cs_window_noise(const cs_window_sizes *z, const real *const *arg,
                            const cs_window_rows *rows, int i, int j)
{
    const real both = rows->weight[i] * rows->weight[j], all = arg[ARG_S0][i + j * z->m];
    const real soft = i == j && z->limits ? rows->soft[i] : 0;
    if (both == 1 || i / z->ny != j / z->ny) return both * all + soft;
    const real own = arg[ARG_NOISE][i % z->ny + j % z->ny * z->ny];
    return both * (all - own) + own + soft;
}

/* How a modal force moves the state `at`: forces begin at a step, and what they do depends on it, or
   only on how long ago that is. */
static const real *cs_window_moved(const cs_window_sizes *z, const real *moved, int at, int force)
{
    const int on = at - 1 - force / z->p; /* steps that the force has moved on for */
    if (z->varying) return moved + (long)(at * z->d + force) * z->nx;
    return on >= 0 ? moved + (on * z->p + force % z->p) * z->nx : 0;
}

/* Tables of the rows that count and d modal forces, times their weights, for the states `at`. */
static cs_window_tables cs_window_prepare(const cs_window_sizes *z, const real *const *arg,
                                          const cs_window_rows *counting, int d, const int *at,
                                          int places, real *w)
{
    const int nx = z->nx, known = nx + d, rows = known + places * nx, m = counting->count;
    real *L = w, *W = L + m * m, *J = W + rows * m, *V = J + rows * rows;
    for (int j = 0; j < m; ++j)
        for (int i = j; i < m; ++i)
            L[i + j * m] = cs_window_noise(z, arg, counting, counting->used[i], counting->used[j]);
    cs_window_factor(L, m);
    cs_window_ready(L, m);
    for (int i = 0; i < m; ++i) { /* L^-1 [O G cross]', row by row, as columns of W */
        real *row = W + i * rows;
        const int of = counting->used[i];
        const real weight = counting->weight[of];
        for (int k = 0; k < nx; ++k) row[k] = weight * arg[ARG_O][of + k * z->m];
        for (int k = 0; k < d; ++k) row[nx + k] = weight * arg[ARG_G][of + k * z->m];
        for (int q = 0; q < places; ++q)
            for (int k = 0; k < nx; ++k)
                row[known + q * nx + k] = weight * arg[ARG_CROSS][of + (at[q] * nx + k) * z->m];
        /* forces of later steps do nothing to this output: theirs are zeros */
        const int begun = nx + (of / z->ny + 1) * z->p, lower = begun < known ? begun : known;
        cs_window_product(row, -1, W, rows, L + i, m, lower, i);
        cs_window_product(row + known, -1, W + known, rows, L + i, m, rows - known, i);
        for (int k = 0; k < rows; ++k) row[k] *= L[i + i * m];
    }
    for (int j = 0, from = 0; j < rows; ++j) { /* of the states only what is of one of them */
        const int end = j < known ? rows : known + ((j - known) / nx + 1) * nx;
        real *column = J + j * rows;
        if (j >= nx && j < known) /* outputs before a force do not know of it */
            while (from < m && counting->used[from] / z->ny < (j - nx) / z->p) ++from;
        const int first = j < known ? from - from % 4 : 0; /* sums in fours round as whole ones do */
        for (int i = j; i < rows; ++i) column[i] = 0;
        cs_window_product(column + j, 1, W + j + first * rows, rows, W + j + first * rows, rows, end - j,
                          m - first);
    }
    for (int j = 0; j < known; ++j)
        for (int i = 0; i < j; ++i) J[i + j * rows] = J[j + i * rows];
    for (int q = 0; q < places; ++q)
        for (int k = 0; k < nx; ++k) {
            const int row = known + q * nx + k, from = at[q] * nx;
            for (int j = 0; j < nx; ++j) {
                const int col = known + q * nx + j, low = row > col ? row : col;
                V[q * nx + k + j * places * nx] =
                    arg[ARG_P][k + (from + j) * nx] - J[low + (row + col - low) * rows];
                J[row + j * rows] -= arg[ARG_POWERS][k + (from + j) * nx];
            }
            for (int j = 0; j < d; ++j) {
                const real *moved = cs_window_moved(z, arg[ARG_MOVED], at[q], j);
                if (moved) J[row + (nx + j) * rows] -= moved[k];
            }
        }
    const cs_window_tables tables = {nx, d, m, rows, 0, W, J, V, L};
    return tables;
}

#endif
