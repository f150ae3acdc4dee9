"""Alarms: raised when their condition lasts, cleared when it is over, told to those who asked."""

import collections
import dataclasses
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from backsight.live.alarms._outlets import Outlets
from backsight.live.alarms._sighting import Condition, Sighting
from backsight.live.engine import LiveRows
from backsight.problem.reading.tables import AlarmTable

MOST_EVENTS = 200
"""Events that are kept to be looked at."""


@dataclasses.dataclass
class Alarm:
    """An alarm and how it stands.

    Parameters
    ----------
    name : str
    table : AlarmTable
    condition : Condition
    """

    name: str
    table: AlarmTable
    condition: Condition
    raised: bool = False
    acknowledged: bool = True
    sentence: str = ""
    value: float | None = None
    place: float | None = None
    since: float | None = None
    """Time of the sample at which it was raised [s]."""
    _turning: float | None = None
    """Time since when the condition says the other thing."""

    def see(self, rows: LiveRows, now: float) -> Sighting | None:
        """Look at new samples, the last of them at `now`; what raised or cleared it, if that did.

        What it says of itself stays what it was raised for, until it is raised again.
        """
        seen = self.condition.see(rows)
        if seen is None:
            return None
        turns = seen.over if self.raised else seen.there
        if self.raised and seen.there:
            self.value, self.sentence = seen.value, seen.sentence
        if not turns:
            self._turning = None
            return None
        if self._turning is None:
            self._turning = now
        if now - self._turning < self.table.hold:
            return None
        self._turn(seen, now)
        return seen

    def _turn(self, seen: Sighting, now: float) -> None:
        self._turning = None
        self.raised = not self.raised
        if self.raised:
            self.acknowledged, self.since = False, now
            self.sentence, self.value, self.place = seen.sentence, seen.value, seen.place

    def described(self) -> dict[str, Any]:
        """As JSON."""
        names = ("name", "raised", "acknowledged", "sentence", "value", "place", "since")
        return {"kind": self.table.kind, **{name: getattr(self, name) for name in names}}


class Alarms:
    """All alarms of a run.

    Parameters
    ----------
    alarms : dict
    tell : callable
        Told, in a sentence, what is raised and cleared.
    """

    def __init__(self, alarms: Mapping[str, Alarm], *, tell: Callable[[str], None]) -> None:
        self.alarms, self._tell = alarms, tell
        self.events: collections.deque[dict[str, Any]] = collections.deque(maxlen=MOST_EVENTS)
        self._outlets = Outlets({name: a.table for name, a in alarms.items()}, tell)
        self._lock = threading.Lock()

    def see(self, rows: LiveRows, time_of: Callable[[int], float]) -> None:
        """Look at new samples."""
        if not len(rows):
            return
        now = time_of(rows.start + len(rows) - 1)
        for alarm in self.alarms.values():
            if (seen := alarm.see(rows, now)) is not None:
                self._announce(alarm, seen, now)

    def _announce(self, alarm: Alarm, seen: Sighting, now: float) -> None:
        word = "raised" if alarm.raised else "cleared"
        found = {"sentence": seen.sentence, "value": seen.value, "place": seen.place}
        event = {**alarm.described(), **found, "event": word, "time": now, "at": time.time()}
        with self._lock:
            self.events.append(event)
        self._tell(f"alarm {alarm.name} {word}: {seen.sentence}")
        self._outlets.send(alarm.name, alarm.table, event)

    def acknowledge(self, name: str) -> bool:
        """Somebody has seen an alarm; False if there is none of the name."""
        alarm = self.alarms.get(name)
        if alarm is None:
            return False
        alarm.acknowledged = True
        return True

    def described(self) -> dict[str, Any]:
        """Alarms and the last events, as JSON."""
        with self._lock:
            events = list(self.events)[-20:]
        return {"alarms": [a.described() for a in self.alarms.values()], "events": events}

    def close(self) -> None:
        """Wait a moment for what is being sent."""
        self._outlets.close()
