"""Estimate over many recordings and keep a row of each."""

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from backsight.description import Count, checked
from backsight.discrete.modes import modes_at
from backsight.discrete.steps import complaint
from backsight.engine.dense import UNROLL
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation import ALL, Prepared, run_on, tasks_of
from backsight.run.summaries._totals import BITS, Totals, largest, totalling
from backsight.schema import ROLE, Status
from backsight.types import Array


@checked()
def estimate_summaries(
    estimator: AbstractEstimator,
    model: Model,
    recordings: Sequence[xr.Dataset],
    *,
    threads: Count | None = None,
    restart: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    """Estimate over many recordings, and keep of each what sums it up.

    The numbers are those that `estimate_many` and the analysis of its results would give, but they
    are accumulated in the memory of the recursion: no result is ever stored, which makes it several
    times as fast and independent of the length of the recordings.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    recordings : sequence of xarray.Dataset
        All with the same sampling period.
    threads : int, optional
        One per processor core by default.
    restart : bool
        After a sample whose estimate is not finite start anew from the prior, see `estimate`.
    progress : callable
        Told the number of samples done, of all recordings together.

    Returns
    -------
    xarray.Dataset
        Of every ``recording``: ``x_hat, x_std (recording, state)`` after the last sample and the
        mean ``x_mean`` of those that are finite; ``mean_nis`` with its expectation
        ``nis_expected``, ``mean_log_likelihood``, ``rms_innovation (recording, output)``,
        ``measured``, the number of values that were taken in; ``samples``, ``status`` (all bits
        that were raised), ``status_count (recording, flag)``, and ``failed_at``, the first sample
        whose estimate is worthless, or -1.

    Raises
    ------
    TuningError, ModelError, EngineError
        If estimator and model do not fit, or cannot be compiled; if the model has more than a dozen
        outputs.
    DataError
        If a recording does not fit the model, or the sampling periods differ; names the recording.

    See Also
    --------
    estimate_many : The results themselves.

    Examples
    --------
    >>> import numpy as np
    >>> model = bs.sdof(k=40.0, b=0.8)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=0.1))
    >>> rest = np.zeros((50, 1))
    >>> recordings = [bs.simulate(model, rest, dt=0.01, sigma_y=1e-3, seed=s) for s in range(2)]
    >>> bs.large.estimate_summaries(kf, model, recordings).sizes["recording"]
    2
    """
    from backsight.engine.lanes import run_many  # brings the compiler along

    if model.ny > UNROLL:
        raise TuningError(
            f"summaries are for models with up to {UNROLL} outputs, this one has {model.ny}: take "
            "estimate_many with outputs=['e', 'S', 'y']"
        )
    compiled, tasks = tasks_of(estimator, model, recordings, outputs=ALL, restart=restart)
    recursion, totals = _totalling(compiled, model)
    data = [run_on(task.data, recursion.lag) for task in tasks]
    outcomes = run_many(
        recursion,
        data,
        carries=[totals.begin(compiled.recursion.carry0, largest(task.data)) for task in tasks],
        threads=threads,
        progress=progress,
    )
    parts = [totals.split(memory) for memory, _ in outcomes]
    found = {name: np.stack([p[name] for p in parts]) for name in totals.sizes}
    return summed_up(
        found,
        np.array([task.samples for task in tasks]),
        inputs=np.stack([task.data[0].mean(axis=0) for task in tasks]),
        compiled=compiled,
        estimator=estimator,
        model=model,
    )


@functools.lru_cache(maxsize=16)
def _totalling(compiled: Prepared, model: Model) -> tuple[Recursion, Totals]:
    """Made once for a compiled estimator, like the estimator itself."""
    return totalling(compiled.recursion, model)


def summed_up(
    found: Mapping[str, Array],
    samples: Array,
    *,
    inputs: Array,
    compiled: Prepared,
    estimator: AbstractEstimator,
    model: Model,
) -> xr.Dataset:
    """Totals of recordings as what they say.

    Parameters
    ----------
    found : dict of (recordings, k) arrays
        The parts of `Totals`.
    samples : (recordings,) array
        Their lengths.
    inputs : (recordings, nu) array
        Their mean inputs.
    compiled, estimator, model
        What was run.
    """
    counts = {name: found[name][:, 0] for name in ("with_nis", "channels", "nis", "log_likelihood")}
    with np.errstate(divide="ignore", invalid="ignore"):
        per_sample = {name: value / counts["with_nis"] for name, value in counts.items()}
        rms = np.sqrt(found["squares"] / found["measured"])
        mean = found["x_sum"] / found["finite"]
    bits = found["bits"].astype(np.int64)
    states = np.stack([mean, found["x_last"]], axis=1)
    coarse = _coarse(compiled, model, states, inputs)
    bits[:, BITS.index(Status.COARSE_STEP)] = np.where(
        coarse, samples, bits[:, BITS.index(Status.COARSE_STEP)]
    )
    status = ((bits > 0) * np.array([int(bit) for bit in BITS])).sum(axis=1).astype(np.int32)
    of_state, of_output = ("recording", "state"), ("recording", "output")
    flags = [(bit.name or "").lower() for bit in BITS]
    rows = xr.Dataset(
        {
            "x_hat": (of_state, found["x_last"]),
            "x_std": (of_state, found["std_last"]),
            "x_mean": (of_state, mean),
            "mean_nis": ("recording", per_sample["nis"]),
            "nis_expected": ("recording", per_sample["channels"]),
            "mean_log_likelihood": ("recording", per_sample["log_likelihood"]),
            "rms_innovation": (of_output, rms),
            "measured": (of_output, found["measured"].astype(np.int64)),
            "samples": ("recording", samples),
            "status": ("recording", status),
            "status_count": (("recording", "flag"), bits),
            "failed_at": ("recording", found["failed_at"][:, 0].astype(np.int64)),
        },
        coords={
            "recording": np.arange(len(samples)),
            "flag": flags,
            **{
                name: compiled.coordinates[name]
                for name in ("state", "output", "state_unit", "output_unit", ROLE)
            },
        },
    )
    return rows.assign_attrs(estimator=estimator.key, model=model.name, dt=compiled.recursion.dt)


def _coarse(compiled: Prepared, model: Model, x: Array, inputs: Array) -> Array:
    """Whether the integration step is too coarse at these states (recordings, k, nx)."""
    chosen, dt = compiled.integrator, compiled.recursion.dt
    none = np.zeros(len(x), bool)
    if chosen is None:
        return none

    def complains(which: slice) -> bool:
        states, u = x[which], np.repeat(inputs[which], x.shape[1], axis=0)
        return bool(complaint(chosen, lambda: modes_at(model, np.vstack([*states]), u), dt=dt))

    if not complains(slice(None)):
        return none
    return np.array([complains(slice(k, k + 1)) for k in range(len(x))])
