"""Tune a problem and write it anew, with the values that were found in their places."""

import dataclasses
import os
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import xarray as xr

from backsight.errors import OutputError, ProblemError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.output import write_whole
from backsight.problem._writing import written
from backsight.problem.problem import Problem
from backsight.problem.reading.checking import at
from backsight.problem.reading.settings import option_of, part
from backsight.problem.reading.tables import FreeTable
from backsight.problem.recorded import recording_of
from backsight.report import report
from backsight.run.estimation import estimate
from backsight.tune import (
    Choice,
    Free,
    Likelihood,
    MultiStep,
    Prediction,
    Simulation,
    Tuned,
    Whiteness,
    fit,
)

OF_NOISE = ("sigma_y", "sigma_w", "sigma_x0", "x0", "R", "Q", "Qc", "P0", "delay")
"""Values that a filter with the same noise and prior can find in place of another method."""


@dataclasses.dataclass(frozen=True)
class TunedProblem:
    """What was found, by whom, and the file with it.

    Parameters
    ----------
    tuned : Tuned
    by : str
        The estimator in words.
    text : str
        The new problem file.
    results : dict
        Results of the first recording before and after, by name.
    """

    tuned: Tuned
    by: str
    text: str
    results: Mapping[str, xr.Dataset]


def tune_problem(
    problem: Problem,
    out: str | os.PathLike[str],
    *,
    estimator: str | None = None,
    page: str | os.PathLike[str] | None = None,
    force: bool = False,
    outside: Collection[str] = (),
    env: Collection[str] = (),
    progress: Callable[[float], None] = lambda _: None,
) -> TunedProblem:
    """Tune an estimator of a problem and write the problem with what was found.

    Comments and order of the file stay. If the estimator is not one whose process noise can be
    varied at once, and only noise, prior and parameters of the model are free, a Kalman filter with
    the same noise and prior is tuned in its place.

    Parameters
    ----------
    problem : Problem
    out : path
        File to write.
    estimator : str, optional
        Its name in the file; ``tune.estimator``, or the first of the Kalman filters, or the first.
    page : path, optional
        Page with the results of the first recording before and after.
    force : bool
        Replace `out` and `page` if they are there.
    outside, env : collection of str
        As for `run_problem`.
    progress : callable
        Told the share of the passes done.

    Raises
    ------
    OutputError
        If a file is there or cannot be written.
    ProblemError, TuningError, ModelError, DataError
        If something in the problem or the recordings is at fault; nothing is written then.
    """
    places = [Path(p) for p in (out, page) if p is not None]
    for place in places:
        if place.exists() and not force:
            raise OutputError(f"there is a file '{place}'; choose another name, or --force")
    name = estimator or problem.tune.estimator or _first(problem)
    if name not in problem.estimators:
        raise ProblemError(f"estimators: there is no '{name}'")
    problem.check_by_sample([name], "backsight tune")
    method = problem.estimators[name]
    free = [_free(entry, method) for entry in problem.tune.free] or _usual(method)
    chosen, by = _by(method, problem, free)
    criterion = None
    if problem.tune.criterion:
        kinds = [Likelihood, Prediction, MultiStep, Simulation, Whiteness]
        criterion = part(kinds, problem.tune.criterion, where="tune.criterion")
    if problem.tune.recordings and problem.recording.sources:
        raise ProblemError(
            "tune.recordings: a recording of several files (recording.sources) cannot have others "
            "beside it; tune from Python with the recordings that you have read"
        )
    recordings = [recording_of(problem, outside=outside, env=env)]
    for path in problem.tune.recordings:
        table = problem.recording.model_copy(update={"path": path})
        other = dataclasses.replace(problem, recording=table)
        recordings.append(recording_of(other, outside=outside, env=env))
    with at("tune"):
        tuned = fit(
            chosen,
            problem.model,
            recordings,
            free=free,
            criterion=criterion,
            progress=progress,
        )
    text = written(problem, name, tuned, folder=Path(out).absolute().parent)
    results = {
        "before": estimate(chosen, problem.model, recordings[0], throw=False),
        "tuned": estimate(tuned.estimators[0], tuned.models[0], recordings[0], throw=False),
    }
    write_whole(out, text.encode("utf-8"), replace=force)
    if page is not None:
        report(
            results,
            page,
            problem=text,
            title=f"{problem.title}: before and after tuning",
            profiles=tuned.profiles,
        )
    return TunedProblem(tuned, by, text, results)


def _first(problem: Problem) -> str:
    able = [name for name, e in problem.estimators.items() if _is_filter(e)]
    return able[0] if able else next(iter(problem.estimators))


def _is_filter(estimator: AbstractEstimator) -> bool:
    """Whether its innovations say what its noise is: it looks at every measurement once."""
    return bool(estimator.varies_noise) and not estimator.horizon


def _free(entry: FreeTable, method: AbstractEstimator) -> Free | Choice:
    where = f"tune.free: {entry.name}"
    options = [option_of(method, entry.name, o, where=where) for o in entry.options]
    with at(where):
        if options:
            return Choice(entry.name, tuple(options))
        per = tuple(entry.per) if isinstance(entry.per, list) else entry.per
        given = entry.structure
        return Free(
            entry.name,
            spread=entry.spread,
            sigma=entry.sigma,
            per=per,
            structure=tuple(given) if isinstance(given, list) else given,
        )


def _usual(estimator: AbstractEstimator) -> list[Free | Choice]:
    """All noise, if the file does not say what is free; of sparse forces the weight.

    Without forces a filter would take what they do for noise.
    """
    if isinstance(estimator, AbstractForceEstimator):
        return [Free("lam")]
    noise = estimator.assumed[0]
    names = ["sigma_y" if noise.R is None else "R"]
    names += [n for n in ("sigma_w", "Q", "Qc") if getattr(noise, n) is not None]
    return [Free(n) for n in names]


def _by(
    estimator: AbstractEstimator, problem: Problem, free: list[Free | Choice]
) -> tuple[AbstractEstimator, str]:
    """Who is tuned."""
    parameters = {s.name for s in problem.model.parameters}
    groups = {*OF_NOISE, *(g.states[0] for g in problem.model.driven)}
    shared = all(
        isinstance(f, Free) and (f.name.partition(".")[0] in groups or f.name in parameters)
        for f in free
    )
    if _is_filter(estimator) or not shared:
        return estimator, estimator.title
    with at("tune"):
        stand_in = yardstick(estimator, problem.model)
    blind = isinstance(estimator, AbstractForceEstimator)
    without = ", which takes what forces do for noise" if blind else ""
    return stand_in, f"{stand_in.title}, with noise and prior of {estimator.title}{without}"
