"""Straight-line factorisations of small symmetric matrices.

They are written for expression graphs: no pivoting and no branch that depends on data, so that
they compile to a handful of multiplications. Intended for matrices up to a dozen rows.
"""

import casadi as ca


def solve_spd(A: ca.SX, B: ca.SX) -> ca.SX:
    """Solve A X = B for symmetric positive definite A by its LDL' factorisation."""
    return solve_ldl(*ldl(A), B)


def solve_ldl(L: ca.SX, d: ca.SX, B: ca.SX) -> ca.SX:
    """Solve L diag(d) L' X = B for unit lower triangular L (n, n) and d (n,)."""
    n = L.shape[0]
    X = ca.SX(ca.densify(B))
    for i in range(n):
        for j in range(i):
            X[i, :] -= L[i, j] * X[j, :]
    for i in range(n):
        X[i, :] /= d[i]
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            X[i, :] -= L[j, i] * X[j, :]
    return X


def ldl(A: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Factor A = L diag(d) L' with unit lower triangular L (n, n) and d (n,)."""
    n = A.shape[0]
    L, d = ca.SX.eye(n), ca.SX.zeros(n)
    L = ca.SX(ca.densify(L))
    for j in range(n):
        d[j] = A[j, j] - sum((L[j, k] ** 2 * d[k] for k in range(j)), ca.SX(0))
        for i in range(j + 1, n):
            done = sum((L[i, k] * L[j, k] * d[k] for k in range(j)), ca.SX(0))
            L[i, j] = (A[i, j] - done) / d[j]
    return ca.tril(L), d


def cholesky_semidefinite(A: ca.SX) -> ca.SX:
    """Factor A = L L' for positive semidefinite A; columns of zero pivots are zero.

    A pivot below 1e-14 of its diagonal entry is rounding error and counts as zero: the direction
    carries no variance.
    """
    n = A.shape[0]
    L = ca.SX.zeros(n, n)
    for j in range(n):
        pivot = A[j, j] - sum((L[j, k] ** 2 for k in range(j)), ca.SX(0))
        keep = pivot > 1e-14 * A[j, j]
        root = ca.sqrt(ca.if_else(keep, pivot, 1.0))
        L[j, j] = ca.if_else(keep, root, 0.0)
        for i in range(j + 1, n):
            done = sum((L[i, k] * L[j, k] for k in range(j)), ca.SX(0))
            L[i, j] = ca.if_else(keep, (A[i, j] - done) / root, 0.0)
    return ca.tril(L)


def smallest_pivot(A: ca.SX) -> ca.SX:
    """Smallest pivot of A = L D L' in units of its diagonal entry: negative if A is indefinite.

    A zero pivot (a direction without variance) ends its column instead of dividing.
    """
    n = A.shape[0]
    L, d = ca.SX.zeros(n, n), []
    for j in range(n):
        d.append(A[j, j] - sum((L[j, k] ** 2 * d[k] for k in range(j)), ca.SX(0)))
        keep = ca.fabs(d[j]) > 1e-14 * ca.fabs(A[j, j])
        for i in range(j + 1, n):
            done = sum((L[i, k] * L[j, k] * d[k] for k in range(j)), ca.SX(0))
            L[i, j] = ca.if_else(keep, (A[i, j] - done) / ca.if_else(keep, d[j], 1), 0)
    sizes = [ca.if_else(A[j, j] == 0, 1, ca.fabs(A[j, j])) for j in range(n)]
    return ca.mmin(ca.vertcat(*(p / s for p, s in zip(d, sizes, strict=True))))
