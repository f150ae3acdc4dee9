/* Makes every kernel of the library a function that CasADi's virtual machine can call.
 *
 * KERNELS is a list X(one) X(other). CasADi asks an external function for its sizes when the
 * function is made, and never again; foreign_declare says them just before. The first argument of
 * a call is how many sizes there are for the kernel, and then these.
 */
#include "kernels.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

#define TEXT_OF(symbol) #symbol
#define TEXT(symbol) TEXT_OF(symbol)

typedef long long integer; /* casadi_int */
typedef void (*kernel)(
    const int *sizes, const real *const *arg, real *const *res, real *w, int *iw);

static struct {
    integer inputs, outputs, reals, ints;
    const integer *shapes; /* rows, columns, 1 of all inputs and outputs */
} declared;

EXPORT void foreign_declare(
    integer inputs, integer outputs, integer reals, integer ints, const integer *shapes)
{
    declared.inputs = inputs;
    declared.outputs = outputs;
    declared.reals = reals;
    declared.ints = ints;
    declared.shapes = shapes;
}

#ifdef BACKSIGHT_BLAS
#include "blas.h"

struct blas_table blas;

/* Addresses in the order of the table, before any kernel runs. */
EXPORT void foreign_blas(const struct blas_table *addresses) { blas = *addresses; }
#endif

/* Names the sources that the library was made of. */
EXPORT const char *foreign_sources(void) { return TEXT(SOURCES); }

/* Python looks for this name in a library of a package; nothing imports it. */
EXPORT void *PyInit__backsight(void) { return 0; }

static int call(kernel apply, const double **arg, double **res, integer *iw, double *w)
{
    const int count = (int)arg[0][0];
    int *sizes = (int *)iw;
    int i;
    for (i = 0; i < count; ++i)
        sizes[i] = (int)arg[0][i + 1];
    apply(sizes, arg + 1, res, w, sizes + count);
    return 0;
}

#define X(NAME) \
    void NAME(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw); \
    EXPORT int foreign_##NAME(const double **arg, double **res, integer *iw, double *w, int mem) \
    { \
        (void)mem; \
        return call(NAME, arg, res, iw, w); \
    } \
    EXPORT integer foreign_##NAME##_n_in(void) { return declared.inputs; } \
    EXPORT integer foreign_##NAME##_n_out(void) { return declared.outputs; } \
    EXPORT const integer *foreign_##NAME##_sparsity_in(integer i) \
    { \
        return declared.shapes + 3 * i; \
    } \
    EXPORT const integer *foreign_##NAME##_sparsity_out(integer i) \
    { \
        return declared.shapes + 3 * (declared.inputs + i); \
    } \
    EXPORT int foreign_##NAME##_work(integer *args, integer *results, integer *ints, integer *reals) \
    { \
        *args = declared.inputs; \
        *results = declared.outputs; \
        *ints = declared.ints; \
        *reals = declared.reals; \
        return 0; \
    }

KERNELS
