"""Fewer points for display, in a way that keeps every peak."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from backsight.types import Array

Positions: TypeAlias = NDArray[np.intp]

POINTS = 2000
"""Points per line in a plot; a recording that is not longer is shown as it is."""


def thin(values: Array, points: int = POINTS) -> Positions:
    """Choose the samples to draw: the smallest and the largest of every interval, and both ends.

    Parameters
    ----------
    values : (n,) array
        One signal. Intervals without a finite value keep one sample, so that gaps stay visible.
    points : int
        About how many samples to keep.

    Returns
    -------
    array of int
        Positions, increasing; all of them if `n` is at most `points`.
    """
    n = len(values)
    if n <= points:
        return np.arange(n)
    rows = _intervals(values, points)
    finite = np.isfinite(rows)
    start = rows.shape[1] * np.arange(len(rows))
    low = start + np.argmin(np.where(finite, rows, np.inf), axis=1)
    high = start + np.argmax(np.where(finite, rows, -np.inf), axis=1)
    return np.unique(np.concatenate([[0], low, high, [n - 1]]))


def envelope(lower: Array, upper: Array, points: int = POINTS) -> tuple[Positions, Array, Array]:
    """Thin a band: the lowest lower and the highest upper limit of every interval.

    Parameters
    ----------
    lower, upper : (n,) array
        Limits; not finite where there is no band.
    points : int
        About how many samples to keep, as in `thin`.

    Returns
    -------
    tuple of array
        Positions of the samples (first of every interval, and the last sample of all), lower
        limits, upper limits.
    """
    n = len(lower)
    if n <= points:
        return np.arange(n), lower, upper
    low, high = _intervals(lower, points), _intervals(upper, points)
    start = low.shape[1] * np.arange(len(low))
    finite = np.isfinite(low) & np.isfinite(high)
    some = finite.any(axis=1)
    low = np.where(some, np.min(np.where(finite, low, np.inf), axis=1), np.nan)
    high = np.where(some, np.max(np.where(finite, high, -np.inf), axis=1), np.nan)
    return np.append(start, n - 1), np.append(low, low[-1]), np.append(high, high[-1])


def peaks(values: Array, intervals: int) -> tuple[Array, int]:
    """Thin several signals for a map: of every interval the value that is largest in size.

    Parameters
    ----------
    values : (n, m) array
        Finite.
    intervals : int
        As many at most.

    Returns
    -------
    (k, m) array, int
        Values, and how many samples an interval has; the last may have fewer.
    """
    n, m = values.shape
    length = max(-(-n // intervals), 1)
    rows = np.zeros((-(-n // length), length, m))
    rows.reshape(-1, m)[:n] = values
    at = np.abs(rows).argmax(axis=1)[:, np.newaxis]
    return np.take_along_axis(rows, at, axis=1)[:, 0], length


def interval_length(n: int, points: int = POINTS) -> int:
    """Samples per interval when `n` samples are thinned; 1 if they are not."""
    return 1 if n <= points else -(-n // (points // 2))


def _intervals(values: Array, points: int) -> Array:
    """Rows of `interval_length` samples, the last one filled up with NaN."""
    n, length = len(values), interval_length(len(values), points)
    count = -(-n // length)
    filled = np.full(count * length, np.nan)
    filled[:n] = values
    return filled.reshape(count, length)
