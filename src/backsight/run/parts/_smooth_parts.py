"""Smooth a recording part by part: forward with a checkpoint before every part, then back."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from backsight.data.parts import RecordingParts
from backsight.description import checked
from backsight.engine.execute import Engine, prepare, run_part
from backsight.errors import DataError, TuningError
from backsight.estimators.base import AbstractEstimator, Spread
from backsight.models.model import Model
from backsight.run.estimation import (
    Kept,
    Outputs,
    SmoothingTask,
    as_outputs,
    match,
    ready_to_smooth,
    sensed_outputs,
    smoothed_between,
)
from backsight.run.parts._pace import Pace, check_unchanged, in_step, said_of, stamps_of
from backsight.run.parts._store import PartStore, opened_store
from backsight.types import Array

Memory = Mapping[str, np.ndarray]
"""What is kept of a run that may be interrupted."""


@checked()
def smooth_parts(
    estimator: AbstractEstimator,
    model: Model,
    parts: RecordingParts,
    out: str | os.PathLike[str],
    *,
    outputs: Kept | None = None,
    engine: Engine = "native",
    progress: Callable[[int, int], None] = lambda *_: None,
) -> xr.Dataset:
    """Smooth a recording that need not fit into memory, and write the results to a folder.

    The filter goes forward through all parts and leaves a checkpoint before each; then the parts
    are smoothed from the last one to the first. Every part is read twice and is all that is in
    memory, and the results are those of `smooth` on the whole recording. A run that was
    interrupted, in whatever way, goes on when it is started again, with the same results to the
    last bit; once the way back has begun, the recording must not grow any more.

    Parameters
    ----------
    estimator : AbstractEstimator
        One that `smooth` takes.
    model : Model
    parts : RecordingParts
        From `backsight.large.read_parts`.
    out : path
        Folder; missing ones are made. One with other results is refused.
    outputs : sequence of str or Outputs, optional
        What to keep, as of `estimate`, of every sample; all that `smooth` gives if not given.
    engine : {"native", "vm"}
    progress : callable
        Told the number of parts done, each of which counts twice, and of all of them.

    Returns
    -------
    xarray.Dataset
        ``samples``, ``status`` (all bits that were raised) and ``rms_residual`` of every output,
        physical units; it is also written. `backsight.large.read_store` reads the results.

    Raises
    ------
    TuningError
        If the estimator has no smoother, or the model needs the whole recording at once: angles
        that start anew after a turn.
    ModelError, EngineError, DataError, OutputError
        As of `backsight.large.estimate_parts`.

    Examples
    --------
    >>> import h5py, numpy as np
    >>> with h5py.File("long.h5", "w") as file:
    ...     file["u"], file["y"] = np.zeros(60), np.zeros(60)
    >>> parts = bs.large.read_parts(
    ...     "long.h5", inputs={"u": "u"}, outputs={"y": "y"}, dt=0.01, samples=20
    ... )
    >>> model = bs.sdof(k=40.0, b=0.8)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=0.1))
    >>> told = bs.large.smooth_parts(kf, model, parts, "smoothed", outputs=["x_std"])
    >>> int(told.samples), bs.large.read_store("smoothed").sizes["time"]
    (60, 60)
    """
    kept = as_outputs(outputs)
    if kept.every > 1:
        raise TuningError("the smoother keeps every sample; leave out every")
    if any(s.wrap is not None for s in model.outputs):
        raise TuningError(
            "angles that start anew after a turn need the whole recording: use smooth"
        )
    stamps = stamps_of(parts)
    first = parts.recording(0)
    pace = Pace.of(parts, float(first.attrs["dt"]))
    whole = kept.variables is None or {"P", "S"} & set(kept.variables)
    spread: Spread = "full" if whole else "std"
    task = ready_to_smooth(estimator, model, first, covariance=spread)
    for one in (task.passes.forward, task.passes.backward):
        prepare(one, engine)
    with opened_store(Path(out), said=said_of(estimator, model, parts, kept, "smoothed")) as store:
        known = store.memory()
        if known is None or not int(known["turned"]):
            known = _forward(store, known, task, parts, pace, stamps, engine, progress)
        check_unchanged(known["stamps"], stamps)
        if len(known["stamps"]) != parts.count:
            raise DataError("the recording has grown since it was smoothed; take another folder")
        known = _backward(store, known, task, parts, pace, kept, engine, progress)
        summary = xr.Dataset(
            {
                "samples": int(known["samples"]),
                "status": int(known["status"]),
                "rms_residual": ("output", _rms(known)),
            },
            coords={"output": [s.name for s in model.outputs]},
        )
        store.finish(summary)
    return summary


def _forward(
    store: PartStore,
    known: Memory | None,
    task: SmoothingTask,
    parts: RecordingParts,
    pace: Pace,
    stamps: np.ndarray,
    engine: Engine,
    progress: Callable[[int, int], None],
) -> Memory:
    """Run the filter through the parts that are left; the memory of a run that turns around."""
    forward, ny = task.passes.forward, task.model.ny
    state = known or {
        "carry": forward.carry0, "end": np.array(np.nan), "samples": np.array(0),
        "largest": np.zeros(ny), "stamps": np.empty((0, 3), "U1"),
    }  # fmt: skip
    check_unchanged(state["stamps"], stamps)
    for k in range(len(state["stamps"]), parts.count):
        progress(k, 2 * parts.count)
        store.write(_checkpoint(k), {name: state[name] for name in ("carry", "end")})
        recording, data = _read(task, parts, k, float(state["end"]), pace)
        carry, _ = run_part(forward, state["carry"], list(data), engine=engine)
        seen = np.abs(np.where(data[2] > 0, data[1], 0.0)).max(axis=0)
        state = {
            "carry": carry,
            "end": recording["time"].values[-1],
            "samples": state["samples"] + len(data[0]),
            "largest": np.maximum(state["largest"], seen),
            "stamps": stamps[: k + 1],
        }
        store.add(k, None, {**state, "turned": np.array(0)})
    return {
        **state,
        "turned": np.array(1),
        "left": np.array(parts.count),
        "carry": task.passes.backward.carry0,
        "u_after": np.full(task.model.nu, np.nan),
        "status": np.array(0),
        "squares": np.zeros(ny),
        "measured": np.zeros(ny),
    }


def _backward(
    store: PartStore,
    known: Memory,
    task: SmoothingTask,
    parts: RecordingParts,
    pace: Pace,
    kept: Outputs,
    engine: Engine,
    progress: Callable[[int, int], None],
) -> Memory:
    """Smooth the parts that are left, from the last one to the first."""
    state = dict(known)
    for k in reversed(range(int(state["left"]))):
        progress(2 * parts.count - 1 - k, 2 * parts.count)
        begin = store.read(_checkpoint(k))
        recording, data = _read(task, parts, k, float(begin["end"]), pace)
        u, y, mask = data
        after = u[-1] if k == parts.count - 1 else state["u_after"]
        result, carry = smoothed_between(
            task.over(recording, data),
            (begin["carry"], state["carry"]),
            u_after=after,
            engine=engine,
            largest=state["largest"],
        )
        for name in ("seconds", "us_per_sample", "engine"):
            del result.attrs[name]
        v = sensed_outputs(task.model, y, mask) - result["y_hat"].values
        state |= {
            "left": np.array(k),
            "carry": carry,
            "u_after": u[0],
            "status": state["status"] | np.bitwise_or.reduce(result["status"].values),
            "squares": state["squares"] + np.nansum(v**2, axis=0),
            "measured": state["measured"] + np.isfinite(v).sum(axis=0),
        }
        store.add(k, _thinned(result, kept), state)
    return state


def _rms(known: Memory) -> Array:
    """Root mean square of the residuals of every output, NaN of one that was never measured."""
    count = np.where(known["measured"] > 0, known["measured"], np.nan)
    return np.sqrt(known["squares"] / count)


def _checkpoint(k: int) -> str:
    return f"checkpoint-{k:06}.npz"


def _read(
    task: SmoothingTask, parts: RecordingParts, k: int, end: float, pace: Pace
) -> tuple[xr.Dataset, tuple[Array, Array, Array]]:
    recording = in_step(parts.recording(k), k, end, pace)
    return recording, match(task.model, recording, estimator=task.estimator)


def _thinned(result: xr.Dataset, kept: Outputs) -> xr.Dataset:
    """The variables that are kept, as they are stored."""
    names = [str(name) for name in result.data_vars if kept.keeps(str(name))]
    chosen = result[names]
    if kept.dtype == "float64":
        return chosen
    floats = [n for n in names if chosen[n].dtype == np.float64]
    return chosen.assign({n: chosen[n].astype(kept.dtype, keep_attrs=True) for n in floats})
