"""The clock of a source beside that of this computer: offset and drift from the times of arrival.

A message may be late but never early, so that the line below all points (stamp, arrival - stamp)
that is as high as it can be at their middle tells offset and drift, however irregular the delays.

Source: Moon, Skelly, Towsley, "Estimation and removal of clock skew from network delay
measurements", IEEE INFOCOM 1999, https://doi.org/10.1109/INFCOM.1999.749287.
"""

import collections
import itertools

import numpy as np

from backsight.types import Array

_EVERY = 1.0
"""Seconds of which one point, the least delay, is kept."""

_MOST = 900
"""Points that are kept: a quarter of an hour."""

_ENOUGH = 10
"""Points from which a drift is told."""


class SourceClock:
    """Stamps of a source, and when they arrived.

    Parameters
    ----------
    own : bool
        Whether stamps are put to the clock of this computer.
    delay : float
        By which the stamps are late [s].
    dt : float
        Sampling period [s]; the offset of an own clock follows its drift in whole periods.
    """

    def __init__(self, *, own: bool, delay: float, dt: float) -> None:
        self._own, self._delay, self._dt = own, delay, dt
        self._points: collections.deque[tuple[float, float]] = collections.deque(maxlen=_MOST)
        self.shift: float | None = None if own else 0.0
        """What is added to the stamps, beside the delay [s]."""

    def common(self, stamps: Array, arrival: Array) -> Array:
        """Times (n,) on the common clock of samples with stamps (n,) that arrived then (n,)."""
        known = np.isfinite(stamps)
        own = np.where(known, stamps, arrival)
        if known.any():
            self._learn(own[known], arrival[known])
            self._follow(float(own[known][-1]))
        return own - self._delay + (self.shift or 0.0)

    def _learn(self, stamps: Array, arrival: Array) -> None:
        late = arrival - stamps
        k = int(np.argmin(late))
        point = (float(stamps[k]), float(late[k]))
        if self._points and 0 <= point[0] - self._points[-1][0] < _EVERY:
            before = self._points[-1]
            self._points[-1] = min(before, point, key=lambda p: p[1])
        else:
            if self._points and point[0] < self._points[-1][0]:
                self._points.clear()  # the clock was set back
            self._points.append(point)

    def _follow(self, stamp: float) -> None:
        if not self._own:
            return
        wanted = self.offset_at(stamp)
        if self.shift is None:
            self.shift = wanted
        elif abs(wanted - self.shift) > self._dt and len(self._points) >= _ENOUGH:
            self.shift += self._dt * round((wanted - self.shift) / self._dt)

    @property
    def drift(self) -> float:
        """Seconds per second by which the clock of the source is slow; NaN until it is known."""
        if len(self._points) < _ENOUGH:
            return np.nan
        return self._line()[1]

    def offset_at(self, stamp: float) -> float:
        """What must be added to a stamp for the time of this computer, with the least delay [s]."""
        middle, slope, value = self._line()
        return value + slope * (stamp - middle)

    @property
    def offset(self) -> float:
        """`offset_at` the newest stamp [s]; NaN until there is one."""
        return self.offset_at(self._points[-1][0]) if self._points else np.nan

    def _line(self) -> tuple[float, float, float]:
        """Middle of the stamps, slope, and value at the middle of the line below all points."""
        points = np.array(self._points)
        middle = float(points[:, 0].mean())
        if len(points) < _ENOUGH:
            return middle, 0.0, float(points[:, 1].min())
        hull: list[tuple[float, float]] = []
        for x, y in sorted(map(tuple, points.tolist())):
            while len(hull) > 1 and _turns_up(hull[-2], hull[-1], (x, y)):
                hull.pop()
            hull.append((x, y))
        # The line on that side of the lower hull that is below the middle is the highest there.
        for (x0, y0), (x1, y1) in itertools.pairwise(hull):
            if x0 <= middle <= x1 and x1 > x0:
                slope = (y1 - y0) / (x1 - x0)
                return middle, slope, y0 + slope * (middle - x0)
        return middle, 0.0, float(points[:, 1].min())


def _turns_up(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
