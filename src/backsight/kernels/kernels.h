/* What every kernel starts from. A kernel is a function
 *
 *     void NAME(const int *sizes, const real *const *arg, real *const *res, real *w, int *iw);
 *
 * in a file NAME.c, together with a function that says how much work space a call needs:
 *
 *     void NAME_work(const int *sizes, long *reals, long *ints);
 *
 * arg and res point to dense matrices, column by column; no result overlaps another or an argument.
 * All results are written in every call. The work space w, iw holds nothing between two calls.
 * There is no allocation, no recursion and no global variable, every loop ends, and nothing but
 * <math.h> is used. Names of helpers begin with NAME_, since an exported program includes the
 * kernels that it uses into one file. A long kernel keeps its parts in files NAME_part.h.
 */
#ifndef BACKSIGHT_KERNELS_H
#define BACKSIGHT_KERNELS_H

#include <math.h>

/* Linkage of a kernel; exported programs define it as `static inline`. */
#ifndef KERNEL
#ifdef _WIN32
#define KERNEL __declspec(dllexport)
#else
#define KERNEL
#endif
#endif

#ifdef BACKSIGHT_FLOAT
#define real float
#define real_epsilon 1.1920929e-7f
#define real_sqrt sqrtf
#define real_fabs fabsf
#define real_fmax fmaxf
#define real_fmin fminf
#else
#define real double
#define real_epsilon 2.220446049250313e-16
#define real_sqrt sqrt
#define real_fabs fabs
#define real_fmax fmax
#define real_fmin fmin
#endif

#endif
