"""Estimate over a recording part by part: constant memory, and a run that stops goes on."""

import dataclasses
import functools
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from backsight.data.parts import RecordingParts
from backsight.description import checked
from backsight.engine.dense import UNROLL
from backsight.engine.execute import Engine, prepare, run_part
from backsight.engine.recursion import Recursion
from backsight.errors import DataError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation import (
    Block,
    Kept,
    Made,
    Measured,
    Prepared,
    Thinning,
    as_outputs,
    check_length,
    compile_once,
    looked_at,
    match,
    named,
    result_of,
    run_on,
    sensed_outputs,
)
from backsight.run.parts._pace import Pace, check_unchanged, in_step, said_of, stamps_of
from backsight.run.parts._state import PartsRun, State
from backsight.run.parts._store import PartStore, opened_store
from backsight.run.summaries import USED, Totals, largest, summed_up, totalling
from backsight.schema import recording as schema_recording
from backsight.types import Array


@checked()
def estimate_parts(
    estimator: AbstractEstimator,
    model: Model,
    parts: RecordingParts,
    out: str | os.PathLike[str],
    *,
    outputs: Kept | None = None,
    engine: Engine = "native",
    progress: Callable[[int, int], None] = lambda *_: None,
) -> xr.Dataset:
    """Estimate over a recording that need not fit into memory, and write the results to a folder.

    Parts are read one after the other and the memory of the estimator is handed on, so that the
    results are those of `estimate` on the whole recording. A part is written as a whole before the
    next one begins: a run that was interrupted, in whatever way, goes on from there when it is
    started again, with the same results to the last bit.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    parts : RecordingParts
        From `backsight.large.read_parts`.
    out : path
        Folder; missing ones are made. One with other results is refused.
    outputs : sequence of str or Outputs, optional
        What to keep, as of `estimate`; everything takes some 500 bytes per sample.
    engine : {"native", "vm"}
        As of `estimate`.
    progress : callable
        Told the number of parts done, and of all of them.

    Returns
    -------
    xarray.Dataset
        What sums up the whole recording, as a row of `estimate_summaries`; it is also written.
        `backsight.large.read_store` reads the results.

    Raises
    ------
    TuningError, ModelError, EngineError
        If estimator and model do not fit, or the model has more than a dozen outputs.
    DataError
        If a part cannot be read, does not fit the model, does not follow the one before, or has
        changed since it was estimated.
    OutputError
        If the folder cannot be written, holds something else, or another process writes to it.
        What was written stays: the run goes on when there is room again.

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
    >>> told = bs.large.estimate_parts(kf, model, parts, "store", outputs=["x_std"])
    >>> told.sizes["recording"]
    1
    """
    if model.ny > UNROLL:
        raise TuningError(
            f"recordings in parts are for models with up to {UNROLL} outputs, this one has "
            f"{model.ny}"
        )
    kept = as_outputs(outputs)
    stamps = stamps_of(parts)
    said = said_of(estimator, model, parts, kept)
    first = parts.recording(0)
    dt = float(first.attrs["dt"])
    match(model, first, estimator=estimator)
    compiled = compile_once(estimator, model, dt, outputs=kept, needed=USED)
    recursion, totals = _with_totals(compiled, model)
    prepare(recursion, engine)
    run = PartsRun(estimator, model, compiled, kept, Pace.of(parts, dt))
    with opened_store(Path(out), said=said) as store:
        kept_memory = store.memory()
        state = State.begin(recursion, run) if kept_memory is None else State.of(kept_memory)
        check_unchanged(state.stamps, stamps)
        if recursion.lag and state.parts and not len(state.time) and state.parts < len(stamps):
            raise DataError("the recording has grown since it was estimated; take another folder")
        for k in range(state.parts, parts.count):
            progress(k, parts.count)
            recording = first if k == 0 else parts.recording(k)
            state = _advance(
                store, state, run, in_step(recording, state.parts, state.end, run.pace),
                last=k == parts.count - 1, engine=engine, stamps=stamps[: k + 1],
            )  # fmt: skip
        progress(parts.count, parts.count)
        check_length(recursion, state.samples)
        found = {name: value[None] for name, value in totals.split(state.carry).items()}
        summary = summed_up(
            found,
            np.array([state.samples]),
            inputs=state.u_sum[None] / state.samples,
            compiled=compiled,
            estimator=estimator,
            model=model,
        )
        store.finish(summary)
    return summary


@functools.lru_cache(maxsize=16)
def _with_totals(compiled: Prepared, model: Model) -> tuple[Recursion, Totals]:
    return totalling(compiled.recursion, model, outputs=True)


def _advance(
    store: PartStore,
    state: State,
    run: PartsRun,
    recording: xr.Dataset,
    *,
    last: bool,
    engine: Engine,
    stamps: np.ndarray,
) -> State:
    """Estimate one part and keep its results and what is handed on."""
    recursion, totals = _with_totals(run.compiled, run.model)
    data = match(run.model, recording, estimator=run.estimator)
    u, y, mask = data
    carry = totals.enlarged(state.carry, largest(data))
    rows = run_on(data, recursion.lag) if last else list(data)
    carry, outputs = run_part(recursion, carry, rows, engine=engine)
    # What the outputs are about: samples that waited, and those of this part.
    time = np.concatenate([state.time, recording["time"].values])
    us = np.vstack([state.u, u])
    ys = np.vstack([state.y, sensed_outputs(run.model, y, mask)])
    early = max(recursion.lag - state.samples, 0)
    found = [output[early:] for output in outputs]
    count = len(found[0])
    start = state.samples - len(state.time)
    measured = Measured(ys[:count], totals.split(carry)["largest"])
    thinning = Thinning(run.outputs, state.missed)
    block = Block(
        start, start + count, looked_at(named(found, recursion.channels), measured, run.model)
    )
    first, kept = thinning.taken(block)
    number = len(kept["status"])
    if last and number:
        kept["status"][-1] |= thinning.missed
    chosen = slice(first * run.outputs.every - start, count, run.outputs.every)
    result = _result(kept, run, time[chosen], us[chosen], ys[chosen]) if number else None
    waiting = slice(count, None)
    after = State(
        parts=state.parts + 1,
        samples=state.samples + len(u),
        carry=carry,
        missed=thinning.missed,
        time=time[waiting],
        u=us[waiting],
        y=ys[waiting],
        u_sum=state.u_sum + u.sum(axis=0),
        end=float(time[-1]),
        stamps=stamps,
    )
    store.add(state.parts, result, after.kept())
    return after


def _result(
    values: Mapping[str, np.ndarray], run: PartsRun, time: Array, u: Array, y: Array
) -> xr.Dataset:
    """Results of the samples of a part that are kept."""
    model = run.model
    recording = schema_recording(
        time,
        u=u,
        y=y,
        inputs={s.name: s.unit for s in model.inputs},
        outputs={s.name: s.unit for s in model.outputs},
        dt=run.pace.dt,
    )
    made = Made(
        run.estimator,
        model,
        recording,
        u=u,
        y=y,
        integrator=run.compiled.integrator,
        coordinates=run.compiled.coordinates,
    )
    kept = dataclasses.replace(run.outputs, every=1)
    channels = run.compiled.recursion.channels
    result = result_of(values, channels, made, outputs=kept, engine="native", seconds=np.nan)
    for name in ("seconds", "us_per_sample", "engine"):
        del result.attrs[name]
    return result.assign_attrs(dt=run.pace.dt * run.outputs.every)
