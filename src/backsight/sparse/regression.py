r"""Least squares with few columns: what the searches for sparse solutions share.

Of :math:`y = H a + v` with noise of unit covariance, the searches look for a set of columns.
"""

import dataclasses
import functools
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from backsight.types import Array

Indices: TypeAlias = NDArray[np.intp]
"""Numbers of columns."""

DEPENDENT = 1e-10
"""A column is dependent on others if less than this share of its square is left beside them."""


@dataclasses.dataclass(frozen=True)
class Regression:
    """Columns, target, and known signs.

    Parameters
    ----------
    columns : (m, n) array
        H; none of them zero.
    target : (m,) array
        y.
    side : (n,) array
        1 or -1 where a factor must not be negative or positive, else 0.
    """

    columns: Array
    target: Array
    side: Array
    _known: dict[int, Array] = dataclasses.field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @functools.cached_property
    def squares(self) -> Array:
        """Squared lengths of the columns, (n,)."""
        return np.einsum("mn,mn->n", self.columns, self.columns)

    @functools.cached_property
    def correlation(self) -> Array:
        """H' y, (n,)."""
        return self.onto(self.target)

    def products(self, column: int) -> Array:
        """Products of all columns with one of them, (n,); searches come back to the same ones."""
        if column not in self._known:
            self._known[column] = self.onto(self.columns[:, column])
        return self._known[column]

    def onto(self, vector: Array) -> Array:
        """Products of all columns with a vector, (n,)."""
        # Not by BLAS: for a product of this size its threads cost more than they save, and on a
        # busy machine a hundred times more.
        return np.einsum("mn,m->n", self.columns, vector)


@dataclasses.dataclass(frozen=True)
class Fit:
    """Least squares on some columns.

    Parameters
    ----------
    which : (s,) array
        Numbers of the columns.
    values : (s,) array
        Their factors.
    covariance : (s, s) array
        Of the factors.
    cost : float
        Sum of the squared residuals.
    """

    which: Indices
    values: Array
    covariance: Array
    cost: float


def refit(problem: Regression, which: Indices) -> Fit:
    """Fit the chosen columns without any penalty; those that depend on earlier ones are left out.

    A factor whose sign is not allowed is left out as well, the worst first.
    """
    kept = _independent(problem, which)
    while True:
        covariance = inverted(_gram(problem, kept))
        values = covariance @ problem.correlation[kept]
        wrong = problem.side[kept] * values
        if not kept.size or wrong.min() >= 0:
            break
        kept = np.delete(kept, wrong.argmin())
    residual = problem.target - np.einsum("ms,s->m", problem.columns[:, kept], values)
    return Fit(kept, values, covariance, float(residual @ residual))


def inverted(A: Array) -> Array:
    """Inverse of a matrix that may be empty."""
    return np.asarray(np.linalg.inv(A), np.float64)


def _gram(problem: Regression, which: Indices) -> Array:
    return np.array([problem.products(int(i))[which] for i in which]).reshape(2 * [len(which)])


def _independent(problem: Regression, which: Indices) -> Indices:
    """Those of the columns that do not depend on earlier ones."""
    size = np.sqrt(problem.squares[which])
    try:
        pivots = np.diag(np.linalg.cholesky(_gram(problem, which) / np.outer(size, size)))
    except np.linalg.LinAlgError:
        pivots = np.zeros(1)
    if (pivots**2 > DEPENDENT).all():
        return which
    kept: list[int] = []
    basis = np.zeros((len(problem.target), 0))
    for i in which:
        column = problem.columns[:, i]
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        size = rest @ rest
        if size > DEPENDENT * (column @ column):
            kept.append(int(i))
            basis = np.column_stack([basis, rest / np.sqrt(size)])
    return np.array(kept, np.intp)


def beside(problem: Regression, chosen: Indices) -> tuple[Array, Array]:
    """Correlation with the residual, and squared length, of all columns beside the chosen ones.

    Of a column that depends on the chosen ones both are zero.
    """
    squares, correlation = problem.squares, problem.correlation
    if not len(chosen):
        return correlation, squares
    products = np.array([problem.products(int(i)) for i in chosen])
    factor = np.asarray(np.linalg.cholesky(products[:, chosen]), np.float64)
    both = np.column_stack([products, correlation[chosen]])
    turned = np.einsum("ij,jn->in", inverted(factor), both)
    seen = turned[:, :-1]
    left = squares - np.einsum("sn,sn->n", seen, seen)
    free = left > DEPENDENT * squares
    free[chosen] = False
    return np.where(free, correlation - turned[:, -1] @ seen, 0.0), np.where(free, left, 0.0)
