"""Smooth a recording: every estimate knows all of it."""

import dataclasses
import math
import time
from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.engine.execute import Engine, choose_engine, prepare, run_part, run_recursion
from backsight.engine.recursion import Channel, ForwardBackward, Recursion
from backsight.errors import EstimationError, TuningError
from backsight.estimators.base import AbstractEstimator, Spread
from backsight.models.model import Model
from backsight.run.estimation._estimate import (
    check_memory,
    failure,
    numbers_of,
    warn_of_useless_rule,
)
from backsight.run.estimation._match import match, with_turns
from backsight.run.estimation.results.result import as_result
from backsight.types import Array

LEAST_BLOCK = 1000
"""Samples of a block at least."""

KEPT = 2**24
"""Numbers that a block may take: it goes forward once only if the whole recording is one block."""


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
    """A smoother compiled for a model, and data that fit: inputs, outputs and mask."""

    estimator: AbstractEstimator
    model: Model
    recording: xr.Dataset
    passes: ForwardBackward
    data: tuple[Array, Array, Array]

    @property
    def samples(self) -> int:
        """Number of samples of the recording."""
        return len(self.data[0])

    @property
    def numbers(self) -> int:
        """Numbers that are needed for a sample of the result."""
        lengths, channels = _lengths(self.passes), _channels(self.passes)
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
    return SmoothingTask(estimator, model, recording, passes, data)


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
    passes, chosen = task.passes, choose_engine(engine, task.samples)
    for one in (passes.forward, passes.backward):
        prepare(one, chosen)
    started = time.perf_counter()
    values = _smoothed(passes, task.data, engine=chosen, progress=progress)
    seconds = time.perf_counter() - started
    result = smoothed_result(task, values, engine=chosen, seconds=seconds)
    if throw and (message := failure(result)):
        raise EstimationError(message, result)
    return result


def smoothed_result(
    task: SmoothingTask,
    values: Mapping[str, Array],
    *,
    engine: str,
    seconds: float,
    largest: Array | None = None,
) -> xr.Dataset:
    """What `smooth` returns; of a part of a recording with the size of its outputs in all of it."""
    result = as_result(
        list(values.values()),
        [_channels(task.passes)[name] for name in values],
        task.estimator,
        task.model,
        task.recording,
        engine=engine,
        seconds=seconds,
        largest=largest,
    )
    result["v"] = result["y"] - result["y_hat"]
    result["v"].attrs["long_name"] = "residual: measurement minus the output computed from x_hat"
    result.attrs["smoothed"] = 1
    return result


def _smoothed(
    passes: ForwardBackward,
    data: tuple[Array, Array, Array],
    *,
    engine: str,
    progress: Callable[[int], None],
) -> dict[str, Array]:
    carries = passes.forward.carry0, passes.backward.carry0
    return smoothed_between(
        passes, data, carries, u_after=data[0][-1], engine=engine, progress=progress
    )[0]


def smoothed_between(
    passes: ForwardBackward,
    data: tuple[Array, Array, Array],
    carries: tuple[Array, Array],
    *,
    u_after: Array,
    engine: str,
    progress: Callable[[int], None] = lambda _: None,
) -> tuple[dict[str, Array], Array]:
    """Forward once to keep the memory at the start of every block, then back block by block.

    Parameters
    ----------
    passes : ForwardBackward
    data : tuple of arrays
        Inputs, outputs and mask of samples that follow each other.
    carries : tuple of arrays
        Memory of the pass forward before the first of them, and of the pass back after the last.
    u_after : (nu,) array
        Inputs of the sample after the last one.
    engine : str
    progress : callable
        Told the number of samples done.

    Returns
    -------
    values : dict
        Results by name, one row per sample.
    carry : array
        Memory of the pass back before the first sample.
    """
    u, y, mask = data
    n, forward, backward = len(u), passes.forward, passes.backward
    size = max(LEAST_BLOCK, math.isqrt(n), KEPT // sum(forward.output_sizes))
    blocks = [slice(start, min(start + size, n)) for start in range(0, n, size)]
    starts, carry = [carries[0]], carries[1]
    for part in blocks[:-1]:
        rows = [a[part] for a in data]
        starts.append(run_part(forward, starts[-1], rows, engine=engine)[0])
        progress(part.stop // 2)
    values = {name: np.empty((n, length)) for name, length in _lengths(passes).items()}
    after = np.vstack([u[1:], u_after[None]])
    for part, start in zip(reversed(blocks), reversed(starts), strict=True):
        _, outputs = run_part(forward, start, [a[part] for a in data], engine=engine)
        handed, own = outputs[: passes.handed], outputs[passes.handed :]
        weighed = mask[part]
        if passes.weights is not None:
            weighed = weighed * outputs[passes.weights]
        rows = [*handed, u[part], after[part], y[part], weighed]
        carry, estimates = run_part(backward, carry, [a[::-1] for a in rows], engine=engine)
        found = {c.name: v[::-1] for c, v in zip(backward.channels, estimates, strict=True)}
        for channel, value in zip(forward.channels[passes.handed :], own, strict=True):
            known = found.get(channel.name)
            found[channel.name] = value if known is None else _either(value, known)
        for name, value in found.items():
            values[name][part] = value
        progress(n - part.start // 2 - part.start % 2)
    return values, carry


def _either(a: Array, b: Array) -> Array:
    """Status bits that are raised in one pass or the other; NaN is not a status."""
    bits = (np.nan_to_num(k).astype(np.int64) for k in (a, b))
    return np.bitwise_or(*bits).astype(float)


def _channels(passes: ForwardBackward) -> dict[str, Channel]:
    """Results by name: those of the pass back, then those of the pass forward."""
    both = (*passes.backward.channels, *passes.forward.channels[passes.handed :])
    return {channel.name: channel for channel in both}


def _lengths(passes: ForwardBackward) -> dict[str, int]:
    """How many numbers of a result there are at a sample."""
    back = zip(passes.backward.channels, passes.backward.output_sizes, strict=True)
    forward = zip(passes.forward.channels, passes.forward.output_sizes, strict=True)
    own = list(forward)[passes.handed :]
    return {channel.name: size for channel, size in (*back, *own)}
