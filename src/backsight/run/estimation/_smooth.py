"""Smooth a recording: every estimate knows all of it."""

import dataclasses
import time
from collections.abc import Callable, Iterable

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.engine.execute import Engine, choose_engine, prepare, run_recursion
from backsight.engine.recursion import Channel, ForwardBackward, Recursion
from backsight.errors import EstimationError, TuningError
from backsight.estimators.base import AbstractEstimator, Spread
from backsight.models.model import Model
from backsight.run.estimation._both_ways import (
    Samples,
    blocks_back,
    lengths_of,
    results_of,
    samples_of,
)
from backsight.run.estimation._estimate import (
    check_memory,
    failure,
    numbers_of,
    warn_of_useless_rule,
)
from backsight.run.estimation._match import match, sensed_outputs, with_turns
from backsight.run.estimation.carrying import Store
from backsight.run.estimation.results.outputs import ALL
from backsight.run.estimation.results.result import Made, coordinates, result_of
from backsight.run.estimation.results.values import Measured, deviation, looked_at, named
from backsight.types import Array


@checked()
def smooth(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    covariance: Spread = "full",
    engine: Engine | None = None,
    throw: bool = True,
    progress: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    """Estimate the states of a model at every sample from the whole recording.

    `estimate` uses at every sample the measurements up to there; here those after it are used,
    too (fixed-interval smoothing). Of a linear model with the right noise the result is the best
    there is; of a nonlinear one it is the smoother of the model along the filter's estimates. Of
    the results only one block is kept beside what is returned, so that the length of a recording
    is limited by its own size.

    Parameters
    ----------
    estimator : AbstractEstimator
        `KalmanFilter`, `EKF`, `IEKF`, `UKF` or `JointInput`.
    model, recording : Model, xarray.Dataset
        As in `estimate`.
    covariance : {"full", "std"}
        ``std`` leaves out ``P`` and ``S``, which take most of the memory of a long recording.
    engine, throw : optional
        As in `estimate`.
    progress : callable
        Told the number of samples done.

    Returns
    -------
    xarray.Dataset
        As of `estimate`: ``x_hat``, ``x_std``, ``P`` and ``y_hat`` are smoothed, ``v`` is the
        residual y - y_hat; the innovations ``e`` and their covariance ``S`` are the filter's, so
        that noise and model can be judged as ever. The attribute ``smoothed`` is 1.

    Raises
    ------
    TuningError
        If the estimator has no smoother; says which ones have.
    ModelError, EngineError, DataError, EstimationError
        As in `estimate`.

    Notes
    -----
    The two-filter smoother of Fraser and Potter (1969), doi:10.1109/TAC.1969.1099196, in
    square-root form: no covariance is inverted or subtracted from, so that process noise and prior
    may be singular. See `backsight.estimators.smoothing.two_filter` and the page on smoothing.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0))
    >>> before, after = (
    ...     find(kf, spring, recording, engine="vm") for find in (bs.estimate, bs.smooth)
    ... )
    >>> bool(after.P[0, 1, 1] < before.P[0, 1, 1])  # the later samples know the velocity
    True
    """
    task = ready_to_smooth(estimator, model, recording, covariance=covariance)
    check_memory([task.numbers], task.samples)
    return carry_out_smoothing(task, engine=engine, throw=throw, progress=progress)


@dataclasses.dataclass(frozen=True)
class SmoothingTask:
    """A smoother compiled for a model, and data that fit.

    Parameters
    ----------
    estimator, model, recording
    passes : ForwardBackward
    u, y : arrays
        Inputs (n, nu), and outputs (n, ny) where a sensor measured them, else NaN.
    data : callable
        What the passes take of some samples.
    """

    estimator: AbstractEstimator
    model: Model
    recording: xr.Dataset
    passes: ForwardBackward
    u: Array
    y: Array
    data: Samples

    def over(self, recording: xr.Dataset, data: tuple[Array, Array, Array]) -> "SmoothingTask":
        """The same smoother over another recording, of which data are what `match` gives."""
        u, y, mask = data
        measured = sensed_outputs(self.model, y, mask)
        return dataclasses.replace(
            self, recording=recording, u=u, y=measured, data=samples_of(self.model, data, measured)
        )

    @property
    def samples(self) -> int:
        """Number of samples of the recording."""
        return len(self.u)

    @property
    def numbers(self) -> int:
        """Numbers that are needed for a sample of the result."""
        lengths, channels = lengths_of(self.passes), results_of(self.passes)
        return numbers_of([channels[name] for name in lengths], list(lengths.values()))


def ready_to_smooth(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    covariance: Spread = "full",
) -> SmoothingTask:
    """Check all but the memory that the result takes, see `smooth`."""
    data = match(model, recording, estimator=estimator)
    _check_own(type(estimator))
    warn_of_useless_rule(estimator, model, data)
    dt = float(recording.attrs["dt"])
    passes = estimator.both_ways(model, dt, covariance=covariance)
    if any(s.wrap is not None for s in model.outputs):
        data = _unwrapped(estimator.compile(model, dt), model, data)
    u, y, mask = data
    measured = sensed_outputs(model, y, mask)
    rows = samples_of(model, data, measured)
    return SmoothingTask(estimator, model, recording, passes, u, measured, rows)


def _unwrapped(
    recursion: Recursion, model: Model, data: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """Data whose angles have the turns that the filter gives them: both passes need the same."""
    u, y, mask = data
    outputs = run_recursion(recursion, list(data), engine=choose_engine(None, len(u)))
    named = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    return u, np.where(mask > 0, with_turns(model, y, named["y_hat"]), 0.0), mask


def _check_own(kind: type[AbstractEstimator]) -> None:
    """Raise `TuningError` if a class changes the filter of its base, but not the smoother."""
    maker = {
        method: next(c for c in kind.__mro__ if method in vars(c))
        for method in ("build", "smoother")
    }
    base = maker["smoother"]
    if base is not AbstractEstimator and maker["build"] is not base:
        raise TuningError(
            f"{kind.__name__} is another filter than {base.__name__}, but has its smoother: give "
            "it a method 'smoother' of its own"
        )


def carry_out_smoothing(
    task: SmoothingTask, *, engine: str | None, throw: bool, progress: Callable[[int], None]
) -> xr.Dataset:
    """Run what is ready, see `smooth`."""
    chosen = choose_engine(engine, task.samples)
    for one in (task.passes.forward, task.passes.backward):
        prepare(one, chosen)
    carries = task.passes.forward.carry0, task.passes.backward.carry0
    result, _ = smoothed_between(
        task, carries, u_after=task.u[-1], engine=chosen, progress=progress
    )
    if throw and (message := failure(result)):
        raise EstimationError(message, result)
    return result


def smoothed_between(
    task: SmoothingTask,
    carries: tuple[Array, Array],
    *,
    u_after: Array,
    engine: str,
    largest: Array | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> tuple[xr.Dataset, Array]:
    """Forward once to keep the memory at the start of every block, then back block by block.

    Parameters
    ----------
    task : SmoothingTask
    carries : tuple of arrays
        Memory of the pass forward before the first sample, and of the pass back after the last.
    u_after : (nu,) array
        Inputs of the sample after the last one.
    engine : str
    largest : (ny,) array, optional
        Size of every output in the whole recording, if this is a part of one.
    progress : callable
        Told the number of samples done.

    Returns
    -------
    result : Dataset
        What `smooth` returns.
    carry : array
        Memory of the pass back before the first sample.
    """
    channels, model = list(results_of(task.passes).values()), task.model
    told = [*channels, Channel("x_std", ("state",))] if _has_covariance(channels) else channels
    made = Made(
        task.estimator,
        model,
        task.recording,
        u=task.u,
        y=task.y,
        integrator=task.estimator.chosen(model, float(task.recording.attrs["dt"])),
        coordinates=coordinates(model, told),
    )
    measured = Measured.of(made.y) if largest is None else Measured(made.y, largest)
    store = Store(ALL, task.samples)
    store.values["y"] = made.y
    started = time.perf_counter()
    carry = carries[1]
    n = task.samples
    ways = blocks_back(
        task.passes, task.data, carries, u_after, samples=n, engine=engine, progress=progress
    )
    for block, left in ways:
        carry = left
        values = named([block.values[c.name] for c in channels], channels)
        if _has_covariance(channels):
            values["x_std"] = deviation(values["P"])
        looked = looked_at(values, measured[block.start : block.stop], model)
        store.add(dataclasses.replace(block, values=looked))
    seconds = time.perf_counter() - started
    result = result_of(store.values, told, made, outputs=ALL, engine=engine, seconds=seconds)
    result["v"] = result["y"] - result["y_hat"]
    result["v"].attrs["long_name"] = "residual: measurement minus the output computed from x_hat"
    result.attrs["smoothed"] = 1
    return result, carry


def _has_covariance(channels: Iterable[Channel]) -> bool:
    return "P" in {channel.name for channel in channels}
