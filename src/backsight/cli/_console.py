"""What the command line says, and how: short lines that cannot steer the terminal."""

import contextlib
import functools
import shutil
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator

import typer

from backsight.errors import BacksightError, BacksightWarning, printable, shortened

WIDEST = 120
"""Columns of a table at most, however wide the terminal is."""

ENDINGS = ("SIGTERM", "SIGHUP")
"""Signals that ask a program to end."""


def warn(sentence: str) -> None:
    """Say something that the user should know, in one line."""
    tell(f"warning: {sentence}")


def tell(message: str) -> None:
    """Say something in one line that is not too long to be read."""
    typer.echo(f"backsight: {shortened(printable(' '.join(message.split())))}", err=True)


def _show(otherwise: Callable[..., None], message: Warning, category: type, *place: object) -> None:
    """Show a warning of the package as the command line does, any other as Python does."""
    if issubclass(category, BacksightWarning):
        warn(str(message))
    else:
        otherwise(message, category, *place)


def say(text: str) -> None:
    """Print text with names, titles and units from a file; they cannot steer a terminal."""
    typer.echo(printable(text))


@contextlib.contextmanager
def told() -> Iterator[None]:
    """Say in one line what the user can mend."""
    try:
        with _ended_by_signals(), warnings.catch_warnings():
            warnings.showwarning = functools.partial(_show, warnings.showwarning)
            yield
    except (BacksightError, BacksightWarning) as error:  # a warning if Python is told to raise it
        tell(str(error))
        raise typer.Exit(2) from None
    except MemoryError:
        tell("there is not enough memory; process the recording in parts")
        raise typer.Exit(2) from None
    except KeyboardInterrupt as interrupt:
        tell(", ".join(["interrupted", *getattr(interrupt, "__notes__", ())]))
        number = interrupt.args[0] if interrupt.args else signal.SIGINT
        raise typer.Exit(128 + number) from None
    except BrokenPipeError:
        raise  # whoever read what is said has gone: the end, without a word
    except OSError as error:
        what = error.strerror or str(error)
        tell(f"{what}: '{error.filename}'" if error.filename else what)
        raise typer.Exit(2) from None


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Take what batch systems and closing terminals send for an interrupt: they mean the same."""

    def interrupt(number: int, _: object) -> None:
        raise KeyboardInterrupt(number)

    known = [getattr(signal, name) for name in ENDINGS if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        known = []
    # One that is ignored, as by nohup, stays ignored.
    taken = [number for number in known if signal.getsignal(number) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


@contextlib.contextmanager
def bar() -> Iterator[Callable[[str, float], None]]:
    """Show what is being done and the share that is done, on a terminal only."""
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.TextColumn("{task.description}", markup=False),
        bars.BarColumn(),
        bars.TaskProgressColumn(),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(
        *columns,
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    ) as progress:
        tasks = {}

        def advance(text: str, share: float) -> None:
            if text not in tasks:
                tasks[text] = progress.add_task(text, total=1.0)
            progress.update(tasks[text], completed=share)

        yield advance


def width() -> int:
    """Return how many columns a table may have."""
    return min(shutil.get_terminal_size().columns, WIDEST) if sys.stdout.isatty() else 80
