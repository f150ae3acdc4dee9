"""What lies on the workbench: a recording, the runs of this session, and their reports."""

import math
import secrets
import threading
from pathlib import Path

from backsight.data import list_columns
from backsight.data.listing import FileColumns
from backsight.errors import DataError, ProblemError
from backsight.problem import load
from backsight.problem.results_file import read_estimates
from backsight.problem.running import ESTIMATES, PAGE, SUMMARY
from backsight.report import report
from backsight.workbench._modelled import remarks_on
from backsight.workbench._preview import Preview, previews
from backsight.workbench._runs import BackgroundRun

FILES = (PAGE, ESTIMATES, SUMMARY)
"""Results that can be saved, beside the problem file."""


class Workbench:
    """Everything of one session; `folder` holds recordings, problem files and results.

    Parameters
    ----------
    folder : Path
        What is in it already is left alone.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.found: FileColumns | None = None
        self.path = ""
        """Of the recording, as problem files name it."""
        self.text = ""
        """A problem file to begin with, if one was opened."""
        self.previews: dict[str, Preview] = {}
        """Of the columns of the recording."""
        self.base = folder
        """Where paths in problem files lead from."""
        self.runs: list[BackgroundRun] = []
        self._compared: dict[str, Path] = {}
        self._lock = threading.Lock()

    def open(self, file: Path) -> None:
        """Begin with a recording, or with a problem file.

        Raises
        ------
        DataError, ProblemError
            If it cannot be read.
        """
        if file.suffix.lower() == ".toml":
            self.text, self.base = load(file).text, file.absolute().parent
            return
        self._take(file, str(file.absolute()))

    def receive(self, name: str) -> Path:
        """Return where a recording that is sent is to be written; no file is overwritten.

        Raises
        ------
        DataError
            If the name is none for a file.
        """
        bare = Path(name.replace("\\", "/")).name.strip().lstrip(".")
        if not bare or not bare.isprintable() or len(bare.encode()) > 200:
            raise DataError("the name of the file cannot be used; give it another one")
        place, k = self.folder / bare, 2
        while place.exists():
            place, k = self.folder / f"{Path(bare).stem}-{k}{Path(bare).suffix}", k + 1
        return place

    def accept(self, file: Path) -> None:
        """Take a recording that lies in the folder now.

        Raises
        ------
        DataError
            If it cannot be read.
        """
        self._take(file, file.name)

    def _take(self, file: Path, path: str) -> None:
        found = list_columns(file)
        if not found.signals:
            raise DataError(f"{file.name} holds no column of numbers that could be a signal")
        self.previews = previews(found)
        self.found, self.path, self.text, self.base = found, path, "", self.folder

    @property
    def firsts(self) -> dict[str, float]:
        """Column to its first sample."""
        return {name: seen.first for name, seen in self.previews.items()}

    def listed(self) -> dict[str, object] | None:
        """What the page shows of the recording."""
        found = self.found
        if found is None:
            return None
        signals = [
            {
                "name": c.name,
                "unit": c.unit,
                "rate": _finite(c.rate),
                "low": _finite(c.low),
                "high": _finite(c.high),
                "samples": c.samples,
                "missing": c.missing,
                "remarks": [*remarks_on(c), *c.remarks],
                "band": self.previews[c.name].band if c.name in self.previews else None,
            }
            for c in found.signals
        ]
        return {
            "name": found.path.name,
            "signals": signals,
            "clock": found.clock,
            "sure": found.sure,
            "dt": _finite(found.dt),
            "remarks": [r for r in (found.understood, *found.remarks) if r],
        }

    def check(self, text: str) -> str:
        """Load a problem text as a run would; return its model in words.

        Raises
        ------
        ProblemError
            If there is something wrong in it.
        """
        place = self.folder / f".check-{secrets.token_hex(4)}.toml"
        place.write_text(text, encoding="utf-8")
        try:
            return str(load(place).model)
        except ProblemError as error:
            raise ProblemError(str(error).replace(str(place), "the problem")) from None
        finally:
            place.unlink()

    def start(self, text: str) -> BackgroundRun:
        """Run a problem text in the background.

        Raises
        ------
        ProblemError
            If a run is at work already.
        """
        with self._lock:
            if any(run.state == "running" for run in self.runs):
                raise ProblemError("a run is at work; stop it first, or wait until it is done")
            number = 1 + max((run.number for run in self.runs), default=0)
            while self._problem(number).exists() or (self.folder / f"run-{number}").exists():
                number += 1
            self._problem(number).write_text(text, encoding="utf-8")
            out = self.folder / f"run-{number}"
            run = BackgroundRun(number, self._problem(number), self.base, out)
            self.runs.append(run)
        threading.Thread(target=run.go, name=f"run {number}", daemon=True).start()
        return run

    def _problem(self, number: int) -> Path:
        return self.folder / f"run-{number}.toml"

    def run(self, number: int) -> BackgroundRun:
        """Return a run by its number; raises `ProblemError` if there is none."""
        for run in self.runs:
            if run.number == number:
                return run
        raise ProblemError(f"there is no run {number}")

    def compare(self, numbers: list[int]) -> str:
        """Draw the results of several runs on one page; return where it is.

        Raises
        ------
        ProblemError, DataError
            If a run has no results, or they are of different recordings.
        """
        chosen = [self.run(number) for number in numbers]
        if any(run.state != "done" for run in chosen):
            raise ProblemError("only runs that are done can be compared")
        results = {
            f"{run.number} {name}": result
            for run in chosen
            for name, result in read_estimates(run.out / ESTIMATES).results.items()
        }
        key = secrets.token_urlsafe(16)
        title = f"Runs {', '.join(str(run.number) for run in chosen)}"
        self._compared[key] = report(results, self.folder / f".compared-{key}.html", title=title)
        return f"/report/{key}"

    def report(self, key: str) -> Path | None:
        """Return the page that belongs to a key."""
        pages = {run.key: run.out / PAGE for run in self.runs} | self._compared
        for known, page in pages.items():
            if secrets.compare_digest(known.encode(), key.encode()):
                return page
        return None

    def close(self) -> None:
        """Stop what is running and take away what only this session needs."""
        for run in self.runs:
            run.stop()
        for page in self._compared.values():
            page.unlink(missing_ok=True)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
