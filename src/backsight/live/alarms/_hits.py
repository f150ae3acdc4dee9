"""Alarms about hits: while a force is large, or once when a hit is over and sure."""

import numpy as np

from backsight.errors import ProblemError
from backsight.live.alarms._sighting import Condition, Quantities, Sighting
from backsight.live.engine import LiveRows
from backsight.problem.reading.tables import HitAlarm

GHOST = 0.3
"""A hit below this share of one elsewhere at the same time is not told."""


class HitCondition(Condition):
    """See `HitAlarm`."""

    def __init__(self, table: HitAlarm, quantities: Quantities, where: str) -> None:
        names = table.of or quantities.forces
        quantities.check(names, where)
        if not names:
            raise ProblemError(f"{where}: neither the model nor the estimator has a force")
        self._table, self._quantities, self._names = table, quantities, names

    def see(self, rows: LiveRows) -> Sighting:
        """See `Condition.see`."""
        best, worst, place = "", 0.0, None
        for name in self._names:
            values, spread = self._quantities.of(rows, name)
            sure = np.abs(values) > self._table.sigmas * spread
            sizes = np.where(sure, np.abs(values), 0.0)
            k = int(np.argmax(sizes))
            if sizes[k] > abs(worst):
                best, worst = name, float(values[k])
                place = self._quantities.positions.get(name)
        there = abs(worst) >= self._table.threshold
        if not best:
            return Sighting(False, True, "no force is larger than its band", worst)
        unit = self._quantities.units[best]
        where = "" if place is None else f" at {place:g} m"
        sentence = f"{best} is {worst:.4g} {unit}".rstrip() + where
        return Sighting(there, not there, sentence, worst, place)


class AnnouncedCondition(Condition):
    """See `HitAlarm`: hits that are over, with what chance has to do with them."""

    def __init__(
        self, table: HitAlarm, quantities: Quantities, dt: float, where: str, per_hour: float
    ) -> None:
        names = table.of or quantities.forces
        quantities.check(names, where)
        if not names:
            raise ProblemError(f"{where}: neither the model nor the estimator has a force")
        self._table, self._quantities, self._names, self._dt = table, quantities, names, dt
        # Few alarms need it, and it takes a tenth of a second to import.
        from backsight.analysis.forces import HitWatch

        self._watch = HitWatch(names, dt, per_hour=per_hour, gap=1, ghost=GHOST)

    def see(self, rows: LiveRows) -> Sighting:
        """See `Condition.see`."""
        values, spread = np.stack([self._quantities.of(rows, n) for n in self._names], axis=2)
        told = [
            hit
            for k in range(len(rows))
            for hit in self._watch.see((rows.start + k) * self._dt, values[k], spread[k])
            if abs(hit.force) >= self._table.threshold
        ]
        if not told:
            return Sighting(False, True, "no hit is over", 0.0)
        hit = max(told, key=lambda one: abs(one.impulse))
        unit, place = self._quantities.units[hit.place], self._quantities.positions.get(hit.place)
        where = "" if place is None else f" at {place:g} m"
        sentence = (
            f"{hit.place}{where}: {hit.force:.4g} ± {3 * hit.force_std:.2g} {unit}".rstrip()
            + f", {hit.told - hit.time:.3g} s ago; noise makes one as sure in "
            f"{hit.false_alarm:.1g} of all samples at most"
        )
        return Sighting(True, False, sentence, hit.force, place)
