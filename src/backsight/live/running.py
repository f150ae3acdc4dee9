"""Run until it is ended: rounds at an even pace, a line per second, a clean end."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from backsight.engine.execute import Engine
from backsight.live._lanes import Lane
from backsight.live._opening import opened_session
from backsight.live._problem import load_live
from backsight.live._ready import made_ready
from backsight.live._reviving import can_revive, revive
from backsight.live._session import LiveSession
from backsight.live._status import LiveStatus
from backsight.problem.reading.tables import DashboardTable

if TYPE_CHECKING:
    from backsight.live.dashboard import Board

ROUNDS = 4
"""In the time of a block."""

SWITCH = 5e-4
"""Seconds after which one thread of Python lets another one go on; a round must not wait longer
for the thread that writes."""

_IMPATIENT = 1.0
"""Seconds after which another Ctrl-C is meant."""


def run_live(
    path: Path,
    *,
    tell: Callable[[str], None],
    show: Callable[[str], None] | None,
    speed: float | None = None,
    dashboard: bool = False,
    engine: Engine = "native",
    survive: bool = False,
) -> LiveStatus:
    """Run a problem file on samples that come, until the sources end or it is interrupted.

    Parameters
    ----------
    path : Path
        Problem file.
    tell : callable
        Told what the user should know, a sentence at a time.
    show : callable, optional
        Shown a line every second.
    speed : float, optional
        Of a replay, in place of the file's.
    dashboard : bool
        Serve a dashboard also if the file does not ask for one.
    engine : {"native", "vm"}
    survive : bool
        Go on from the last part of the store when the run is killed: it is done in copies of this
        process, which itself does nothing but begin another one, see `backsight.live._reviving`.

    Returns
    -------
    LiveStatus
        How it stood at the end.

    Raises
    ------
    BacksightError
        If it cannot begin.
    """
    live = load_live(path, speed=speed)
    table = live.dashboard or (DashboardTable() if dashboard else None)
    with contextlib.ExitStack() as stack:
        place = None
        if table is not None:
            from backsight.live.dashboard import placed_board

            place = stack.enter_context(placed_board(table, path.parent, tell=tell))
        ready = made_ready(live, engine=engine)
        if survive and live.store is not None and can_revive():
            revive(tell)
        stopping = stack.enter_context(ended_by_signals())
        session = stack.enter_context(opened_session(ready, tell=tell))
        for lane in session.lanes:
            tell(f"source {lane.name}: {lane.source.state}")
        status, board = LiveStatus(session), None
        if place is not None:
            from backsight.live.dashboard import served_board

            board = stack.enter_context(served_board(session, status, place))
        try:
            keep_going(session, status, stopping, show=show, board=board)
        finally:
            session.close()
        status.look(time.time())
        return status


def keep_going(
    session: LiveSession,
    status: LiveStatus,
    stopping: threading.Event,
    *,
    show: Callable[[str], None] | None,
    board: Board | None = None,
) -> None:
    """Do rounds until the sources end or `stopping` is set.

    A round begins every quarter of a block: what comes then waits for less than that, and the rest
    is left for the work and for what else the processor does.
    """
    pace = session.live.settings.block / ROUNDS
    hurried = any(lane.replayed and not _speed(lane) for lane in session.lanes)
    sys.setswitchinterval(SWITCH)
    due, line_due = time.monotonic(), time.monotonic() + 1.0
    while not stopping.is_set():
        last = session.ended
        came = session.round()
        if board is not None:
            board.publish(time.time())
        now = time.monotonic()
        if now >= line_due:
            line_due = max(line_due + 1.0, now)
            status.look(time.time())
            if show is not None:
                show(status.line())
        if last and not came:
            return
        if not (hurried and came):
            due = max(due + pace, now)
            stopping.wait(due - now)


def _speed(lane: Lane) -> float:
    return float(getattr(lane.source.feed, "speed", 1.0))


@contextlib.contextmanager
def ended_by_signals() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C and SIGTERM set; another one a second later interrupts at once.

    A terminal sends Ctrl-C to all processes of a command, and one of them may pass it on.
    """
    stopping, asked = threading.Event(), 0.0
    if threading.current_thread() is not threading.main_thread():
        yield stopping
        return

    def stop(*_: object) -> None:
        nonlocal asked
        if stopping.is_set() and time.monotonic() - asked > _IMPATIENT:
            raise KeyboardInterrupt
        if not stopping.is_set():
            asked = time.monotonic()
        stopping.set()

    before = {s: signal.signal(s, stop) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
