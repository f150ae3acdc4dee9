"""Symmetric matrices as their lower triangle, column by column (vech)."""

import casadi as ca
import numpy as np


def vech(A: ca.SX) -> ca.SX:
    """Stack the lower triangle of a symmetric matrix: (n, n) to (n (n + 1) / 2,)."""
    n = A.shape[0]
    return ca.vertcat(*(A[j:, j] for j in range(n)))


def unvech(v: ca.SX) -> ca.SX:
    """Fill a symmetric matrix from its lower triangle: (n (n + 1) / 2,) to (n, n)."""
    n = side(v.shape[0])
    columns, rows = np.triu_indices(n)
    places = np.empty((n, n), dtype=int)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return ca.reshape(v[places.ravel().tolist()], n, n)


def side(length: int) -> int:
    """Number of rows of the matrix whose lower triangle has the given length."""
    return int((8 * length + 1) ** 0.5 - 1) // 2
