"""Run an estimator over a recording."""

import time
from collections.abc import Callable

import numpy as np
import psutil
import xarray as xr

from backsight.engine.execute import choose, execute, prepare
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import DataError, EstimationError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.match import match
from backsight.schema import FAILURES, RESULT_VARIABLES, SCHEMA_VERSION, STATUS_TEXT, Status


def estimate(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    engine: str | None = None,
    throw: bool = True,
    progress: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    """Estimate the states of a model from a recording.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
        With parameters and disturbances to estimate among its states, see `augment`.
    recording : xarray.Dataset
        From `read`, `from_arrays` or `simulate`; ``NaN`` in an output is "not measured".
    engine : {"native", "vm"}, optional
        Machine code, or CasADi's virtual machine; by default what finishes first, which is the
        virtual machine for less than a thousand samples. The results agree to rounding.
    throw : bool
        Raise at the end if the estimator failed; otherwise only the status says so.
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
        If estimator and model do not fit.
    EngineError
        If the engine is unknown or cannot compile the estimator.
    DataError
        If recording and model do not fit, or the result would not fit into memory.
    EstimationError
        If the estimate became non-finite; the exception carries the results.
    """
    u, y, mask = match(model, recording)
    recursion = estimator.compile(model, float(recording.attrs["dt"]))
    _check_memory(recursion, len(u))
    chosen = choose(engine, len(u))
    prepare(recursion, chosen)
    started = time.perf_counter()
    outputs = execute(recursion, [u, y, mask], engine=chosen, progress=progress)
    seconds = time.perf_counter() - started
    values = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    result = _dataset(values, recursion.channels, model, recording)
    result.attrs |= {
        "estimator": estimator.key,
        "model": model.name,
        "engine": chosen,
        "dt": recursion.dt,
        "seconds": seconds,
        "us_per_sample": seconds / len(u) * 1e6,
        "schema": SCHEMA_VERSION,
    }
    failed = np.flatnonzero(result["status"].values & int(FAILURES))
    if throw and len(failed):
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
    return f"{result.attrs['estimator']} failed at sample {k} (t = {moment:g} s): {causes[0]}"


def _dataset(
    values: dict[str, np.ndarray],
    channels: tuple[Channel, ...],
    model: Model,
    recording: xr.Dataset,
) -> xr.Dataset:
    names = [s.name for s in model.states]
    outputs = [s.name for s in model.outputs]
    inputs = [s.name for s in model.inputs]
    measured = recording["y"].sel(output=outputs)
    values["e"] = np.where(np.isfinite(measured.values), values["e"], np.nan)
    finite = np.isfinite(values["x_hat"]).all(axis=1)
    raised = np.nan_to_num(values["status"]).astype(np.int32)
    values["status"] = np.where(finite, raised, raised | int(Status.NOT_FINITE)).astype(np.int32)
    dims = {c.name: ("time", *c.dims) for c in channels}
    variance = np.einsum("kii->ki", values["P"])
    values["x_std"], dims["x_std"] = np.sqrt(np.maximum(variance, 0.0)), ("time", "state")
    flags = [bit for bit in Status if bit]
    result = xr.Dataset(
        {n: (dims[n], v, {"long_name": _long_name(n)}) for n, v in values.items()},
        coords={
            "time": recording["time"],
            "state": names,
            "state_": names,
            "output": outputs,
            "output_": outputs,
            "input": inputs,
            "state_unit": ("state", [s.unit for s in model.states]),
            "output_unit": ("output", [s.unit for s in model.outputs]),
            "input_unit": ("input", [s.unit for s in model.inputs]),
        },
    )
    for channel in channels:
        if channel.labels:
            result[channel.dims[0]] = list(channel.labels)
    result["u"] = (("time", "input"), recording["u"].sel(input=inputs).values)
    result["y"] = (("time", "output"), measured.values)
    result["status"].attrs |= {
        "flag_masks": [int(f) for f in flags],
        "flag_meanings": " ".join(f.name.lower() for f in flags if f.name),
    }
    if "x_true" in recording:
        truth = recording["x_true"]
        known = [n for n in names if n in truth["state"].values]
        result["x_true"] = truth.sel(state=known).reindex(state=names).transpose("time", "state")
    return result


def _long_name(variable: str) -> str:
    return RESULT_VARIABLES[variable][1] if variable in RESULT_VARIABLES else variable


def _check_memory(recursion: Recursion, samples: int) -> None:
    doubled = [2 if c.symmetric else 1 for c in recursion.channels]
    numbers = sum(
        size * (1 + factor) for size, factor in zip(recursion.output_sizes, doubled, strict=True)
    )
    needed, available = 8 * numbers * samples, psutil.virtual_memory().available
    if needed > available:
        raise DataError(
            f"the result of {samples} samples would take {needed / 1e9:.1f} GB of memory, but only "
            f"{available / 1e9:.1f} GB are free; process the recording in parts"
        )
