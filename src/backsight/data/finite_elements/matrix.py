"""A matrix with the names of its coordinates, as files of finite-element programs hold it."""

import dataclasses
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import scipy

from backsight.errors import DataError

EPS = float(np.finfo(float).eps)

DIRECTIONS = ("UX", "UY", "UZ", "RX", "RY", "RZ")
"""Translations and rotations along and about the axes, in the order of their numbers 1 to 6."""

_MANTISSA = re.compile(r"(\d*)\.?(\d*)")

_MOST = 0.5

TYPED = 5
"""Numbers of fewer digits were typed, not computed: they are exact."""


@dataclasses.dataclass(frozen=True)
class Matrix:
    """A sparse matrix, and what is known of it.

    Parameters
    ----------
    values : (n, m) array or sparse array
        The numbers.
    coordinates : tuple of str
        Names of the rows, ``"node:direction"`` as in ``"12:UX"``; empty if the file has none.
    precision : float
        Relative rounding of the entries as they are written: half a unit of the last digit of a
        text, that of the machine for binary files.
    name : str
        What it is called, for messages.

    Raises
    ------
    DataError
        If there are not as many names as rows.
    """

    values: Any
    coordinates: tuple[str, ...] = ()
    precision: float = EPS
    name: str = "matrix"

    def __post_init__(self) -> None:
        if self.coordinates and len(self.coordinates) != self.values.shape[0]:
            raise DataError(
                f"{self.name} has {self.values.shape[0]} rows, but {len(self.coordinates)} "
                "coordinates are named"
            )

    def toarray(self) -> np.ndarray:
        """Return all entries, (n, m)."""
        values = self.values
        return values.toarray() if scipy.sparse.issparse(values) else np.asarray(values, float)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        del copy
        return self.toarray().astype(dtype or float)


def place_name(node: int, direction: int) -> str:
    """Name of a coordinate: "12:UX"; directions from 1 on, 0 is a point without directions."""
    if not direction:
        return str(node)
    word = DIRECTIONS[direction - 1] if 1 <= direction <= len(DIRECTIONS) else str(direction)
    return f"{node}:{word}"


def of_places(
    rows: Sequence[tuple[int, int]],
    columns: Sequence[tuple[int, int]],
    values: Sequence[float],
    *,
    precision: float,
    name: str,
    mirrored: bool,
) -> Matrix:
    """Put a square matrix together from entries at places (node, direction).

    Parameters
    ----------
    rows, columns : sequence of tuple of int
        Node and direction of every entry.
    values : sequence of float
        Entries; those at the same place are added.
    mirrored : bool
        Whether an entry whose mirror image is not there stands for both.
    """
    places = sorted({*rows, *columns})
    number = {place: i for i, place in enumerate(places)}
    entries = (values, ([number[p] for p in rows], [number[p] for p in columns]))
    A = scipy.sparse.csc_array(entries, shape=(len(places), len(places)))
    if mirrored:
        there = scipy.sparse.csc_array(A != 0)
        A = scipy.sparse.csc_array(A + A.T - A.T.multiply(there))
    return Matrix(A, tuple(place_name(*place) for place in places), precision, name)


def precision_of(numbers: Iterable[str]) -> float:
    """Relative rounding of numbers as they are written.

    By the longest of them, if most need as many digits, as nine of ten numbers do that were
    rounded. Where most end in zeros, or before, the numbers are exact.
    """
    written = {
        found.groups() for n in numbers if (found := _MANTISSA.match(n.strip().lstrip("+-")))
    }
    digits = {"".join(parts).lstrip("0") for parts in written}
    longest = max(map(len, digits), default=0)
    full = sum(len(number.rstrip("0")) == longest for number in digits)
    if longest < TYPED or full < _MOST * len(digits):
        return EPS
    return max(EPS, 0.5 * 10.0 ** (1 - longest))
