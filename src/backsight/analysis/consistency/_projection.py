"""Orthogonal projections of columns."""

import numpy as np

from backsight.types import Array


def without(basis: Array, values: Array) -> Array:
    """Take out of each column what the columns of the basis explain."""
    unit = orthonormal(basis)
    return values - unit @ (unit.T @ values)


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis of the columns, directions that they hardly have left out."""
    with np.errstate(over="ignore"):  # of a recording that holds what no sensor measures
        size = np.sqrt((columns**2).sum(axis=0))
    unit = columns[:, size > 0] / size[size > 0]
    values, vectors = np.linalg.eigh(unit.T @ unit)
    kept = values > 1e-9 * len(values)
    return unit @ (vectors[:, kept] / np.sqrt(values[kept]))
