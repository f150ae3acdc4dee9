"""One column out of a container of arrays, by name."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from backsight.errors import DataError, nearest
from backsight.types import Array

INDEXED = re.compile(r"(?P<name>.+)\[(?P<index>\d+)\]")


def no_column(name: str, known: Iterable[str]) -> str:
    """Say that there is no column of that name, with a hint."""
    return f"there is no column '{name}': {nearest(name, [k for k in known if k])}"


def pick(
    arrays: Mapping[str, Any], wanted: Iterable[str], *, column_major: bool = False
) -> dict[str, Array]:
    """Take vectors, or columns of matrices, out of named arrays.

    Parameters
    ----------
    arrays : mapping of str to array
        Arrays, or anything with ``shape``, ``dtype`` and conversion to an array; only those that
        are wanted are converted. Time is the first axis.
    wanted : iterable of str
        Names; ``acc[2]`` is the third column of the matrix ``acc``.
    column_major : bool
        The arrays come with their axes in reverse order, as MATLAB writes them to HDF5.

    Returns
    -------
    dict of (n,) arrays

    Raises
    ------
    DataError
        If names are missing (all of them in one message), not numeric, or not a vector.
    """
    found: dict[str, Array] = {}
    absent: list[str] = []
    for reference in wanted:
        indexed = INDEXED.fullmatch(reference)
        if reference in arrays:
            found[reference] = _vector(
                _numbers(arrays[reference], reference, column_major), reference
            )
        elif indexed and indexed["name"] in arrays:
            name, index = indexed["name"], int(indexed["index"])
            found[reference] = _column(_numbers(arrays[name], name, column_major), name, index)
        else:
            absent.append(no_column(indexed["name"] if indexed else reference, arrays))
    if absent:
        raise DataError("; ".join(absent))
    return found


def _vector(matrix: Array, name: str) -> Array:
    values = np.squeeze(matrix)
    if values.ndim == 2:
        raise DataError(
            f"'{name}' is a matrix of {values.shape[0]} samples and {values.shape[1]} columns: "
            f"take one as '{name}[0]' to '{name}[{values.shape[1] - 1}]'"
        )
    if values.ndim > 2:
        raise DataError(f"'{name}' has the shape {values.shape}; a signal needs one axis, time")
    return np.atleast_1d(values)


def _column(values: Array, name: str, index: int) -> Array:
    if values.ndim != 2 or index >= values.shape[1]:
        raise DataError(
            f"'{name}[{index}]' does not exist: '{name}' has the shape {values.shape}, time first, "
            f"and columns count from 0"
        )
    return values[:, index]


def _numbers(entry: Any, name: str, column_major: bool) -> Array:
    values = np.asarray(entry)
    values = values.T if column_major else values
    if values.dtype.kind not in "fiub":
        raise DataError(f"'{name}' is not an array of real numbers, but of {values.dtype}")
    return values.astype(float)
