"""What was measured and estimated in the last minutes, hours and days, in a fixed amount of memory.

Every level holds buckets of one length: the smallest and the largest value in them, the last one
and its standard deviation. What happens between two points of a curve is seen as its width.
"""

import io
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backsight.types import Array

LEVELS = ((0.05, 1800), (1.0, 3700), (60.0, 1500), (1800.0, 1500))
"""Length of a bucket [s], and how many are kept: 90 s, an hour, a day, a month."""

_NEVER = -(2**62)
"""Number of a bucket that is none."""

_HELD = ("_numbers", "_low", "_high", "_last", "_std")
"""What a level holds of its buckets."""


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
        self._numbers = np.full(count, _NEVER, np.int64)
        self._low, self._high, self._last, self._std = (
            np.full((count, width), np.nan, np.float32) for _ in range(4)
        )
        self.newest = _NEVER
        """Number of the newest bucket, its beginning by the period."""

    def add(self, times: Array, values: Array, spread: Array) -> None:
        """Take in values (n, m) and standard deviations at times (n,), in order."""
        numbers = np.floor(times / self.period).astype(np.int64)
        starts = np.flatnonzero(np.r_[True, numbers[1:] != numbers[:-1]])
        with np.errstate(invalid="ignore", over="ignore"):  # what is too large becomes infinite
            low = np.fmin.reduceat(values, starts, axis=0).astype(np.float32)
            high = np.fmax.reduceat(values, starts, axis=0).astype(np.float32)
            lasts, spreads = values.astype(np.float32), spread.astype(np.float32)
        stops = np.r_[starts[1:], len(numbers)] - 1
        for j, number in enumerate(numbers[starts]):
            k = int(number % self._count)
            if self._numbers[k] > number:
                continue  # a month ago, and a newer one has its place
            if self._numbers[k] == number:
                self._low[k] = np.fmin(self._low[k], low[j])
                self._high[k] = np.fmax(self._high[k], high[j])
            else:
                self._numbers[k], self._low[k], self._high[k] = number, low[j], high[j]
                self._last[k] = self._std[k] = np.nan
            last = lasts[stops[j]]
            self._last[k] = np.where(np.isfinite(last), last, self._last[k])
            self._std[k] = spreads[stops[j]]
            self.newest = max(self.newest, int(number))

    def held(self) -> dict[str, np.ndarray]:
        """Copies of all that is held."""
        return {name: getattr(self, name).copy() for name in _HELD}

    def take_over(self, kept: Mapping[str, np.ndarray]) -> None:
        """Put buckets that were held before a restart into places that are free or older."""
        numbers = kept["_numbers"]
        if any(kept[name].shape != getattr(self, name).shape for name in _HELD):
            raise ValueError
        free = numbers > self._numbers
        for name in _HELD:
            getattr(self, name)[free] = kept[name][free]
        self.newest = max(self.newest, int(numbers.max()))

    def since(self, number: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Numbers of the buckets from one on, in order, and what is in them."""
        oldest = max(number, self.newest - self._count + 1, _NEVER + 1)
        there = np.flatnonzero(self._numbers >= oldest)
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
        self._told = _NEVER

    def add(self, times: Array, values: Array, spread: Array) -> None:
        """Take in values (n, m) and standard deviations at times (n,)."""
        with self._lock:
            for level in self._levels:
                level.add(times, values, spread)

    def packed(self) -> bytes:
        """All of it, to be kept."""
        file = io.BytesIO()
        with self._lock:
            levels = [level.held() for level in self._levels]
        arrays = {f"{j}{n}": v for j, held in enumerate(levels) for n, v in held.items()}
        np.savez(file, names=np.array(self.names), **arrays)  # type: ignore[arg-type]
        return file.getvalue()

    def take_over(self, content: bytes) -> float:
        """Take over what was kept before a restart.

        Returns
        -------
        float
            Begin of the newest second in it [s]; to add what is in that once more changes nothing.

        Raises
        ------
        ValueError, OSError, KeyError
            If it is damaged, or of other quantities.
        """
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            if file["names"].tolist() != self.names:
                raise ValueError
            kept = [{n: file[f"{j}{n}"] for n in _HELD} for j in range(len(LEVELS))]
        with self._lock:
            for level, held in zip(self._levels, kept, strict=True):
                level.take_over(held)
            self._told = max(self._told, int(kept[0]["_numbers"].max()))
        return float(kept[1]["_numbers"].max()) * self._levels[1].period

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
