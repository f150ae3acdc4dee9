"""The history of a dashboard survives the end of the run, in the folder of the store.

It is written there every minute, whole. What came after the last time is read from the parts.
"""

import contextlib
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from backsight.errors import OutputError
from backsight.live.dashboard._history import History
from backsight.live.store import LiveStore
from backsight.output import write_whole

FILE = ".history.npz"

EVERY = 60.0
"""Seconds between two times that it is written."""

MOST_BYTES = 64 * 2**20
"""Size of the parts that are read at the start; of what comes faster, only the end."""


@contextlib.contextmanager
def kept_history(
    history: History, store: LiveStore | None, columns: Sequence[tuple[str, str | None]]
) -> Iterator[None]:
    """Fill a history with what was before, and keep it, in the background.

    Parameters
    ----------
    history : History
    store : LiveStore, optional
        Without one nothing is remembered.
    columns : sequence of (str, str or None)
        Column of every quantity in the store, and that of its standard deviation.
    """
    if store is None:
        yield
        return
    ended = threading.Event()
    file = store.folder / FILE

    def work() -> None:
        _recall(history, store, columns)
        while not ended.wait(EVERY):
            _keep(history, file)
        _keep(history, file)

    thread = threading.Thread(target=work, name="history", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(10.0)


def _recall(history: History, store: LiveStore, columns: Sequence[tuple[str, str | None]]) -> None:
    """Take over the file; read what came after it from the parts."""
    since = -np.inf
    # A file of another version, or one that the disk has damaged, is as good as none.
    with contextlib.suppress(OSError, ValueError, KeyError, EOFError):
        since = history.take_over((store.folder / FILE).read_bytes())
    for part in _newest(store.parts()):
        found = store.columns(part)
        new = found.get("time", np.empty(0)) >= since
        if new.any():
            absent = np.full(int(new.sum()), np.nan)
            values, spread = (
                np.column_stack([found[n][new] if n in found else absent for n in names])
                for names in zip(*columns, strict=True)
            )
            history.add(found["time"][new], values, spread)


def _newest(parts: Sequence[Path]) -> list[Path]:
    """The newest parts, in the order of time, as many as are read in a moment."""
    chosen, size = [], 0
    for part in reversed(parts):
        with contextlib.suppress(OSError):  # it was removed for its age
            size += part.stat().st_size
            if size > MOST_BYTES:
                break
            chosen.append(part)
    return chosen[::-1]


def _keep(history: History, file: Path) -> None:
    """Write the file; a full disk is said by whoever stores the results."""
    with contextlib.suppress(OutputError):
        write_whole(file, history.packed())
