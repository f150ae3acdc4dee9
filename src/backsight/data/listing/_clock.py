"""Which column of a file is its clock, and in what it counts."""

import dataclasses
import re
from collections.abc import Mapping

import numpy as np

from backsight.data._checks import IRREGULARITY
from backsight.data.times.clock import EPOCHS
from backsight.data.times.grid import rounded_grid
from backsight.types import Array

_NAME = re.compile(
    r"(?:\w+[/ _.-])?(?:rel|abs|elapsed|sample|daq)?[ _.-]?"
    r"(?:t|time|times|zeit|temps|tempo|tiempo|tid|timestamps?|stamps?|seconds?|sec|clock|uhrzeit|"
    r"datetime|date|x_value)(?:[ _.-]?(?P<unit>[a-zµμ]+))?(?:\s*[(\[].*)?",
    re.IGNORECASE,
)
_COUNTER = re.compile(r"(?:sample|index|row|no|nr|number|count|scan|frame|#|i|k|n)\W?\d?", re.I)

SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek"), 1.0),
    **dict.fromkeys(("ms", "msec", "milliseconds", "millis"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microseconds", "micros"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanoseconds", "nanos"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
}
"""Units of clocks [s]."""

_DAYS = {"unix": (5e8, 5e9), "matlab": (7.2e5, 7.6e5)}
"""Where stamps that count seconds from 1970, or days from the year 0 on, lie for such dates."""

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
    named = [name for name in rising if _NAME.fullmatch(name.rpartition("/")[2])]
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
    match = _NAME.fullmatch(name.rpartition("/")[2])
    word = unit or (match["unit"] if match and match["unit"] else "")
    for form, (low, high) in (EPOCHS | _DAYS).items():
        if low < values[0] < high and not unit:
            return _regular(name, (values - values[0]) * _ticks(form), 1.0, form, sure=sure)
    factor = SECONDS.get(word if word in SECONDS else word.lower(), 1.0)
    return _regular(name, values * factor, factor, "", sure=sure)


def _ticks(form: str) -> float:
    return {"unix_ms": 1e-3, "unix_us": 1e-6, "unix_ns": 1e-9, "matlab": 86400.0}.get(form, 1.0)


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
