r"""Least squares with few columns: what the searches for sparse solutions share.

Of :math:`y = H a + v` with noise of unit covariance, the searches look for a set of columns.
"""

import dataclasses
import functools
from typing import TypeAlias

import numpy as np
import scipy
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
        return self.columns.T @ self.target

    def products(self, column: int) -> Array:
        """Products of all columns with one of them, (n,); searches come back to the same ones."""
        if column not in self._known:
            self._known[column] = self.columns.T @ self.columns[:, column]
        return self._known[column]


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
        columns = problem.columns[:, kept]
        covariance = inverse(columns.T @ columns)
        values = covariance @ (columns.T @ problem.target)
        wrong = problem.side[kept] * values
        if not kept.size or wrong.min() >= 0:
            break
        kept = np.delete(kept, wrong.argmin())
    residual = problem.target - columns @ values
    return Fit(kept, values, covariance, float(residual @ residual))


def inverse(A: Array) -> Array:
    """Inverse of a matrix that may be empty."""
    return np.asarray(np.linalg.inv(A), np.float64)


def _independent(problem: Regression, which: Indices) -> Indices:
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
    factor = np.linalg.cholesky(products[:, chosen])
    both = np.column_stack([products, correlation[chosen]])
    turned = scipy.linalg.solve_triangular(factor, both, lower=True)
    seen = turned[:, :-1]
    left = squares - np.einsum("sn,sn->n", seen, seen)
    free = left > DEPENDENT * squares
    free[chosen] = False
    return np.where(free, correlation - turned[:, -1] @ seen, 0.0), np.where(free, left, 0.0)
