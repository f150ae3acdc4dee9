"""Triangular factors of covariances: compress, update, downdate, solve."""

import casadi as ca


def compress(A: ca.SX) -> ca.SX:
    """Lower triangular L (n, n) with L L' = A A' and no negative diagonal, for A (n, m).

    By modified Gram-Schmidt on the rows, whose triangular factor is as accurate as Householder's
    (Björck 1967, doi:10.1007/BF01934122). A row that depends on the rows above gets a zero pivot.
    """
    n = A.shape[0]
    rows = [ca.SX(A[i, :]) for i in range(n)]
    L = ca.SX.zeros(n, n)
    for i in range(n):
        L[i, i] = ca.norm_2(rows[i])
        direction = rows[i] / ca.if_else(L[i, i] > 0, L[i, i], 1)
        for j in range(i + 1, n):
            L[j, i] = ca.dot(rows[j], direction)
            rows[j] = rows[j] - L[j, i] * direction
    return ca.tril(L)


def downdate(L: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Factor of L L' - v v', and 1 if that is positive definite, else 0.

    By hyperbolic rotations. Where a pivot would not be positive the old one stays, so that the
    factor is finite; the flag says that it must not be used.
    """
    n = L.shape[0]
    L, v = ca.SX(ca.densify(L)), ca.SX(v)
    definite = ca.SX(1)
    for k in range(n):
        square = L[k, k] ** 2 - v[k] ** 2
        positive = square > 0
        definite = ca.if_else(positive, definite, 0)
        pivot = ca.sqrt(ca.if_else(positive, square, L[k, k] ** 2))
        for i in range(k + 1, n):
            below = (L[i, k] * L[k, k] - v[i] * v[k]) / pivot
            v[i] = (v[i] * L[k, k] - L[i, k] * v[k]) / pivot
            L[i, k] = below
        L[k, k] = pivot
    return ca.tril(L), definite


def forward(L: ca.SX, B: ca.SX) -> ca.SX:
    """Solve L X = B for lower triangular L (n, n) and B (n, m)."""
    X = ca.SX(ca.densify(B))
    for i in range(L.shape[0]):
        for j in range(i):
            X[i, :] -= L[i, j] * X[j, :]
        X[i, :] /= L[i, i]
    return X


def forward_semidefinite(L: ca.SX, b: ca.SX, *, least: ca.SX | float) -> ca.SX:
    """Solve L x = b for lower triangular L (n, n) and b (n,); 0 where the pivot is not above least.

    For equations of which some follow from those before.
    """
    x: list[ca.SX] = []
    for i in range(L.shape[0]):
        left = b[i] - sum((L[i, j] * x[j] for j in range(i)), ca.SX(0))
        some = L[i, i] > least
        x.append(ca.if_else(some, left / ca.if_else(some, L[i, i], 1), 0))
    return ca.vertcat(*x)


def fixed_directions(A: ca.SX, b: ca.SX, *, least: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """What the equations A x = b (m, n) fix: V x = y with orthonormal rows of V, and how many not.

    By modified Gram-Schmidt. A row of which no more than `least` is left beside those above it
    follows from them; its row of V and its y are zero.
    """
    rows, goal = ca.SX(ca.densify(A)), ca.SX(ca.densify(b))
    V, y, follows = [], [], ca.SX(0)
    for i in range(rows.shape[0]):
        length = ca.norm_2(rows[i, :])
        tells = length > least
        by = ca.if_else(tells, 1 / ca.if_else(tells, length, 1), 0)
        V.append(by * rows[i, :])
        y.append(by * goal[i])
        follows += 1 - tells
        for j in range(i + 1, rows.shape[0]):
            along = ca.dot(rows[j, :], V[i])
            rows[j, :] -= along * V[i]
            goal[j] -= along * y[i]
    return ca.densify(ca.vertcat(*V)), ca.vertcat(*y), follows


def upper_triangular(A: ca.SX, B: ca.SX) -> ca.SX:
    """Q' B for the orthogonal Q' (m, m) that makes A (m, n) upper triangular, by Householder.

    Golub and Van Loan, "Matrix Computations", 2013, section 5.2.
    """
    A, B = ca.SX(ca.densify(A)), ca.SX(ca.densify(B))
    m, n = A.shape
    for j in range(min(n, m - 1)):
        size = ca.norm_2(A[j:, j])
        v = ca.SX(A[j:, j])
        v[0] += ca.if_else(v[0] < 0, -size, size)
        square = ca.dot(v, v)
        scale = 2 / ca.if_else(square > 0, square, 1)
        A[j:, j:] -= scale * v @ (v.T @ A[j:, j:])
        B[j:, :] -= scale * v @ (v.T @ B[j:, :])
    return B


NOTHING = 1e-12
"""A pivot below this share of its row is rounding error: the direction carries no variance."""


def backward_semidefinite(L: ca.SX, B: ca.SX) -> ca.SX:
    """Solve L' X = B for the lower factor L (n, n) of a covariance and B (n, m).

    Rows of X that belong to directions without variance are zero.
    """
    X = ca.SX(ca.densify(B))
    for i in reversed(range(L.shape[0])):
        for j in range(i + 1, L.shape[0]):
            X[i, :] -= L[j, i] * X[j, :]
        some = L[i, i] > NOTHING * ca.norm_2(L[i, :])
        X[i, :] = ca.if_else(some, X[i, :] / ca.if_else(some, L[i, i], 1), 0)
    return X
