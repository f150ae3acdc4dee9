"""A fleet: many recordings times many settings of one problem."""

import dataclasses
import glob
import hashlib
import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from backsight.description import Printed, digest
from backsight.errors import BacksightError, ProblemError
from backsight.fleet._changes import Changes, axes_of, changed, settings_of
from backsight.fleet._recordings import FleetRecording, listed_in
from backsight.fleet._tables import FleetTable, RecordingsTable
from backsight.problem.problem import Problem
from backsight.problem.reading.checking import at, validated
from backsight.problem.reading.loading import problem_of, text_of, tree_of
from backsight.problem.recorded import expanded
from backsight.run.estimation import Outputs


@dataclasses.dataclass(frozen=True)
class Fleet(Printed):
    """Many recordings times many settings, checked; see `load_fleet`.

    Parameters
    ----------
    title : str
        Heading of tables and page.
    path : Path
        The fleet file.
    problem : Problem
        That of one recording.
    recordings : tuple of FleetRecording
        The recordings with what is known of each.
    axes : dict
        Key of the problem file to the values that it takes.
    keep : Outputs, optional
        What is written of every result beside its row.
    """

    title: str
    path: Path
    problem: Problem
    recordings: tuple[FleetRecording, ...]
    axes: Mapping[str, tuple[Any, ...]]
    keep: Outputs | None

    @property
    def settings(self) -> list[Changes]:
        """Every combination of the values of the sweep."""
        return settings_of(self.axes)

    def identity(self) -> str:
        """Digest of what makes two fleets the same: all but which recordings and which values.

        These may become more; a store then has the rest already.
        """
        problem = self.problem
        recording = problem.recording.model_dump(exclude={"path"})
        smoothed, keys = sorted(problem.smoothed), sorted(self.axes)
        try:
            return digest(
                problem.model, dict(problem.estimators), smoothed, recording, keys, self.keep
            )
        except TypeError as error:
            raise ProblemError(f"an estimator cannot be told from others: {error}") from None


def item_of(recording: FleetRecording, setting: Changes) -> str:
    """Name of a recording with a setting: the same in every process, and after every restart."""
    said = json.dumps([recording.name, recording.changes, setting], default=str)
    return hashlib.sha256(said.encode()).hexdigest()[:20]


def load_fleet(path: str | os.PathLike[str], *, env: Collection[str] = ()) -> Fleet:
    r"""Read a fleet file and check everything in it that needs no recording.

    Parameters
    ----------
    path : path
        A TOML file, see the page on fleets.
    env : collection of str
        Environment variables that paths may use beside ``BACKSIGHT_DATA``.

    Raises
    ------
    ProblemError
        If the fleet or its problem cannot be read, a key is missing, unknown or of the wrong kind,
        a value of the sweep does not fit the problem, or there is no recording.

    Examples
    --------
    >>> from pathlib import Path
    >>> spring = '''
    ... recording = { path = "-", time = "t", inputs.u = "F", outputs.y = "q" }
    ... model = { kind = "sdof", k = 40.0, b = 1.0 }
    ... noise.sigma_y.y = 1e-3
    ... estimators.KF.kind = "kf"
    ... prior.sigma_x0 = { q = 0.1, v = 0.1 }
    ... '''
    >>> _ = Path("spring.toml").write_text(spring)
    >>> _ = Path("run_1.csv").write_text("t,F,q\n0,1,0\n1,1,1\n")
    >>> fleet = '''
    ... problem = "spring.toml"
    ... recordings.files = "run_*.csv"
    ... sweep.model.k = { from = 30.0, to = 50.0, step = 10.0 }
    ... '''
    >>> _ = Path("fleet.toml").write_text(fleet)
    >>> len(bs.fleet.load_fleet("fleet.toml").settings)
    3
    """
    file = Path(path)
    table = validated(FleetTable, tree_of(text_of(file), file))
    folder = file.absolute().parent
    of_one = folder / expanded(table.problem, "problem", env=env)
    with at("problem"):
        text = text_of(of_one)
    axes = axes_of(table.sweep)
    recordings = _recordings(table.recordings, folder, env)
    found = Fleet(
        title=table.title or file.stem,
        path=file,
        problem=problem_of(tree_of(text, of_one), text, of_one),
        recordings=recordings,
        axes=axes,
        keep=None if table.keep is None else _kept(table),
    )
    found.problem.check_by_sample(found.problem.estimators, "a fleet")
    _check_values(found)
    return found


def _kept(table: FleetTable) -> Outputs:
    given = table.keep
    assert given is not None
    with at("keep"):
        chosen = None if given.variables is None else tuple(given.variables)
        return Outputs(chosen, every=given.every, dtype=given.dtype)


def _recordings(
    table: RecordingsTable, folder: Path, env: Collection[str]
) -> tuple[FleetRecording, ...]:
    if bool(table.files) == (table.table is not None):
        raise ProblemError("recordings: give files (a pattern) or a table")
    if table.table is not None:
        file = folder / expanded(table.table, "recordings.table", env=env)
        found = listed_in(file, table, folder, env)
    else:
        patterns = [table.files] if isinstance(table.files, str) else table.files
        paths: dict[str, None] = {}
        for pattern in patterns:
            full = str(folder / expanded(pattern, "recordings.files", env=env))
            paths |= dict.fromkeys(sorted(p for p in glob.glob(full, recursive=True)))
            if not paths:
                raise ProblemError(f"recordings.files: there is no file '{pattern}'")
        found = [FleetRecording.at(Path(p), folder) for p in paths if Path(p).is_file()]
    if not found:
        raise ProblemError("recordings: there is none")
    return tuple(found)


def _check_values(fleet: Fleet) -> None:
    """Load the problem with every value of the sweep, and with those of the first recording."""
    tree = tree_of(fleet.problem.text, fleet.problem.path)
    tried: list[Changes] = [((key, v),) for key, values in fleet.axes.items() for v in values]
    if len(tried) > MOST_TRIED:
        tried = [((key, v),) for key, vs in fleet.axes.items() for v in (vs[0], vs[-1])]
    settings_of(fleet.axes)
    for changes in [*tried, fleet.recordings[0].changes]:
        if not changes:
            continue
        try:
            problem_of(changed(tree, changes), fleet.problem.text, fleet.problem.path)
        except BacksightError as error:
            said = ", ".join(f"{key} = {value}" for key, value in changes)
            raise ProblemError(f"with {said}: {error}") from None


MOST_TRIED = 200
"""Values of a sweep that are tried before it begins; of more, the ends of each."""
