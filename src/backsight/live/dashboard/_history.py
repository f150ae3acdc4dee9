"""What was measured and estimated in the last minutes, hours and days, in a fixed amount of memory.

Every level holds buckets of one length: the smallest and the largest value in them, the last one
and its standard deviation. What happens between two points of a curve is seen as its width.
"""

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backsight.types import Array

LEVELS = ((0.1, 900), (1.0, 3700), (60.0, 1500), (1800.0, 1500))
"""Length of a bucket [s], and how many are kept: 90 s, an hour, a day, a month."""


class Level:
    """Buckets of one length.

    Parameters
    ----------
    period : float
        Length of a bucket [s].
    count : int
        Buckets that are kept.
    width : int
        Quantities.
    """

    def __init__(self, period: float, count: int, width: int) -> None:
        self.period, self._count = period, count
        self._numbers = np.full(count, -1, np.int64)
        self._low, self._high, self._last, self._std = (
            np.full((count, width), np.nan, np.float32) for _ in range(4)
        )
        self.newest = -1
        """Number of the newest bucket, its beginning by the period."""

    def add(self, times: Array, values: Array, spread: Array) -> None:
        """Take in values (n, m) and standard deviations at times (n,), in order."""
        numbers = np.floor(times / self.period).astype(np.int64)
        starts = np.flatnonzero(np.r_[True, numbers[1:] != numbers[:-1]])
        with np.errstate(invalid="ignore"):
            low = np.fmin.reduceat(values, starts, axis=0)
            high = np.fmax.reduceat(values, starts, axis=0)
        stops = np.r_[starts[1:], len(numbers)] - 1
        for j, number in enumerate(numbers[starts]):
            k = int(number % self._count)
            if self._numbers[k] == number:
                self._low[k] = np.fmin(self._low[k], low[j])
                self._high[k] = np.fmax(self._high[k], high[j])
            else:
                self._numbers[k], self._low[k], self._high[k] = number, low[j], high[j]
                self._last[k] = self._std[k] = np.nan
            last = values[stops[j]]
            self._last[k] = np.where(np.isfinite(last), last, self._last[k])
            self._std[k] = spread[stops[j]]
            self.newest = max(self.newest, int(number))

    def since(self, number: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Numbers of the buckets from one on, in order, and what is in them."""
        there = np.flatnonzero(self._numbers >= max(number, self.newest - self._count + 1))
        order = there[np.argsort(self._numbers[there])]
        held = {"low": self._low, "high": self._high, "last": self._last, "std": self._std}
        return self._numbers[order], {name: values[order] for name, values in held.items()}


class History:
    """Quantities over all times that are shown.

    Parameters
    ----------
    names : sequence of str
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)
        self._levels = [Level(period, count, len(self.names)) for period, count in LEVELS]
        self._lock = threading.Lock()
        self._told = -1

    def add(self, times: Array, values: Array, spread: Array) -> None:
        """Take in values (n, m) and standard deviations at times (n,)."""
        with self._lock:
            for level in self._levels:
                level.add(times, values, spread)

    def over(self, span: float) -> dict[str, Any]:
        """Buckets of the last seconds, of the finest level that reaches so far back."""
        with self._lock:
            level = next(
                (v for v, (p, n) in zip(self._levels, LEVELS, strict=True) if p * n >= span),
                self._levels[-1],
            )
            numbers, held = level.since(level.newest - int(span / level.period))
        return self._as_json(level.period, numbers, held)

    def fresh(self) -> dict[str, Any] | None:
        """Whole buckets of the finest level that were not told before; None if there is none."""
        with self._lock:
            level = self._levels[0]
            numbers, held = level.since(self._told + 1)
            whole = numbers < level.newest
            if not whole.any():
                return None
            self._told = int(numbers[whole][-1])
            return self._as_json(
                level.period, numbers[whole], {n: v[whole] for n, v in held.items()}
            )

    def _as_json(
        self, period: float, numbers: np.ndarray, held: Mapping[str, np.ndarray]
    ) -> dict[str, Any]:
        return {
            "period": period,
            "t": [round(float(k) * period, 3) for k in numbers],
            "series": {
                name: {what: _numbers(values[:, j]) for what, values in held.items()}
                for j, name in enumerate(self.names)
            },
        }


def _numbers(values: np.ndarray) -> list[float | None]:
    """Six digits are more than a screen shows."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values.tolist()]
