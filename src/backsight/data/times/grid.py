"""Even grids: of channels that say their period, and behind stamps that are rounded to digits."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from backsight.errors import DataError
from backsight.types import Array

DIGITS = range(10)
"""Decimal places that stamps may be rounded to."""

FEWEST = 3
"""Uneven intervals that a rounding must show; one or two may be lost samples."""

SLACK = 1e-6

MOST = 0.6

CLOSE = 1e-9
"""Sampling periods that differ by less, relatively, are the same."""


@dataclasses.dataclass(frozen=True)
class Grid:
    """Even times ``start + k dt`` [s] behind stamps that are rounded to `quantum`."""

    start: float
    dt: float
    quantum: float

    def times(self, n: int) -> Array:
        """The first `n` times, (n,)."""
        return self.start + self.dt * np.arange(n, dtype=float)

    def __str__(self) -> str:
        return f"time is rounded to {self.quantum:g} s; even steps of {self.dt:.9g} s"


def rounded_grid(time: Array) -> Grid | None:
    """The even grid whose rounding the stamps are, or None if there is none.

    Rounded or cut off to multiples of q, the times of a grid with the period d deviate from
    ``a + k d`` by an interval that is not longer than q: ``max_k (t_k - k d) - min_k (t_k - k d)``
    is a convex function of d, whose minimum is sought around the mean interval. A lost sample makes
    it longer unless q is as long as the period; then many intervals must be uneven, as they are
    after a rounding.
    """
    quantum = _quantum(time)
    n = len(time)
    mean = (time[-1] - time[0]) / (n - 1)
    if quantum is None or n < 4 or quantum > 2 * mean:
        return None
    steps = np.diff(time)
    shortest, longest = steps.min(), steps.max()
    if longest - shortest > quantum * (1 + SLACK) + SLACK * mean:
        return None  # the intervals of a rounded grid differ by one quantum
    # Whichever of the two intervals is the rarer one tells rounding from loss.
    rare = min(np.sum(steps - shortest > quantum / 2), np.sum(longest - steps > quantum / 2))
    if rare < FEWEST:
        return None
    k = np.arange(n)
    low, high = mean - quantum / (n - 1), mean + quantum / (n - 1)

    def spread(d: float) -> float:
        return float(np.ptp(time - d * k))

    for _ in range(60):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, b) if spread(a) <= spread(b) else (a, high)
    dt = (low + high) / 2
    if spread(dt) > quantum * (1 + SLACK) + 4 * np.spacing(np.abs(time).max()):
        return None
    rest = time - dt * k
    return Grid(float(rest.max() + rest.min()) / 2, float(dt), quantum)


def _quantum(time: Array) -> float | None:
    """Longest power of ten that most stamps are multiples of [s].

    Not all: with a fixed number of digits, the early ones are finer.
    """
    noise = 4 * np.spacing(np.abs(time).max())
    for digits in DIGITS:
        if np.mean(np.abs(np.round(time, digits) - time) <= noise) >= MOST:
            return 10.0**-digits
    return None


def even_times(
    clocks: Sequence[tuple[str, float, float]], columns: Mapping[str, Array]
) -> Array | None:
    """Times of channels that say their first time and period [s], which must be the same.

    Parameters
    ----------
    clocks : sequence of (name, first time, period)
    columns : dict of (n,) arrays

    Returns
    -------
    (n,) array or None
        None without clocks.

    Raises
    ------
    DataError
        If the channels have different times.
    """
    if not clocks:
        return None
    name, start, step = clocks[0]
    for other, begin, period in clocks[1:]:
        if abs(period - step) > CLOSE * abs(step) or abs(begin - start) > CLOSE * abs(step):
            raise DataError(
                f"'{name}' has a sample every {step:g} s from {start:g} s on, '{other}' every "
                f"{period:g} s from {begin:g} s on; read each by itself and merge them"
            )
    return start + step * np.arange(len(columns[name]), dtype=float)
