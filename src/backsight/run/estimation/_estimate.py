"""Run an estimator over a recording."""

import dataclasses
import time
import warnings
from collections.abc import Callable, Sequence

import numpy as np
import psutil
import xarray as xr

from backsight.description import checked
from backsight.engine.execute import Engine, choose_engine, prepare
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import BacksightWarning, DataError, EstimationError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation._match import match, sensed_outputs
from backsight.run.estimation._prepared import Prepared, compile_once
from backsight.run.estimation.carrying import Store, carried
from backsight.run.estimation.results.outputs import ALL, Kept, Outputs, as_outputs
from backsight.run.estimation.results.result import Made, result_of
from backsight.run.estimation.results.values import Measured, looked_at
from backsight.schema import CULPRIT, FAILURES, STATUS_TEXT
from backsight.types import Array


@checked()
def estimate(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    outputs: Kept | None = None,
    engine: Engine | None = None,
    throw: bool = True,
    restart: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    """Estimate the states of a model from a recording.

    What is made of an estimator and a model before the first sample is kept: the next recording
    with the same period costs little more than its samples.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
        With parameters and disturbances to estimate among its states, see `augment`.
    recording : xarray.Dataset
        From `read`, `from_arrays` or `simulate`; ``NaN`` in an output is "not measured". With a
        variable ``sigma_factor`` single samples have a noise of their own.
    outputs : sequence of str or Outputs, optional
        Variables to keep beside ``x_hat`` and ``status``, see `backsight.large.Outputs`, which
        also thins the samples and stores single precision; by default all of them. What is left
        out is not computed either, as far as that is cheap.
    engine : {"native", "vm"}, optional
        Machine code, or CasADi's virtual machine; by default what finishes first, which is the
        virtual machine for less than a thousand samples. The results agree to rounding.
    throw : bool
        Raise at the end if the estimator failed; otherwise only the status says so.
    restart : bool
        After a sample whose estimate is not finite start anew from the prior. Only the status says
        so then; without it, everything from there on is worthless.
    progress : callable
        Told the number of samples done.

    Returns
    -------
    xarray.Dataset
        Variables of `backsight.schema.RESULT_VARIABLES` and what else the estimator puts out, with
        the recording's inputs and outputs, in physical units.

    Raises
    ------
    TuningError, ModelError
        If estimator and model do not fit, or the result has no such variable.
    EngineError
        If the engine is unknown or cannot compile the estimator.
    DataError
        If recording and model do not fit, or the result would not fit into memory.
    EstimationError
        If the estimate became non-finite; the exception carries the results.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 200, dt=0.05, sigma_y=1e-4, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-4, sigma_w=1e-6), bs.Prior(sigma_x0=1.0))
    >>> result = bs.estimate(kf, spring, recording, engine="vm")
    >>> print(f"{float(result.x_hat.sel(state='q')[-1]):.3f} m")  # u / k, at rest
    0.025 m
    """
    kept = as_outputs(outputs)
    task = ready(estimator, model, recording, outputs=kept, restart=restart)
    check_memory([task.numbers], task.samples)
    return carry_out(task, engine=engine, throw=throw and not restart, progress=progress)


@dataclasses.dataclass(frozen=True)
class Task:
    """An estimator compiled for a model, and data that fit: inputs, outputs and mask."""

    estimator: AbstractEstimator
    model: Model
    recording: xr.Dataset
    prepared: Prepared
    data: tuple[Array, Array, Array]
    outputs: Outputs

    @property
    def recursion(self) -> Recursion:
        """Step of the estimator, which puts out what is kept."""
        return self.prepared.recursion

    @property
    def samples(self) -> int:
        """Number of samples of the recording."""
        return len(self.data[0])

    @property
    def numbers(self) -> float:
        """Numbers that are needed for a sample of the result."""
        return numbers_kept(self.recursion, self.outputs)

    @property
    def made(self) -> Made:
        """What the result comes from."""
        u, y, mask = self.data
        return Made(
            self.estimator,
            self.model,
            self.recording,
            u=u,
            y=sensed_outputs(self.model, y, mask),
            integrator=self.prepared.integrator,
            coordinates=self.prepared.coordinates,
        )


def ready(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    outputs: Outputs = ALL,
    restart: bool = False,
) -> Task:
    """Check all but the memory that the result takes, see `estimate`."""
    data = match(model, recording, estimator=estimator)
    warn_of_useless_rule(estimator, model, data)
    check_window(estimator, len(data[0]))
    dt = float(recording.attrs["dt"])
    compiled = compile_once(estimator, model, dt, outputs=outputs, restart=restart)
    check_length(compiled.recursion, len(data[0]))
    return Task(estimator, model, recording, compiled, data, outputs)


def warn_of_useless_rule(
    estimator: AbstractEstimator, model: Model, data: tuple[Array, Array, Array]
) -> None:
    """Warn of outputs of which no value can be an outlier: the noise alone is allowed more."""
    if estimator.outliers is None:
        return
    _, y, mask = data
    sigma = np.sqrt(np.diag(estimator.assumed[0].measurement(model, singular=True)))
    for i, output in enumerate(model.outputs):
        seen = y[mask[:, i] > 0, i]
        if (
            output.dummy is None
            and seen.size > 1
            and np.ptp(seen) < estimator.outliers.threshold * sigma[i]
        ):
            warnings.warn(
                f"the rule for outliers of '{output.name}' can never act: all values lie within "
                f"{np.ptp(seen):.3g}, and a deviation of "
                f"{estimator.outliers.threshold * sigma[i]:.3g} is allowed; is sigma_y too large?",
                BacksightWarning,
                stacklevel=3,
            )


def carry_out(
    task: Task, *, engine: str | None, throw: bool, progress: Callable[[int], None]
) -> xr.Dataset:
    """Run what is ready, see `estimate`."""
    recursion, made = task.recursion, task.made
    chosen = choose_engine(engine, task.samples)
    prepare(recursion, chosen)
    measured = Measured.of(made.y)
    store = Store(task.outputs, task.samples)
    started = time.perf_counter()
    into = store.places(recursion, chosen)
    for block in carried(recursion, task.data, engine=chosen, progress=progress, into=into):
        part = measured[block.start : block.stop]
        store.add(dataclasses.replace(block, values=looked_at(block.values, part, task.model)))
    result = result_of(
        store.values,
        recursion.channels,
        made,
        outputs=task.outputs,
        engine=chosen,
        seconds=time.perf_counter() - started,
    )
    if throw and (store.values["status"] & int(FAILURES)).any():
        raise EstimationError(failure(result), result)
    return result


def failure(result: xr.Dataset) -> str:
    """Say at which sample a result failed first, why, and what to do; empty if it did not."""
    status = result["status"].values
    failed = np.flatnonzero(status & int(FAILURES))
    if not len(failed):
        return ""
    k = int(failed[0])
    causes = [text for bit, text in STATUS_TEXT.items() if bit & FAILURES & int(status[k])]
    moment = float(result["time"][k])
    cause = result.attrs.get(CULPRIT, causes[0])
    return f"{result.attrs['estimator']} failed at sample {k} (t = {moment:g} s): {cause}"


def check_window(estimator: AbstractEstimator, samples: int) -> None:
    """Raise `DataError` if the window is longer than the recording, before it is built."""
    if estimator.horizon >= samples > 1:
        raise DataError(
            f"the window of {estimator.horizon} sampling periods is longer than the recording of "
            f"{samples} samples: N = {samples - 1} takes in all of it"
        )


def check_length(recursion: Recursion, samples: int) -> None:
    """Raise `DataError` if the recording is shorter than one window."""
    if samples < recursion.least_samples:
        raise DataError(
            f"the recording has {samples} samples; a window of '{recursion.name}' alone takes "
            f"{recursion.least_samples}: shorten the window or record longer"
        )


def numbers_of(channels: Sequence[Channel], sizes: Sequence[int]) -> int:
    """Numbers that outputs of these sizes and the result of them take per sample."""
    return sum(
        size * (3 if channel.symmetric else 2)
        for channel, size in zip(channels, sizes, strict=True)
    )


def numbers_kept(recursion: Recursion, outputs: Outputs) -> float:
    """Numbers that the results of a recursion with what is `putting_out` take per sample."""
    sizes = zip(recursion.channels, recursion.output_sizes, strict=True)
    # Room for each symmetric matrix while it is unfolded.
    stored = sum(n * (2 if c.symmetric else 1) for c, n in sizes if outputs.keeps(c.name))
    return (sum(recursion.input_sizes) + stored) / outputs.every


def check_memory(numbers: Sequence[float], samples: int) -> None:
    """Raise `DataError` if results of so many numbers a sample would not fit into memory."""
    needed, available = 8 * sum(numbers) * samples, psutil.virtual_memory().available
    if needed > available:
        results = "result" if len(numbers) == 1 else f"{len(numbers)} results"
        raise DataError(
            f"the {results} of {samples} samples would take {needed / 1e9:.1f} GB of memory, but "
            f"only {available / 1e9:.1f} GB are free; process the recording in parts"
        )
