"""Sparse factors of symmetric matrices, and an order of the rows in which they are small."""

import dataclasses
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from backsight.types import Array, Sparse

SLENDER = 5.0
"""Profile by the number of entries below which factors within the profile are the smaller ones.

Measured, with the entries of both factors: a tower of 8 x 8 bricks 4.1, a plate of 60 x 60 9.
"""

_SOLVED = 1e-8
"""Backward error of a solution by factors without a choice of pivots."""


class ShiftedSolutions:
    """Solutions by sparse factors, which are made when they are needed and not kept for ever.

    Those of 10^5 coordinates take a gigabyte, as do those by which modes are counted.
    """

    def __init__(self, A: Sparse) -> None:
        self._matrix = A
        self._factor = sparse_factor(A)
        self.regular = self._factor is not None

    def solve(self, b: Array) -> Array:
        """Solution for one or more columns."""
        factor = self._factor or sparse_factor(self._matrix)
        if factor is None:
            raise np.linalg.LinAlgError("the matrix has no factors that solve it")
        self._factor = factor
        return factor.solve(b)

    def forget(self) -> None:
        """Free the memory until the next solution."""
        self._factor = None


@dataclasses.dataclass(frozen=True)
class SparseFactor:
    """Sparse factors of a symmetric matrix whose rows and columns were put in another order."""

    factor: Any
    order: NDArray[np.int32]

    def solve(self, b: Array) -> Array:
        """Solution for one or more columns."""
        x = np.empty(b.shape)
        x[self.order] = self.factor.solve(b[self.order])
        return x

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues; None if the pivots do not tell."""
        if not np.array_equal(self.factor.perm_r, self.factor.perm_c):
            return None
        return int((self.factor.U.diagonal() < 0).sum())


def sparse_factor(A: Sparse) -> SparseFactor | None:
    """Sparse factors of a symmetric matrix, or None if they do not solve it."""
    A = scipy.sparse.csc_array(A)
    order, banded = _order(A)
    try:
        # Pivots stay on the diagonal: half the work, and their signs are those of the eigenvalues.
        factor = scipy.sparse.linalg.splu(
            A[order][:, order],
            permc_spec="NATURAL" if banded else "MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return None
    found = SparseFactor(factor, order)
    b = np.random.default_rng(0).standard_normal(A.shape[0])
    x = found.solve(b)
    error = np.abs(A @ x - b)
    return found if (error <= _SOLVED * (abs(A) @ np.abs(x) + np.abs(b))).all() else None


def _order(A: Sparse) -> tuple[NDArray[np.int32], bool]:
    """Order of the rows for little work, and whether it is the best one as it is.

    The bandwidth is reduced (Cuthill and McKee). Of what is slender, a tower or a bridge, the
    factors within the profile are smaller than those of minimum degree; of all else minimum degree
    does better from there than from the numbering of a mesh. Bodies without a connection stay
    as they are numbered: put in one order, copies of a body all round alike, and Lanczos, which
    tells modes of one frequency apart by rounding, does not end.
    """
    if scipy.sparse.csgraph.connected_components(A, directed=False, return_labels=False) > 1:
        return np.arange(A.shape[0], dtype=np.int32), False
    order = scipy.sparse.csgraph.reverse_cuthill_mckee(A, symmetric_mode=True)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    rows, columns = place[A.indices], np.repeat(place, np.diff(A.indptr))
    first = np.arange(len(order))
    np.minimum.at(first, rows, columns)
    profile = float((np.arange(len(order)) - first).sum())
    return order, profile < SLENDER * A.nnz
