"""What an alarm looks at: for every kind, whether it is there, and what is said of it."""

import collections

import numpy as np
import scipy

from backsight.errors import ProblemError, nearest
from backsight.live.alarms._hits import AnnouncedCondition, HitCondition
from backsight.live.alarms._sighting import Condition, Quantities, Sighting
from backsight.live.engine import LiveRows
from backsight.models.model import Model
from backsight.problem.reading.tables import (
    AlarmTable,
    HitAlarm,
    NisAlarm,
    RangeAlarm,
    SilentAlarm,
    StatusAlarm,
)
from backsight.schema import Status

_BACK = 0.8
"""Share of its band inside which a mean must be again before an alarm is cleared."""


class RangeCondition(Condition):
    """See `RangeAlarm`."""

    def __init__(self, table: RangeAlarm, quantities: Quantities, where: str) -> None:
        quantities.check([table.of], where)
        if table.lower is None and table.upper is None:
            raise ProblemError(f"{where}: give lower, upper, or both")
        self._table, self._quantities = table, quantities

    def see(self, rows: LiveRows) -> Sighting:
        """See `Condition.see`."""
        table = self._table
        values, spread = self._quantities.of(rows, table.of)
        low = -np.inf if table.lower is None else table.lower
        high = np.inf if table.upper is None else table.upper
        band = table.sigmas * spread
        beyond = np.maximum(low - (values + band), (values - band) - high)
        worst = int(np.argmax(np.nan_to_num(beyond, nan=-np.inf)))
        newest = float(values[-1])
        inside = low + table.hysteresis <= newest <= high - table.hysteresis
        unit = self._quantities.units[table.of]
        value, ends = float(values[worst]), float(band[worst])
        end = f"below {low:g}" if value < low else f"above {high:g}"
        sentence = f"{table.of} is {value:.5g} ± {ends:.2g} {unit}".rstrip()
        there = bool(beyond[worst] > 0)
        return Sighting(there, inside, f"{sentence}, {end}" if there else sentence, value)


class NisCondition(Condition):
    """See `NisAlarm`."""

    def __init__(self, table: NisAlarm, dt: float) -> None:
        self._table, self._dt = table, dt
        self._parts: collections.deque[tuple[int, float, int]] = collections.deque()
        # For quantiles of chi-square, imported before the first sample rather than between two;
        # `scipy.stats` takes longer to import than all of this package.
        self._inverse = scipy.special.gammaincinv

    def see(self, rows: LiveRows) -> Sighting | None:
        """See `Condition.see`."""
        nis = rows.values["nis"]
        known = np.isfinite(nis)
        freedom = int(np.isfinite(rows.values["e"])[known].sum())
        self._parts.append((len(nis), float(nis[known].sum()), freedom))
        wanted = self._table.over / self._dt
        while sum(n for n, _, _ in self._parts) - self._parts[0][0] >= wanted:
            self._parts.popleft()
        total, freedom = sum(s for _, s, _ in self._parts), sum(f for _, _, f in self._parts)
        if not freedom or sum(n for n, _, _ in self._parts) < wanted:
            return None
        tail = (1 - self._table.level) / 2
        low, high = 2 * self._inverse(freedom / 2, [tail, 1 - tail]) / freedom
        # Over hours, any model is wrong by more than chance.
        low, high = min(low, 1 / self._table.factor), max(high, self._table.factor)
        mean = total / freedom
        what = "larger than" if mean > high else "smaller than" if mean < low else "as"
        sentence = (
            f"the innovations are {what} the estimator believes: mean NIS {mean:.3g} over "
            f"{self._table.over:g} s, its band is {low:.3g} to {high:.3g}"
        )
        back = _BACK * (low - 1) <= mean - 1 <= _BACK * (high - 1)
        return Sighting(not low <= mean <= high, bool(back), sentence, mean)


class SilentCondition(Condition):
    """See `SilentAlarm`."""

    def __init__(self, table: SilentAlarm, model: Model, dt: float, where: str) -> None:
        names = [s.name for s in model.outputs]
        for name in table.of:
            if name not in names:
                raise ProblemError(f"{where}.of: no output '{name}', {nearest(name, names)}")
        real = [s.name for s in model.outputs if s.dummy is None]
        self._names = table.of or real
        self._columns = [names.index(n) for n in self._names]
        self._after, self._dt = table.after, dt
        self._last: list[int | None] = [None] * len(self._names)

    def see(self, rows: LiveRows) -> Sighting:
        """See `Condition.see`."""
        newest, silent = rows.start + len(rows) - 1, []
        for j, column in enumerate(self._columns):
            known = np.flatnonzero(np.isfinite(rows.y[:, column]))
            if len(known):
                self._last[j] = rows.start + int(known[-1])
            last = self._last[j]
            if last is None:
                self._last[j] = rows.start
            elif (newest - last) * self._dt >= self._after:
                silent.append((self._names[j], (newest - last) * self._dt))
        said = ", ".join(f"{name} for {seconds:.3g} s" for name, seconds in silent)
        return Sighting(bool(silent), not silent, f"nothing was measured of {said}" if said else "")


class StatusCondition(Condition):
    """See `StatusAlarm`."""

    def __init__(self, table: StatusAlarm, where: str) -> None:
        known = [b.name.lower() for b in Status if b.name and b]
        for name in table.bits:
            if name not in known:
                raise ProblemError(f"{where}.bits: no status '{name}', {nearest(name, known)}")
        self._bits = [Status[name.upper()] for name in table.bits]

    def see(self, rows: LiveRows) -> Sighting:
        """See `Condition.see`."""
        raised = int(np.bitwise_or.reduce(rows.values["status"]))
        found = [str(b.name).lower().replace("_", " ") for b in self._bits if raised & b]
        return Sighting(bool(found), not found, f"the estimator reports {', '.join(found)}")


def condition_of(
    table: AlarmTable, quantities: Quantities, model: Model, *, dt: float, where: str
) -> Condition:
    """Return what the table of an alarm looks at.

    Raises
    ------
    ProblemError
        If it names something that there is not.
    """
    match table:
        case RangeAlarm():
            return RangeCondition(table, quantities, where)
        case NisAlarm():
            return NisCondition(table, dt)
        case HitAlarm():
            if table.false_alarms is None:
                return HitCondition(table, quantities, where)
            return AnnouncedCondition(table, quantities, dt, where, table.false_alarms)
        case SilentAlarm():
            return SilentCondition(table, model, dt, where)
        case StatusAlarm():
            return StatusCondition(table, where)
    raise ProblemError(f"{where}.kind: there is nothing that looks at '{table.kind}'")
