"""A matrix with the names of its coordinates, as files of finite-element programs hold it."""

import dataclasses
from typing import Any

import numpy as np

from backsight.errors import DataError

EPS = float(np.finfo(float).eps)


@dataclasses.dataclass(frozen=True)
class Matrix:
    """A sparse matrix, and what is known of it.

    Parameters
    ----------
    values : (n, m) sparse array
        The numbers; duplicates are summed.
    coordinates : tuple of str
        Names of the rows, ``"node:direction"`` as in ``"12:UX"``; empty if the file has none.
    precision : float
        Relative rounding of the entries as they are written: half a unit of the last digit of a
        text, that of the machine for binary files.
    name : str
        What it is called, for messages.
    """

    values: Any
    coordinates: tuple[str, ...] = ()
    precision: float = EPS
    name: str = "matrix"

    def __post_init__(self) -> None:
        n = self.values.shape[0]
        if self.coordinates and len(self.coordinates) != n:
            raise DataError(
                f"{self.name} has {n} rows, but {len(self.coordinates)} coordinates are named"
            )

    def toarray(self) -> np.ndarray:
        """Return all entries, (n, m)."""
        return self.values.toarray()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        del copy
        return self.toarray().astype(dtype or float)


def named(nodes: np.ndarray, directions: np.ndarray) -> list[str]:
    """Names of coordinates by node and number of the direction, 1 to 6; 0 is a scalar point."""
    words = ("", *DIRECTIONS)
    return [
        f"{n}:{words[d]}" if 0 < d < len(words) else (f"{n}:{d}" if d else f"{n}")
        for n, d in zip(nodes.tolist(), directions.tolist(), strict=True)
    ]


DIRECTIONS = ("UX", "UY", "UZ", "RX", "RY", "RZ")
"""Translations and rotations along and about the axes, in the order of their numbers 1 to 6."""


def precision_of(longest: int) -> float:
    """Relative rounding of numbers of which the longest has so many significant digits.

    Numbers of fewer than five digits were typed, not computed: they are exact.
    """
    return EPS if longest < 5 else max(EPS, 0.5 * 10.0 ** (1 - longest))
