"""Runs of problem files, one at a time, in the background."""

import dataclasses
import functools
import secrets
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from backsight.errors import BacksightError
from backsight.problem import load, run_problem
from backsight.problem.running import PAGE
from backsight.run.estimation import failure


class _Stopped(Exception):  # noqa: N818  it is no error
    """The user does not want the result any more."""


@dataclasses.dataclass
class BackgroundRun:
    """A run and how far it is; its thread writes, the page reads.

    Parameters
    ----------
    number : int
        From 1 on.
    problem, base, out : Path
        The problem file, the folder from which paths in it lead, and that of the results.
    """

    number: int
    problem: Path
    base: Path
    out: Path
    state: Literal["running", "done", "failed", "stopped"] = "running"
    doing: str = "reading and compiling"
    share: float = 0.0
    said: list[str] = dataclasses.field(default_factory=list)
    error: str = ""
    seconds: float = 0.0
    title: str = ""
    key: str = dataclasses.field(default_factory=lambda: secrets.token_urlsafe(16))
    _stop: threading.Event = dataclasses.field(default_factory=threading.Event)

    def described(self) -> dict[str, object]:
        """What the page shows of it."""
        report = f"/report/{self.key}" if (self.out / PAGE).exists() else None
        names = ("number", "state", "doing", "share", "said", "error", "seconds", "title")
        return {"report": report, **{name: getattr(self, name) for name in names}}

    def stop(self) -> None:
        """Ask it to end; it does at its next block of samples, and leaves nothing behind."""
        self._stop.set()

    def go(self) -> None:
        """Run the problem; whatever goes wrong is said in `error`."""
        begin = time.monotonic()
        try:
            with warnings.catch_warnings():
                warnings.showwarning = functools.partial(_heard, self.said.append)
                self._go()
        except _Stopped:
            self.state = "stopped"
        except BacksightError as error:
            self.error, self.state = str(error), "failed"
        except MemoryError:
            self.error = "there is not enough memory; use a shorter piece of the recording"
            self.state = "failed"
        except Exception as error:
            traceback.print_exc()
            self.error = f"a fault of Backsight, {type(error).__name__}: {error}; please report it"
            self.state = "failed"
        finally:
            self.seconds = round(time.monotonic() - begin, 1)

    def _go(self) -> None:
        read = load(self.problem)
        read = dataclasses.replace(read, path=self.base / self.problem.name)
        self.title = read.title
        results = run_problem(read, self.out, progress=self._advance, tell=self.said.append)
        self.said += results.verdicts(read.reference)
        failures = {name: failure(result) for name, result in results.items()}
        self.error = "; ".join(f"{name}: {reason}" for name, reason in failures.items() if reason)
        self.share, self.state = 1.0, "done"

    def _advance(self, name: str, done: int, samples: int) -> None:
        self.doing, self.share = name, done / samples
        if self._stop.is_set():
            raise _Stopped


def _heard(tell: Callable[[str], None], message: Warning, *_: object) -> None:
    tell(str(message))
