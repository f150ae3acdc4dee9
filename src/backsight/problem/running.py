"""Run a problem and write what came out of it."""

import json
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import xarray as xr

from backsight.analysis.comparison import ALIGNMENT, summary
from backsight.estimators import ALL_ESTIMATORS
from backsight.estimators.dictionaries import ForceLine
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.models.sampling import check_sampling
from backsight.output import whole, writing
from backsight.problem.problem import Problem
from backsight.problem.reading.checking import at
from backsight.problem.reading.settings import part
from backsight.problem.reading.tables import SearchTable
from backsight.problem.recorded import recording_of
from backsight.problem.results_file import write_estimates
from backsight.problem.seeing import doubts
from backsight.report import report
from backsight.run.compare import AnyTask, Comparison, compared
from backsight.run.estimation import failure, match, ready, ready_to_smooth
from backsight.run.following import ready_to_follow
from backsight.run.searched import SearchTask, ready_to_search
from backsight.sparse import L1, AbstractSelection, Greedy, GreedyGroups, Reweighted

ESTIMATES, SUMMARY, PAGE = "estimates.nc", "summary.json", "report.html"


def run_problem(
    problem: Problem,
    out: str | os.PathLike[str],
    *,
    progress: Callable[[str, int, int], None],
    tell: Callable[[str], None] = lambda _: None,
    force: bool = False,
    outside: Collection[str] = (),
    env: Collection[str] = (),
    interrupted: Callable[[Sequence[str]], None] | None = None,
) -> Comparison:
    """Run all estimators of a problem over its recording and write the results.

    ``estimates.nc`` holds every result as a group with the name of its estimator,
    ``summary.json`` the final values and what they are worth, ``report.html`` the report. They
    appear together at the end; an estimator that diverges is reported and does not hold up the
    others.

    Parameters
    ----------
    problem : Problem
        From `load`.
    out : path
        Folder.
    progress : callable
        Told the estimator at work, the samples done, and the number of samples.
    tell : callable
        Told, before the first estimator starts, which states cannot be seen, a sentence at a time.
    force : bool
        Replace files of these names in the folder that are not from an earlier run.
    outside : collection of str
        Other files from which the recording may take measurements, see `backsight.read`.
    env : collection of str
        Environment variables that paths may use beside ``BACKSIGHT_DATA``.
    interrupted : callable, optional
        Told the estimators that an interrupt left out if others had finished, which are written.
        Without it nothing is written after an interrupt.

    Returns
    -------
    Comparison
        The results by name; failed ones say so in their status.

    Raises
    ------
    OutputError
        If the folder cannot be written, or holds files of these names that are not from an earlier
        run.
    ProblemError, DataError
        If the recording cannot be read or does not fit the model.
    """
    names = [ESTIMATES, SUMMARY, *([PAGE] if problem.report else [])]
    with whole(out, names=names, force=force) as folder:
        data = recording_of(problem, outside=outside, env=env)
        samples = data.sizes["time"]
        tasks = _ready(problem, data, progress)
        for sentence in doubts(problem, data):
            tell(sentence)
        results = compared(
            tasks,
            throw=False,
            progress=lambda name, done: progress(name, done, samples),
            interrupted=interrupted,
        )
        with writing(Path(out)):
            _write(folder, problem, results)
    return results


def _ready(
    problem: Problem, data: xr.Dataset, progress: Callable[[str, int, int], None]
) -> dict[str, AnyTask]:
    """Compile every estimator; what does not fit is found before the first one has run."""
    for estimator in problem.estimators.values():
        match(problem.model, data, estimator=estimator)
    with at("model"):
        check_sampling(problem.model, float(data.attrs["dt"]))
    tasks: dict[str, AnyTask] = {}
    for name, estimator in problem.estimators.items():
        with at(f"estimators.{name}"), ALL_ESTIMATORS.blamed(estimator.key):
            said = f"preparing {name}, {problem.model.nx} states"
            progress(said, 0, 1)
            tasks[name] = _task(problem, name, data)
            progress(said, 1, 1)
    return tasks


def _task(problem: Problem, name: str, data: xr.Dataset) -> AnyTask:
    """What the file wants of an estimator."""
    estimator, model = problem.estimators[name], problem.model
    if isinstance(estimator, AbstractForceEstimator):  # or the file is refused
        if name in problem.followed:
            return ready_to_follow(estimator, model, data, **problem.followed[name].settings)
        if name in problem.searched:
            return _search(estimator, model, data, problem.searched[name])
    prepared = ready_to_smooth if name in problem.smoothed else ready
    return prepared(estimator, model, data)


def _search(
    estimator: AbstractForceEstimator, model: Model, data: xr.Dataset, table: SearchTable
) -> SearchTask:
    """Look for forces in the whole recording."""
    kinds: list[type[AbstractSelection]] = [Greedy, GreedyGroups, Reweighted, L1]
    chosen = part(kinds, table.selection, where="search.selection") if table.selection else None
    line = None
    if table.line is not None:
        line = ForceLine(tuple(table.line.places), supports=tuple(table.line.supports))
    return ready_to_search(
        estimator, model, data, selection=chosen, locates=table.locate, line=line
    )


def _write(folder: Path, problem: Problem, results: Mapping[str, xr.Dataset]) -> None:
    write_estimates(
        folder / ESTIMATES,
        results,
        title=problem.title,
        problem=problem.text,
        covariance=problem.covariance,
    )
    text = json.dumps(_summary(problem, results), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")
    if problem.report:
        report(
            results,
            folder / PAGE,
            problem=problem.text,
            title=problem.title,
            reference=problem.reference,
        )


def _summary(problem: Problem, results: Mapping[str, xr.Dataset]) -> dict[str, object]:
    first = next(iter(results.values()))
    found = str(first.attrs.get(ALIGNMENT, "")).splitlines()
    return {
        "problem": {
            "title": problem.title,
            "file": problem.path.name,
            "recording": problem.recording.path,
            "model": problem.model.name,
            "samples": first.sizes["time"],
            "dt": first.attrs["dt"],
            "alignment": found,
        },
        "estimators": {
            name: summary(result, problem.reference) | {"failure": failure(result) or None}
            for name, result in results.items()
        },
    }
