"""Run an estimator over many recordings at once."""

import os
import time
from collections.abc import Callable, Sequence

import xarray as xr

from backsight.description import Count, checked
from backsight.errors import DataError, EstimationError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation._estimate import (
    check_length,
    check_memory,
    failure,
    numbers_of,
)
from backsight.run.estimation._match import match
from backsight.run.estimation.lag import from_first_sample, run_on
from backsight.run.estimation.result import as_result


@checked()
def estimate_many(
    estimator: AbstractEstimator,
    model: Model,
    recordings: Sequence[xr.Dataset],
    *,
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

    if not recordings:
        raise DataError("there is no recording")
    periods = [float(r.attrs["dt"]) for r in recordings]
    for k, dt in enumerate(periods):
        if abs(dt / periods[0] - 1) > 1e-9:
            raise DataError(
                f"recording {k} has the sampling period {dt:g} s, recording 0 {periods[0]:g} s; "
                "resample one of them"
            )
    data = [_matched(model, r, estimator, k) for k, r in enumerate(recordings)]
    samples = sum(len(rows[0]) for rows in data)
    recursion = estimator.compile(model, periods[0])
    for rows in data:
        check_length(recursion, len(rows[0]))
    check_memory([numbers_of(recursion.channels, recursion.output_sizes)], samples)
    if restart:
        recursion = recursion.restarting()
    started = time.perf_counter()
    outcomes = run_many(
        recursion,
        [run_on(rows, recursion.lag) for rows in data],
        carries=[recursion.carry0] * len(data),
        threads=threads or os.cpu_count(),
        progress=progress,
    )
    seconds = time.perf_counter() - started
    results = [
        as_result(
            from_first_sample(outputs, recursion.lag),
            recursion.channels,
            estimator,
            model,
            recording,
            engine="native",
            seconds=seconds * len(rows[0]) / samples,
        )
        for (_, outputs), recording, rows in zip(outcomes, recordings, data, strict=True)
    ]
    failed = [f"recording {k}: {failure(r)}" for k, r in enumerate(results) if failure(r)]
    if throw and failed and not restart:
        more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
        raise EstimationError(failed[0] + more, results)
    return results


def _matched(model: Model, recording: xr.Dataset, estimator: AbstractEstimator, k: int) -> tuple:
    try:
        return match(model, recording, estimator=estimator)
    except DataError as error:
        raise DataError(f"recording {k}: {error}") from None
