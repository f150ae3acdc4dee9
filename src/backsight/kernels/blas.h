/* Functions of BLAS and LAPACK that kernels may call, as Fortran has them: arguments by address.
 *
 * Python fills the table in (see library.py); what is null is not there.
 */
#ifndef BACKSIGHT_BLAS_H
#define BACKSIGHT_BLAS_H

struct blas_table {
    void (*gemm)(const char *, const char *, const int *, const int *, const int *, const double *,
        const double *, const int *, const double *, const int *, const double *, double *,
        const int *);
    void (*gemv)(const char *, const int *, const int *, const double *, const double *,
        const int *, const double *, const int *, const double *, double *, const int *);
    void (*trsm)(const char *, const char *, const char *, const char *, const int *, const int *,
        const double *, const double *, const int *, double *, const int *);
    void (*trmm)(const char *, const char *, const char *, const char *, const int *, const int *,
        const double *, const double *, const int *, double *, const int *);
    void (*syrk)(const char *, const char *, const int *, const int *, const double *,
        const double *, const int *, const double *, double *, const int *);
    void (*potrf)(const char *, const int *, double *, const int *, int *);
    void (*geqrf)(const int *, const int *, double *, const int *, double *, double *, const int *,
        int *);
};

extern struct blas_table blas; /* in bridge.c */

#endif
