"""Which column of a file is its clock, and in what it counts."""

import dataclasses
import re
from collections.abc import Mapping

import numpy as np

from backsight.data._checks import IRREGULARITY
from backsight.data.times.clock import epoch_form, maybe_days, seconds
from backsight.data.times.grid import rounded_grid
from backsight.data.times.names import SECONDS, is_clock, unit_of_clock
from backsight.types import Array

_COUNTER = re.compile(r"(?:sample|index|row|no|nr|number|count|scan|frame|#|i|k|n)\W?\d?", re.I)

_UNIX = (5e8, 5e9)
"""Where stamps that count seconds from 1970 on lie."""

FEWEST = 5
"""Samples without which numbers that rise are no sign of a clock."""

LEAP = 1.5
"""Intervals that are longer than this, in periods, have lost samples."""


@dataclasses.dataclass(frozen=True)
class Clock:
    """A column that seems to be time.

    Parameters
    ----------
    name : str
        "" for a time of the file's own.
    factor : float
        From its numbers to seconds.
    time_format : str
        As `backsight.read` takes it, "" for plain numbers.
    dt : float
        Mean period, without gaps [s].
    even : bool
        Whether the samples are evenly spaced, perhaps behind rounded stamps.
    sure : bool
        By its name or because the file says so; otherwise only its numbers are like a clock's.
    remarks : tuple of str
        What looks wrong.
    """

    name: str
    factor: float
    time_format: str
    dt: float
    even: bool
    sure: bool
    remarks: tuple[str, ...]


def clock_among(columns: Mapping[str, Array], units: Mapping[str, str]) -> Clock | None:
    """The column of numbers that is most like a clock, or None: by its name, or evenly rising."""
    rising = {
        name: values
        for name, values in columns.items()
        if len(values) > 2 and np.isfinite(values).all() and (np.diff(values) > 0).all()
    }
    named = [name for name in rising if is_clock(name)]
    for name in named:
        return _clock(name, rising[name], units.get(name, ""), sure=True)
    for name, values in rising.items():
        steps = np.diff(values)
        whole = steps[0] == 1 and (steps == 1).all()
        even = np.ptp(steps) <= IRREGULARITY * float(np.median(steps))
        if even and len(values) >= FEWEST and not whole and not _COUNTER.fullmatch(name):
            return _clock(name, values, units.get(name, ""), sure=False)
    return None


def clock_of_dates(name: str, time: Array) -> Clock:
    """A clock of dates, already in seconds."""
    return _regular(name, time, 1.0, "", sure=True)


def _clock(name: str, values: Array, unit: str, *, sure: bool) -> Clock:
    word = unit or unit_of_clock(name)
    form = epoch_form(values) or maybe_days(values)
    form = "unix" if form is None and _UNIX[0] < values[0] < _UNIX[1] else form
    if form and not word:
        return _regular(
            name, seconds(values, time_format=form, where=name)[0], 1.0, form, sure=sure
        )
    factor = SECONDS.get(word, SECONDS.get(word.lower(), 1.0))
    return _regular(name, values * factor, factor, "", sure=sure)


def _regular(name: str, time: Array, factor: float, form: str, *, sure: bool) -> Clock:
    steps = np.diff(time)
    period = float(np.median(steps))
    if not period > 0:
        return Clock(name, factor, form, period, False, sure, ("time does not rise",))
    rounded = rounded_grid(time)
    if rounded is not None:
        return Clock(name, factor, form, rounded.dt, True, sure, (str(rounded),))
    lost = steps > LEAP * period
    others = steps[~lost]
    even = bool(np.ptp(others) <= 2 * IRREGULARITY * period)
    dt = float(np.mean(others))
    remarks = []
    if lost.any():
        k = int(np.argmax(steps))
        count = "a gap" if lost.sum() == 1 else f"{lost.sum()} gaps, the longest"
        remarks.append(f"{count} of {steps[k]:.6g} s after {time[k] - time[0]:.6g} s")
    if not even:
        remarks.append(f"irregular: {others.min():.4g} to {others.max():.4g} s from row to row")
    return Clock(name, factor, form, dt, even and not lost.any(), sure, tuple(remarks))
