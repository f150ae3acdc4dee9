"""Save the last minutes as a recording with its problem file, and estimate that as a whole."""

import collections
import dataclasses
import secrets
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from backsight.errors import BacksightError, DataError
from backsight.live._freezing import SEEN
from backsight.live._problem import LiveProblem
from backsight.live.engine import LiveRows
from backsight.output import write_whole

PAGE = "report.html"
"""What `run_problem` writes."""

MOST_BYTES = 256 * 2**20
"""Of samples in memory; beyond that fewer minutes are kept."""

LIVE_TABLES = ("source", "live", "store", "alarm", "dashboard", "sink", "recording")


@dataclasses.dataclass
class Saved:
    """A recording that was saved, and its report."""

    name: str
    folder: Path
    state: str = "is estimated"
    key: str = dataclasses.field(default_factory=lambda: secrets.token_urlsafe(16))

    def described(self) -> dict[str, Any]:
        """As JSON."""
        there = (self.folder / PAGE).exists()
        return {
            "name": self.name,
            "state": self.state,
            "report": f"/report/{self.key}" if there else None,
        }


class Recent:
    """The samples of the last minutes.

    Parameters
    ----------
    live : LiveProblem
    dt : float
        Sampling period [s].
    folder : Path
        Where recordings are saved.
    minutes : float
        How long samples are kept [min].
    """

    def __init__(self, live: LiveProblem, dt: float, *, folder: Path, minutes: float) -> None:
        self._live, self._dt, self._folder = live, dt, folder
        self._most = minutes * 60.0 / dt
        self._parts: collections.deque[tuple[float, LiveRows]] = collections.deque()
        self._held = 0
        self._lock = threading.Lock()
        self.saved: list[Saved] = []

    def add(self, begin: float, rows: LiveRows) -> None:
        """Take in samples, the first of them at the time `begin`."""
        slim = LiveRows(rows.start, rows.u, rows.y, {})
        row_bytes = 8 * (rows.u.shape[1] + rows.y.shape[1])
        with self._lock:
            self._parts.append((begin, slim))
            self._held += len(slim)
            while self._held > self._most or self._held * row_bytes > MOST_BYTES:
                self._held -= len(self._parts.popleft()[1])

    def save(self, minutes: float) -> Saved:
        """Save the last minutes and begin to estimate them.

        Raises
        ------
        DataError
            If there is nothing to save.
        OutputError
            If the folder cannot be written.
        """
        with self._lock:
            parts = list(self._parts)
        if not parts or not np.isfinite(minutes) or minutes <= 0:
            raise DataError("there is nothing to save")
        end = parts[-1][0]
        chosen = [(begin, rows) for begin, rows in parts if begin >= end - 60.0 * minutes]
        name = time.strftime("%Y-%m-%d-%H-%M-%S")
        while (folder := self._folder / name).exists():
            name = f"{name}-{secrets.token_hex(2)}"
        self._write(folder, chosen)
        found = Saved(name, folder)
        self.saved.append(found)
        threading.Thread(target=self._estimate, args=(found,), daemon=True).start()
        return found

    def _write(self, folder: Path, parts: list[tuple[float, LiveRows]]) -> None:
        model, dt = self._live.model, self._dt
        times = np.concatenate([begin + dt * np.arange(len(rows)) for begin, rows in parts])
        u, y = (np.vstack([getattr(rows, name) for _, rows in parts]) for name in ("u", "y"))
        columns = {"time": times - times[0]}
        columns |= {
            f"u.{s.name}": u[:, k]
            for k, s in enumerate(model.inputs)
            if not s.name.startswith(SEEN)
        }
        columns |= {f"y.{s.name}": y[:, k] for k, s in enumerate(model.outputs) if s.dummy is None}
        rows = np.column_stack(list(columns.values()))
        lines = [",".join("" if np.isnan(v) else repr(v) for v in row) for row in rows.tolist()]
        text = "\n".join([",".join(columns), *lines]) + "\n"
        write_whole(folder / "recording.csv", text.encode())
        write_whole(folder / "problem.toml", self._problem_text().encode())

    def _problem_text(self) -> str:
        """The problem file with the saved recording in place of sources."""
        document = tomlkit.parse(self._live.problem.text)
        for name in LIVE_TABLES:
            document.pop(name, None)
        recording: dict[str, Any] = {"path": "recording.csv", "time": "time", "grid": self._dt}
        given = self._live.problem.recording
        model = self._live.model
        units = {s.name: s.unit for s in (*model.inputs, *model.outputs)}
        inputs, outputs = {}, {}
        for name, column in given.columns("inputs").items():
            gaps = getattr(column, "gaps", None)
            prefix = "u" if gaps is None else "y"
            inputs[name] = {"column": f"{prefix}.{name}", "unit": units.get(name, column.unit)}
            if gaps is not None:
                inputs[name]["gaps"] = gaps.model_dump(exclude_none=True)
        for name, column in given.columns("outputs").items():
            outputs[name] = {"column": f"y.{name}", "unit": units.get(name, column.unit)}
            for key in ("wrap", "resolution"):
                if (value := getattr(column, key, None)) is not None:
                    outputs[name][key] = value
        document["recording"] = {**recording, "inputs": inputs, "outputs": outputs}
        return tomlkit.dumps(document)

    def _estimate(self, saved: Saved) -> None:
        from backsight.problem import load, run_problem  # as heavy as all else at the start

        try:
            problem = load(saved.folder / "problem.toml")
            run_problem(problem, saved.folder, progress=lambda *_: None, force=False)
            saved.state = "done"
        except BacksightError as error:
            saved.state = str(error)
        except Exception as error:  # whatever is wrong, who waits for the report is told
            saved.state = f"{type(error).__name__}: {error}"

    def page(self, key: str) -> Path | None:
        """The report that belongs to a key."""
        for saved in self.saved:
            if secrets.compare_digest(saved.key.encode(), key.encode()):
                return saved.folder / PAGE
        return None
