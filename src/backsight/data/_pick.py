"""One column out of a container of arrays, by name."""

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

from backsight.data._request import Axis, Listed
from backsight.errors import DataError, nearest
from backsight.types import Array

INDEXED = re.compile(r"(?P<name>.+)\[(?P<index>\d+)\]")

MUCH = 5
"""How much longer than the other an axis must be to be that of time without further signs."""


MOST_CHANNELS = 100
"""Of a matrix that are listed one by one."""


def no_column(name: str, known: Iterable[str]) -> str:
    """Say that there is no column of that name, with a hint."""
    return f"there is no column '{name}': {nearest(name, [k for k in known if k])}"


def pick(
    arrays: Mapping[str, Any],
    wanted: Iterable[str],
    *,
    axis: Axis | None = None,
    column_major: bool = False,
    clock: str | None = None,
) -> dict[str, Array]:
    """Take vectors, or columns of matrices, out of named arrays.

    Time runs along the axis of a matrix that is as long as the other columns; without any, along
    the one that is much longer. Where that does not decide, `axis` must.

    Parameters
    ----------
    arrays : mapping of str to array
        Arrays, or anything with ``shape``, ``dtype`` and conversion to an array; only those that
        are wanted are converted.
    wanted : iterable of str
        Names; ``acc[2]`` is the third channel of the matrix ``acc``.
    axis : 0 or 1, optional
        Axis of matrices along which time runs.
    column_major : bool
        The arrays come with their axes in reverse order, as MATLAB writes them to HDF5.
    clock : str, optional
        The one of `wanted` that is time: dates and whole numbers stay what they are.

    Returns
    -------
    dict of (n,) arrays

    Raises
    ------
    DataError
        If names are missing (all of them in one message), not numeric, or not a vector, or if it is
        not plain which axis is time.
    """
    found: dict[str, Array] = {}
    matrices: dict[str, tuple[str, int, Array]] = {}
    absent: list[str] = []
    for reference in wanted:
        indexed = INDEXED.fullmatch(reference)
        if reference in arrays:
            values = _numbers(arrays[reference], reference, column_major, reference == clock)
            found[reference] = _vector(values, reference)
        elif indexed and indexed["name"] in arrays:
            name = indexed["name"]
            values = _numbers(arrays[name], name, column_major, reference == clock)
            matrices[reference] = (name, int(indexed["index"]), values)
        else:
            absent.append(no_column(indexed["name"] if indexed else reference, arrays))
    if absent:
        raise DataError("; ".join(absent))
    lengths = {len(values) for values in found.values()}
    if not lengths:  # matrices that are plain by themselves tell about the others
        plain = [_longer(values.shape) for _, _, values in matrices.values() if values.ndim == 2]
        shapes = [values.shape for _, _, values in matrices.values() if values.ndim == 2]
        lengths = {s[a] for s, a in zip(shapes, plain, strict=True) if a is not None}
    for reference, (name, index, values) in matrices.items():
        found[reference] = _channel(values, name, index, axis, lengths)
    return found


def present(wanted: Iterable[str], known: Iterable[str]) -> list[str]:
    """The wanted names; raises `DataError` if some are not among those that are known."""
    wanted, known = list(wanted), list(known)
    absent = [no_column(name, known) for name in wanted if name not in known]
    if absent:
        raise DataError("; ".join(absent))
    return wanted


def list_arrays(arrays: Mapping[str, Any], axis: Axis | None = None) -> list[Listed]:
    """List vectors, and the channels of matrices as ``acc[2]``, as `pick` takes them."""
    found: list[Listed] = []
    for name, entry in arrays.items():
        shape = tuple(n for n in np.shape(entry) if n != 1)
        array = entry if hasattr(entry, "dtype") else np.asarray(entry)
        own = Listed.of(name, array.dtype)
        if own.kind != "numbers" or len(shape) == 1:
            found.append(own)
        elif not shape:
            found.append(Listed(name, "other", "one number"))
        elif len(shape) > 2:
            found.append(Listed(name, "other", f"an array {' x '.join(map(str, shape))}"))
        else:
            found += _channels(name, shape, axis)
    return found


def _channels(name: str, shape: tuple[int, ...], axis: Axis | None) -> list[Listed]:
    time = _longer(shape) if axis is None else axis
    size = f"a matrix {shape[0]} x {shape[1]}"
    if time is None:
        return [Listed(name, "other", f"{size}: say the axis of time")]
    if shape[1 - time] > MOST_CHANNELS:
        return [Listed(name, "other", f"{size}: channels {name}[0], ...")]
    return [Listed(f"{name}[{k}]") for k in range(shape[1 - time])]


def _vector(matrix: Array, name: str) -> Array:
    values = np.squeeze(matrix)
    if values.ndim == 2:
        time = _longer(values.shape) or 0
        kinds = ("columns", "samples") if time else ("samples", "columns")
        raise DataError(
            f"'{name}' is a matrix of {values.shape[0]} {kinds[0]} and {values.shape[1]} "
            f"{kinds[1]}: take one as '{name}[0]' to '{name}[{values.shape[1 - time] - 1}]'"
        )
    if values.ndim > 2:
        raise DataError(f"'{name}' has the shape {values.shape}; a signal needs one axis, time")
    return np.atleast_1d(values)


def _channel(
    values: Array, name: str, index: int, axis: Axis | None, lengths: Collection[int]
) -> Array:
    if values.ndim == 2:
        time = _time_axis(values.shape, name, lengths) if axis is None else axis
        if index < values.shape[1 - time]:
            return values[:, index] if time == 0 else values[index]
        which = f", time along axis {time},"
    else:
        which = ""
    raise DataError(
        f"'{name}[{index}]' does not exist: '{name}' has the shape {values.shape}{which} and "
        "channels count from 0"
    )


def _time_axis(shape: tuple[int, ...], name: str, lengths: Collection[int]) -> int:
    fitting = [k for k in (0, 1) if shape[k] in lengths]
    if len(fitting) == 1:
        return fitting[0]
    longer = _longer(shape)
    if longer is None or len(fitting) == 2:
        raise DataError(
            f"'{name}' has the shape {shape}, and it is not plain which axis is time; say axis = 0 "
            "(samples by channels) or axis = 1 (channels by samples)"
        )
    return longer


def _longer(shape: tuple[int, ...]) -> int | None:
    """The axis that is much longer than the other, or None."""
    if len(shape) != 2 or max(shape) < MUCH * min(shape):
        return None
    return int(np.argmax(shape))


def _numbers(entry: Any, name: str, column_major: bool, exact: bool) -> Array:
    values = np.asarray(entry)
    values = values.T if column_major else values
    if exact and values.dtype.kind in "iumM":
        return values
    if values.dtype.kind not in "fiub":
        raise DataError(f"'{name}' is not an array of real numbers, but of {values.dtype}")
    return values.astype(float)
