"""Run an estimator over many recordings at once."""

import time
from collections.abc import Callable, Sequence

import xarray as xr

from backsight.description import Count, checked
from backsight.errors import DataError, EstimationError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation._estimate import (
    Task,
    check_length,
    check_memory,
    failure,
)
from backsight.run.estimation._match import match
from backsight.run.estimation._prepared import Prepared, compile_once
from backsight.run.estimation.carrying import Block, Store, from_first_sample, run_on
from backsight.run.estimation.results.outputs import Kept, Outputs, as_outputs
from backsight.run.estimation.results.result import result_of
from backsight.run.estimation.results.values import Measured, looked_at, named
from backsight.types import Array


@checked()
def estimate_many(
    estimator: AbstractEstimator,
    model: Model,
    recordings: Sequence[xr.Dataset],
    *,
    outputs: Kept | None = None,
    threads: Count | None = None,
    throw: bool = True,
    restart: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> list[xr.Dataset]:
    """Estimate the states of a model from many recordings.

    The recordings advance together, several in the lanes of every vector instruction and these in
    threads; each result equals that of `estimate`. They may have different lengths and gaps; one
    that diverges does not touch the others.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    recordings : sequence of xarray.Dataset
        All with the same sampling period.
    outputs : sequence of str or Outputs, optional
        What to keep of every result, see `estimate`.
    threads : int, optional
        One per processor core by default.
    throw : bool
        Raise at the end if the estimator failed on a recording.
    restart : bool
        After a sample whose estimate is not finite start anew from the prior, see `estimate`.
    progress : callable
        Told the number of samples done, of all recordings together.

    Returns
    -------
    list of xarray.Dataset
        As of `estimate`. ``seconds`` is the recording's share of the whole time.

    Raises
    ------
    TuningError, ModelError, EngineError
        If estimator and model do not fit, or cannot be compiled.
    DataError
        If a recording does not fit the model, or the sampling periods differ; names the recording.
    EstimationError
        If the estimate of a recording became non-finite; carries the results of all.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> several = [
    ...     bs.simulate(spring, [[1.0]] * 9, dt=0.05, sigma_y=1e-3, seed=s) for s in range(3)
    ... ]
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-5), bs.Prior(sigma_x0=1.0))
    >>> [result.sizes["time"] for result in bs.estimate_many(kf, spring, several)]
    [9, 9, 9]
    """
    from backsight.engine.lanes import run_many  # brings the compiler along

    compiled, tasks = tasks_of(
        estimator, model, recordings, outputs=as_outputs(outputs), restart=restart
    )
    recursion = compiled.recursion
    samples = sum(task.samples for task in tasks)
    check_memory([sum(recursion.output_sizes) + tasks[0].numbers], samples)
    started = time.perf_counter()
    outcomes = run_many(
        recursion,
        [run_on(task.data, recursion.lag) for task in tasks],
        carries=[recursion.carry0] * len(tasks),
        threads=threads,
        progress=progress,
    )
    each = (time.perf_counter() - started) / samples
    results = [
        _result(task, found, seconds=each * task.samples)
        for task, (_, found) in zip(tasks, outcomes, strict=True)
    ]
    failed = [f"recording {k}: {failure(r)}" for k, r in enumerate(results) if failure(r)]
    if throw and failed and not restart:
        more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
        raise EstimationError(failed[0] + more, results)
    return results


def tasks_of(
    estimator: AbstractEstimator,
    model: Model,
    recordings: Sequence[xr.Dataset],
    *,
    outputs: Outputs,
    restart: bool,
) -> tuple[Prepared, list[Task]]:
    """Check recordings and compile the estimator for all of them; errors as of `estimate_many`."""
    if not recordings:
        raise DataError("there is no recording")
    periods = [float(r.attrs["dt"]) for r in recordings]
    for k, dt in enumerate(periods):
        if abs(dt / periods[0] - 1) > 1e-9:
            raise DataError(
                f"recording {k} has the sampling period {dt:g} s, recording 0 {periods[0]:g} s; "
                "resample one of them"
            )
    compiled = compile_once(estimator, model, periods[0], outputs=outputs, restart=restart)
    tasks = [
        Task(estimator, model, r, compiled, _matched(model, r, estimator, k), outputs)
        for k, r in enumerate(recordings)
    ]
    for task in tasks:
        check_length(compiled.recursion, task.samples)
    return compiled, tasks


def _matched(model: Model, recording: xr.Dataset, estimator: AbstractEstimator, k: int) -> tuple:
    try:
        return match(model, recording, estimator=estimator)
    except DataError as error:
        raise DataError(f"recording {k}: {error}") from None


def _result(task: Task, found: Sequence[Array], *, seconds: float) -> xr.Dataset:
    recursion, made = task.recursion, task.made
    values = named(from_first_sample(found, recursion.lag), recursion.channels)
    store = Store(task.outputs, task.samples)
    store.add(Block(0, task.samples, looked_at(values, Measured.of(made.y), task.model)))
    return result_of(
        store.values,
        recursion.channels,
        made,
        outputs=task.outputs,
        engine="native",
        seconds=seconds,
    )
