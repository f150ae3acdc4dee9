"""A run that goes on when it is killed.

Most of the time between a kill and the next estimate would go into importing and compiling. So the
process that was started keeps both, and runs in a copy of itself: when the system kills that for
want of memory, or a fault in foreign code ends it, there is another one within the time of a block.
The store knows where to go on; ports stay open meanwhile, and what comes to them waits.
"""

import collections
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

MOST, WITHIN = 5, 60.0
"""So many kills within so many seconds are no accident: the run is given up."""


def can_revive() -> bool:
    """Whether a process can be copied here: on Linux, and where no other thread of Python runs."""
    return sys.platform == "linux" and threading.active_count() == 1


def revive(tell: Callable[[str], None]) -> None:
    """Return in a copy of this process, and again in another copy when that is killed.

    This process itself does not return: it passes SIGINT, SIGTERM and SIGHUP on and ends as the
    copy did. If it is killed, the copy ends cleanly.

    Parameters
    ----------
    tell : callable
        Told, in a sentence, that the copy was killed.

    Raises
    ------
    SystemExit
        In this process, when the copy has ended.
    """
    parent = _Parent()
    kills: collections.deque[float] = collections.deque(maxlen=MOST)
    handlers = {s: signal.signal(s, parent.pass_on) for s in parent.passed_on}
    while (status := parent.copied()) is not None:
        if not os.WIFSIGNALED(status):
            sys.exit(os.waitstatus_to_exitcode(status))
        number = os.WTERMSIG(status)
        if parent.asked_to_end:
            sys.exit(128 + number)
        kills.append(time.monotonic())
        name = signal.Signals(number).name
        if len(kills) == MOST and kills[-1] - kills[0] < WITHIN:
            tell(f"the run was killed ({name}), {MOST} times within a minute: it is given up")
            sys.exit(1)
        tell(f"the run was killed ({name}) and begins again")
    for number, handler in handlers.items():
        signal.signal(number, handler)


class _Parent:
    """The process that waits, and how it is tied to its copy."""

    passed_on = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def __init__(self) -> None:
        self._copy: int | None = None
        self.asked_to_end = False
        self._lifeline = os.pipe()

    def pass_on(self, number: int, _frame: Any) -> None:
        """Give a signal to the copy."""
        self.asked_to_end = True
        if self._copy is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._copy, number)

    def copied(self) -> int | None:
        """Make a copy; None in it, and how it ended, as of `os.waitpid`, in this process."""
        sys.stdout.flush()
        sys.stderr.flush()
        process = os.fork()
        if process == 0:
            os.close(self._lifeline[1])
            threading.Thread(target=self._end_with_the_parent, daemon=True).start()
            return None
        self._copy = process
        _, status = os.waitpid(process, 0)
        self._copy = None
        return status

    def _end_with_the_parent(self) -> None:
        """Wait for the end of the pipe, which comes when the parent is no more."""
        os.read(self._lifeline[0], 1)
        os.kill(os.getpid(), signal.SIGTERM)
