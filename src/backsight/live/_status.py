"""How a run stands: a line for the terminal, a table for the dashboard."""

import collections
import math
import time
from typing import Any

import numpy as np

from backsight.live._lanes import Lane
from backsight.live._session import LiveSession
from backsight.schema import Status

_NIS_OVER = 2000
"""Samples over which the mean NIS is told."""


class LiveStatus:
    """Numbers about a run, brought up to date by `look`.

    Parameters
    ----------
    session : LiveSession
    """

    def __init__(self, session: LiveSession) -> None:
        self.session = session
        self.samples = 0
        """Samples that were estimated."""
        self._first = session.estimation.done
        self._nis: collections.deque[float] = collections.deque(maxlen=_NIS_OVER)
        self._latencies: collections.deque[float] = collections.deque(maxlen=10_000)
        self.raised = 0
        """Status bits since the last look."""
        self.now = time.time()
        self._unknown = frozenset(session.live.model.resting)  # which asks CasADi
        session.listeners.append(self._take)

    def _take(self, rows: Any) -> None:
        """Take in the newest samples."""
        self.samples += len(rows)
        self._nis.extend(rows.values["nis"][-_NIS_OVER:].tolist())
        self._raised = int(np.bitwise_or.reduce(rows.values["status"]))
        self.raised |= self._raised

    def look(self, now: float) -> None:
        """Take what happened since the last look."""
        self.now = now
        self._latencies.extend(self.session.latencies)
        self.session.latencies.clear()

    @property
    def nis(self) -> float:
        """Mean NIS of the last samples, by the number of outputs that were measured; 1 is right."""
        known = [v for v in self._nis if math.isfinite(v)]
        return float(np.mean(known)) / self.session.sensors if known else math.nan

    def latency(self, quantile: float) -> float:
        """From the arrival of a sample to its estimate [s]."""
        return float(np.quantile(self._latencies, quantile)) if self._latencies else math.nan

    def states(self) -> list[dict[str, Any]]:
        """Newest estimate of every state."""
        rows, model = self.session.newest, self.session.live.model
        if rows is None or not len(rows):
            return []
        x, std = rows.values["x_hat"][-1], rows.values["x_std"][-1]
        return [
            {
                "name": s.name,
                "unit": s.unit,
                "value": _finite(x[k]),
                "std": _finite(std[k]),
                "unknown": s.name in self._unknown,
            }
            for k, s in enumerate(model.states)
        ]

    def sources(self) -> list[dict[str, Any]]:
        """What every source does."""
        return [self._source(lane) for lane in self.session.lanes]

    def _source(self, lane: Lane) -> dict[str, Any]:
        counts, source = lane.placing.counts, lane.source
        return {
            "name": lane.name,
            "kind": source.feed.kind,
            "state": source.state,
            "silent": lane.silent(self.now),
            "rate": _finite(lane.rate(self.now)),
            "offset": _finite(lane.clock.offset),
            "drift": _finite(lane.clock.drift),
            "lateness": _finite(lane.worst_lateness),
            "lost": source.lost,
            "gaps": lane.gaps,
            **vars(counts),
        }

    def line(self) -> str:
        """The state in one line."""
        session = self.session
        parts = [time.strftime("%H:%M:%S", time.localtime(self.now))]
        for lane in session.lanes:
            counts = lane.placing.counts
            words = [f"{lane.name} {lane.rate(self.now):.4g}/s"]
            for word in ("late", "too_late", "duplicates", "malformed", "implausible"):
                if count := getattr(counts, word):
                    words.append(f"{count} {word.replace('_', ' ')}")
            if lane.source.lost:
                words.append(f"{lane.source.lost} lost")
            if lane.silent(self.now):
                words.append(f"silent for {lane.silent_for(self.now):.0f} s")
            parts.append(", ".join(words))
        if math.isfinite(self.nis):
            parts.append(f"NIS {self.nis:.2f}")
        chosen = [s for s in self.states() if s["unknown"]] or self.states()
        for state in chosen[:4]:
            if state["value"] is not None:
                band = "" if state["std"] is None else f" ± {2 * state['std']:.2g}"
                parts.append(f"{state['name']} {state['value']:.5g}{band} {state['unit']}".strip())
        if self.raised:
            names = [b.name.lower().replace("_", " ") for b in Status if b & self.raised and b.name]
            parts.append(", ".join(names))
            self.raised = 0
        if self._latencies:
            parts.append(f"latency {1e3 * self.latency(0.5):.0f} ms")
        return "  ".join(parts)

    @property
    def given_up(self) -> int:
        """Samples that could not be stored."""
        return self.session.keeper.given_up if self.session.keeper is not None else 0

    def summary(self) -> str:
        """What happened, at the end."""
        session = self.session
        parts = [f"{self.samples} samples estimated"]
        for lane in session.lanes:
            counts = vars(lane.placing.counts)
            words = [f"{counts['received']} received"]
            for word in ("malformed", "duplicates", "late", "too_late", "implausible"):
                if counts[word]:
                    words.append(f"{counts[word]} {word.replace('_', ' ')}")
            parts.append(f"{lane.name}: {', '.join(words)}")
        if session.keeper is not None:
            parts.append(f"{session.keeper.stored} stored")
            if self.given_up:
                parts.append(f"{self.given_up} given up")
        return "; ".join(parts)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
