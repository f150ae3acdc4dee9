"""Hits that are announced once their evidence is complete, with what chance has to do with them."""

import dataclasses
import math
from collections.abc import Sequence
from typing import final

import numpy as np
import xarray as xr

from backsight.analysis.forces._hits import forces
from backsight.description import NonNegative, Positive, Printed, Whole, checked
from backsight.errors import DataError
from backsight.types import Array

GATE = 2.0
"""Standard deviations beyond which a step belongs to a hit."""

HOUR = 3600.0


@dataclasses.dataclass(frozen=True)
class Announcement(Printed):
    """A hit that is over.

    Parameters
    ----------
    time, time_std : float
        Centre of gravity of the force and its standard deviation [s], not less than that of a
        moment within a sample.
    place : str
        Name of the force.
    force, force_std : float
        Largest force of a step [its unit].
    impulse, impulse_std : float
        Over the whole hit [unit of the force times s].
    false_alarm : float
        Probability that noise alone makes a hit as sure as this in one sample, at any of the
        places: at most, since every step of every place counts as a try.
    told : float
        Time of the row with which it was complete [s]. A stream is `lag` samples later.
    """

    time: float
    time_std: float
    place: str
    force: float
    force_std: float
    impulse: float
    impulse_std: float
    false_alarm: float
    told: float


@final
class HitWatch:
    """Joins forces to hits row by row, and announces those that are over and sure.

    Parameters
    ----------
    names : sequence of str
        The forces.
    dt : float
        Sampling period [s].
    per_hour : float
        False alarms per hour that are accepted.
    gap : int
        Steps without force that do not yet end a hit.
    ghost : float
        A hit is left out if it is smaller than this share of one elsewhere at the same time.
    """

    def __init__(
        self, names: Sequence[str], dt: float, *, per_hour: float, gap: int, ghost: float
    ) -> None:
        self._names, self._dt = list(names), dt
        self._most, self._gap, self._ghost = per_hour * dt / HOUR, gap, ghost
        self._open: list[list[tuple[float, float, float]]] = [[] for _ in self._names]
        self._over: list[tuple[int, float, float, float]] = []

    def see(self, time: float, d: Array, std: Array) -> list[Announcement]:
        """Take the forces over the step that begins at a time; what is announced with it."""
        for k, run in enumerate(self._open):
            if np.isfinite(d[k]) and abs(d[k]) > GATE * std[k]:
                run.append((time, float(d[k]), float(std[k])))
        return self._ended(time, quiet=(self._gap + 0.5) * self._dt)

    def end(self, time: float) -> list[Announcement]:
        """What was not over when the rows ended, the last of them at a time."""
        return self._ended(time, quiet=-1.0)

    def _ended(self, now: float, *, quiet: float) -> list[Announcement]:
        over = [k for k, run in enumerate(self._open) if run and now - run[-1][0] > quiet]
        told = [self._judged(k, now) for k in over]
        self._over += [(k, *self._span(k)) for k in over]
        for k in over:
            self._open[k] = []
        self._over = [old for old in self._over if now - old[2] < 100 * (self._gap + 1) * self._dt]
        return [hit for hit in told if hit is not None]

    def _span(self, k: int) -> tuple[float, float, float]:
        """First and last step of a hit, and its impulse."""
        run = self._open[k]
        return run[0][0], run[-1][0], sum(d for _, d, _ in run) * self._dt

    def _judged(self, k: int, now: float) -> Announcement | None:
        """The hit of a place, if it is sure and nothing else."""
        time, d, std = np.array(self._open[k]).T
        first, last, impulse = self._span(k)
        others = [(j, *self._span(j)) for j, run in enumerate(self._open) if run] + self._over
        for j, begin, end, other in others:
            if (
                j != k
                and begin <= last
                and first <= end
                and abs(impulse) < self._ghost * abs(other)
            ):
                return None
        spread = float(np.sqrt((std**2).sum())) * self._dt
        largest = int(np.abs(d).argmax())
        # Not by the impulse: steps that were chosen for being large add up to more than noise does.
        sure = abs(d[largest]) / std[largest] if std[largest] > 0 else math.inf
        chance = math.erfc(sure / math.sqrt(2))
        false_alarm = -math.expm1(len(self._names) * math.log1p(-chance)) if chance < 1 else 1.0
        if false_alarm > self._most:
            return None
        weights = np.abs(d) / np.abs(d).sum()
        centre = float(weights @ time) + self._dt / 2
        moved = (time + self._dt / 2 - centre) * std / np.abs(d).sum()
        return Announcement(
            time=centre,
            time_std=float(np.sqrt(self._dt**2 / 12 + (moved**2).sum())),
            place=self._names[k],
            force=float(d[largest]),
            force_std=float(std[largest]),
            impulse=impulse,
            impulse_std=spread,
            false_alarm=false_alarm,
            told=now,
        )


@checked(DataError)
def announce_hits(
    result: xr.Dataset, *, per_hour: Positive = 1.0, gap: Whole = 1, ghost: NonNegative = 0.3
) -> list[Announcement]:
    """Announce the hits of a result as a stream would: when each is over, and how sure it is.

    Neighbouring steps at a place are one hit; it is over when nothing has acted there for more than
    `gap` steps. It is announced if noise alone would make so few as sure as it that they are at
    most `per_hour` in an hour. Alarms of `backsight live` do the same (`false_alarms`).

    Parameters
    ----------
    result : xarray.Dataset
        With unknown forces ``d_hat`` and their ``d_std``.
    per_hour : float
        False alarms per hour that are accepted.
    gap : int
        Steps without force, at the same place, that do not yet end a hit.
    ghost : float
        A hit is left out if it is smaller than this share of one at another place at the same time.

    Returns
    -------
    list of Announcement
        In the order in which they are announced.

    Raises
    ------
    DataError
        If the result has no forces, or does not say how sure they are.

    Examples
    --------
    >>> import xarray as xr
    >>> forces = xr.Dataset(
    ...     {"d_hat": (("time", "force"), [[0.0], [6.0], [5.0], [0.0], [0.0], [0.0]]),
    ...      "d_std": (("time", "force"), [[0.0], [0.5], [0.5], [0.0], [0.0], [0.0]])},
    ...     {"time": [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], "force": ["hit"]},
    ...     {"dt": 0.1},
    ... )
    >>> (hit,) = bs.forces.announce_hits(forces)
    >>> print(f"{hit.place}: {hit.impulse:.2f} N s at {hit.time:.2f} s, told at {hit.told:.1f} s")
    hit: 1.10 N s at 0.20 s, told at 0.4 s
    """
    for name, what in (("d_hat", "unknown forces"), ("d_std", "deviations of its forces")):
        if name not in result:
            raise DataError(f"the result has no {what} '{name}'; use an estimator that tells them")
    held, spread = forces(result)
    names = [str(name) for name in held["force"].values]
    watch = HitWatch(names, float(result.attrs["dt"]), per_hour=per_hour, gap=gap, ghost=ghost)
    found: list[Announcement] = []
    times, d, std = held["time"].values, held.values, spread.values
    acting = (np.abs(d) > GATE * std).any(axis=1)
    looked_at = np.convolve(acting, np.ones(gap + 2))[: len(times)] > 0  # until it is over
    for k in np.flatnonzero(looked_at):
        found += watch.see(float(times[k]), d[k], std[k])
    return [*found, *watch.end(float(times[-1]))] if len(times) else found
