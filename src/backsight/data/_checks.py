"""What a recording must fulfil before the first sample is used; each check names the place."""

import math
import numbers
from collections.abc import Iterable, Mapping

import numpy as np

from backsight.data.times.grid import Grid, rounded_grid
from backsight.errors import DataError
from backsight.types import Array

ADVICE = (
    "Filling gaps makes parameters wrong: estimate the input there, by 'gaps' in a problem file; "
    "in Python read it as an output, which may be NaN, and take augment(model, inputs=[its name])"
)
"""What to do about an input that was not recorded at every sample."""

IRREGULARITY = 0.01
"""Largest deviation of a sampling interval, relative to the sampling period."""


_BLOCK = 1 << 17


def check_lengths(lengths: Mapping[str, int], where: str) -> int:
    """Return the number of samples; raise `DataError` unless it is the same and at least two."""
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"'{name}' {n}" for name, n in lengths.items())
        raise DataError(
            f"{where}: the numbers of samples differ (time is the first axis): {listed}"
        )
    n = next(iter(lengths.values()), 0)
    if n < 2:
        raise DataError(f"{where}: the recording has {n} samples; at least 2 are needed")
    return n


def check_time(time: Array, where: str) -> None:
    """Raise `DataError` unless the time stamps are finite and increase."""
    wrong = ~np.isfinite(time)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise DataError(f"{where}: time is {time[k]} at sample {k}; every sample needs a time")
    wrong = time[1:] <= time[:-1]
    if wrong.any():
        k = int(np.argmax(wrong)) + 1
        raise DataError(
            f"{where}: time does not increase at sample {k}: {time[k]:.9g} s follows "
            f"{time[k - 1]:.9g} s; sort the samples or remove those that are double"
        )


def check_period(dt: float, what: str, where: str) -> None:
    """Raise `DataError` unless a sampling period is a positive number."""
    number = isinstance(dt, numbers.Real) and not isinstance(dt, np.timedelta64)
    if not number or not 0 < dt < math.inf:
        raise DataError(f"{where}: {what} is {dt!r}; it must be a positive number of seconds")


def check_regular(time: Array, dt: float | None, where: str) -> Grid | None:
    """Raise `DataError` unless the samples are evenly spaced, and as `dt` says if it is given.

    Stamps that are the times of an even grid, rounded, are that grid, which is returned.
    """
    shortest, longest = _range_of_steps(time)
    if dt is None and longest - shortest <= IRREGULARITY * shortest:
        return None  # whatever the median, which takes long in many millions of samples
    steps = np.diff(time)
    period = float(np.median(steps))
    even = max(longest - period, period - shortest) <= IRREGULARITY * period
    grid = None if even else rounded_grid(time)
    period = period if grid is None else grid.dt
    if dt is not None and abs(dt - period) > IRREGULARITY * period:
        raise DataError(
            f"{where}: dt is {dt:.6g} s, but by their time the samples are {period:.6g} s apart; "
            f"give one of the two, or mend the unit of time"
        )
    if not even and grid is None:
        k = int(np.argmax(np.abs(steps - period)))
        raise DataError(
            f"{where}: time is irregular: samples {k} and {k + 1} (t = {time[k]:.9g} s) are "
            f"{steps[k]:.6g} s apart, the others {period:.6g} s; put them on a grid, "
            f"grid = {_grid_for(steps, period):.6g} (exact: nothing is measured between them), "
            f"interpolate with resample = {period:.6g} (which smooths the noise), or give dt "
            "instead of time if the stamps are only rounded: on average they are "
            f"{np.mean(steps):.9g} s apart"
        )
    return grid


def _range_of_steps(time: Array) -> tuple[float, float]:
    """Shortest and longest interval, a block at a time: new memory takes longer than numbers."""
    shortest, longest = math.inf, -math.inf
    for k in range(0, len(time) - 1, _BLOCK):
        steps = np.diff(time[k : k + _BLOCK + 1])
        shortest, longest = min(shortest, float(steps.min())), max(longest, float(steps.max()))
    return shortest, longest


def _grid_for(steps: Array, period: float) -> float:
    """The period if the intervals are multiples of it, lost samples; else a tenth of it."""
    counts = np.rint(steps / period)
    lost = (counts >= 1).all() and (np.abs(steps - counts * period) <= 0.05 * period).all()
    return period if lost else 0.1 * period


def check_inputs(
    values: Array, names: Iterable[str], time: Array, *, first: int, where: str
) -> None:
    """Raise `DataError` if an input, (n, nu), is NaN or infinite; `first` is the first sample."""
    place = _first(~np.isfinite(values), values, names, time, first)
    if place:
        raise DataError(f"{where}: input {place}; an input must be known at every sample. {ADVICE}")


def check_measured(
    values: Array, names: Iterable[str], time: Array, *, first: int, where: str
) -> None:
    """Raise `DataError` if an output, (n, ny), is infinite; NaN is "not measured"."""
    place = _first(np.isinf(values), values, names, time, first)
    if place:
        raise DataError(f"{where}: output {place}; write NaN where it was not measured")


def _first(
    wrong: np.ndarray, values: Array, names: Iterable[str], time: Array, first: int
) -> str | None:
    if not wrong.any():
        return None
    k, j = np.argwhere(wrong)[0]
    return (
        f"'{list(names)[j]}' is {values[k, j]} at sample {k + first} (t = {time[k]:.9g} s), "
        f"{wrong.sum()} times in all"
    )
