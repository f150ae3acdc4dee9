"""What the dashboard shows, made by the thread of the run and read by those of the server."""

import collections
import json
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from backsight.live._freezing import SEEN
from backsight.live._session import LiveSession
from backsight.live._status import LiveStatus
from backsight.live.dashboard._history import History
from backsight.live.dashboard._saving import Recent
from backsight.live.dashboard._verdict import verdict
from backsight.live.engine import LiveRows
from backsight.models.model import Model
from backsight.types import Array

FRAMES = 64
"""Frames that are kept for browsers that are slow."""

_EVERY = 0.05
"""Seconds of the clock between two frames."""


class Board:
    """Frames for browsers, a history, and what is known about the run.

    Parameters
    ----------
    session : LiveSession
    status : LiveStatus
    recent : Recent
    """

    def __init__(self, session: LiveSession, status: LiveStatus, recent: Recent) -> None:
        self.session, self._status, self.recent = session, status, recent
        model = session.live.model
        self._inputs = [k for k, s in enumerate(model.inputs) if not s.name.startswith(SEEN)]
        self._outputs = [k for k, s in enumerate(model.outputs) if s.dummy is None]
        virtual = () if model.virtual is None else model.virtual.signals
        self._forces = list(session.labels.get("d_hat", ()))
        self.map = _map_of(model, self._forces)
        self._keys = [
            *(("state", s.name, s.unit) for s in model.states),
            *(("virtual", s.name, s.unit) for s in virtual),
            *(("force", name, "") for name in self._forces),
            *(("input", model.inputs[k].name, model.inputs[k].unit) for k in self._inputs),
            *(("measured", model.outputs[k].name, model.outputs[k].unit) for k in self._outputs),
            *(("predicted", model.outputs[k].name, model.outputs[k].unit) for k in self._outputs),
            ("nis", "NIS", ""),
        ]
        self.history = History([f"{kind}:{name}" for kind, name, _ in self._keys])
        self._frames: collections.deque[tuple[int, bytes]] = collections.deque(maxlen=FRAMES)
        self._number, self._due = 0, 0.0
        self._lock = threading.Lock()
        self.ended = False
        """Whether the run is over."""
        session.listeners.append(self._take)

    def described(self) -> dict[str, Any]:
        """What does not change during the run."""
        live = self.session.live
        return {
            "title": live.problem.title,
            "estimator": live.estimator.title,
            "dt": self.session.grid.dt,
            "unknown": list(live.model.resting),
            "map": self.map,
            "series": [{"kind": k, "name": n, "unit": u} for k, n, u in self._keys],
        }

    def columns(self) -> list[tuple[str, str | None]]:
        """Column of every quantity in the store, and that of its standard deviation."""
        places = {
            "state": ("x_hat.", "x_std."), "virtual": ("z_hat.", "z_std."),
            "force": ("d_hat.", "d_std."), "input": ("u.", None), "measured": ("y.", None),
            "predicted": ("y_hat.", None),
        }  # fmt: skip
        found: list[tuple[str, str | None]] = []
        for kind, name, _ in self._keys:
            hat, std = places.get(kind, ("", None))
            found.append((hat + name if hat else "nis", std and std + name))
        return found

    def _take(self, rows: LiveRows) -> None:
        """Take in the newest samples; called by the thread of the run."""
        grid = self.session.grid
        times = grid.time(np.arange(rows.start, rows.start + len(rows)))
        self.history.add(times, *self._columns(rows))
        self.recent.add(float(times[0]), rows)

    def _columns(self, rows: LiveRows) -> tuple[Array, Array]:
        """Values and standard deviations of all quantities, (n, m) each."""
        values, n = rows.values, len(rows)
        hat = [values["x_hat"]]
        std = [values["x_std"]]
        for name in ("z", "d"):
            if f"{name}_hat" in values:
                hat.append(values[f"{name}_hat"])
                std.append(values.get(f"{name}_std", np.full_like(hat[-1], np.nan)))
        hat += [
            rows.u[:, self._inputs],
            rows.y[:, self._outputs],
            values["y_hat"][:, self._outputs],
            values["nis"][:, None],
        ]
        width = len(self._keys) - sum(s.shape[1] for s in std)
        return np.hstack(hat), np.hstack([*std, np.full((n, width), np.nan)])

    def publish(self, now: float) -> None:
        """Make a frame if it is time."""
        if now < self._due:
            return
        self._due = now + _EVERY
        self._status.look(now)
        light, sentence = verdict(self.session, self._status)
        alarms = self.session.alarms
        frame = {
            "time": self._newest_time(),
            "fresh": self.history.fresh(),
            "states": self._status.states(),
            "sources": self._status.sources(),
            "verdict": {"light": light, "sentence": sentence},
            "nis": _known(self._status.nis),
            "latency": [_known(self._status.latency(q)) for q in (0.5, 0.999)],
            "samples": self._status.samples,
            "stored": None if self.session.keeper is None else self.session.keeper.stored,
            "saved": [s.described() for s in self.recent.saved[-10:]],
            **({"alarms": [], "events": []} if alarms is None else alarms.described()),
        }
        content = json.dumps(frame, allow_nan=False).encode()
        with self._lock:
            self._number += 1
            self._frames.append((self._number, content))

    def _newest_time(self) -> float | None:
        rows = self.session.newest
        if rows is None:
            return None
        return float(self.session.grid.time(rows.start + len(rows) - 1))

    def after(self, number: int) -> tuple[list[tuple[int, bytes]], bool]:
        """Frames after one; and whether some before them are gone already."""
        with self._lock:
            found = [(k, content) for k, content in self._frames if k > number]
        return found, bool(found) and found[0][0] > number + 1

    @property
    def newest(self) -> int:
        """Number of the newest frame."""
        return self._number


def _map_of(model: Model, forces: Sequence[str]) -> dict[str, Any] | None:
    """Forces along a structure, in the order of their places; None if there are not several."""
    places = {s.name: s.position for s in model.parameters}
    walks = [n for n in model.resting if places.get(n) is not None]
    names = list(forces) or walks
    if len(names) < 2:
        return None
    if all(places.get(n) is not None for n in names):
        names.sort(key=lambda n: float(places[n] or 0.0))
    units = {s.name: s.unit for s in (*model.parameters, *model.states)}
    return {
        "kind": "force" if forces else "state",
        "names": names,
        "places": [places.get(n) for n in names],
        "unit": units.get(names[0], ""),
    }


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
