"""Locks of files and folders, which go with the process, however that ends."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from backsight.errors import OutputError
from backsight.output._disk import writing

Lock = Literal["held", "taken", "unknown"]
"""Ours, another's, or nobody can tell: the system or the disk has no locks."""

HOLD = ".lock"
"""File in a folder to which one process at a time writes."""


@contextlib.contextmanager
def locked(path: Path, *, wait: bool) -> Iterator[Lock]:
    """Lock a file or a folder.

    Parameters
    ----------
    path : Path
    wait : bool
        Whether to wait for another who has it.
    """
    if os.name == "nt":
        yield "unknown"
        return
    import fcntl

    try:
        # Disks of a network lock only what may be written; a folder cannot be opened so.
        number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    except OSError:
        yield "unknown"
        return
    try:
        state: Lock = "held"
        try:
            fcntl.flock(number, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            state = "taken"
        except OSError:
            state = "unknown"
        yield state
    finally:
        os.close(number)


@contextlib.contextmanager
def holding(folder: Path) -> Iterator[None]:
    """Be the only process that writes to a folder, where the system can tell.

    Raises
    ------
    OutputError
        If another process does, or the folder cannot be written.
    """
    with writing(folder):
        os.close(os.open(folder / HOLD, os.O_RDWR | os.O_CREAT, 0o600))
    with locked(folder / HOLD, wait=False) as lock:
        if lock == "taken":
            raise OutputError(f"another process writes to '{folder}'; wait for it")
        yield
