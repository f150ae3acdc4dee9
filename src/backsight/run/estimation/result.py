"""Outputs of a recursion as a result dataset."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.analysis.forces import REMARKS, force_remarks
from backsight.analysis.outliers import DOUBTED as OUTLIER_WEIGHT
from backsight.analysis.outliers import RULE, THRESHOLD
from backsight.engine.recursion import Channel
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.outliers import DOUBTED
from backsight.models.model import Model
from backsight.run.estimation._culprit import with_culprit
from backsight.run.estimation._integration import with_integration
from backsight.run.estimation._match import (
    dummies,
    measured_outputs,
    output_mask,
    with_turns,
)
from backsight.schema import (
    AGO,
    INNOVATIONS,
    POSITIVE,
    RESULT_VARIABLES,
    ROLE,
    SCHEMA_VERSION,
    SIGMA_FACTOR,
    UNKNOWN,
    VIRTUAL_TRUE,
    WEIGHT,
    Status,
)
from backsight.types import Array

HUGE = 1e100
"""No quantity of a machine, and no variance, is as large in any unit."""

ABSURD = 1e6
"""An output that is wrong by so many times what was ever measured comes from a diverged filter."""


def as_result(
    outputs: Sequence[Array],
    channels: Sequence[Channel],
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    engine: str,
    seconds: float,
) -> xr.Dataset:
    """Name the outputs, add units, standard deviations, the recording and what made them.

    Parameters
    ----------
    outputs : sequence of (n, l) arrays
        One row per sample.
    channels : sequence of Channel
        What they are.
    estimator, model, recording
        What they come from.
    engine : str
    seconds : float
        Time that the run took.
    """
    values = {c.name: c.unpack(o) for c, o in zip(channels, outputs, strict=True)}
    result = _dataset(values, channels, model, recording)
    result.attrs |= {
        "estimator": estimator.key,
        "model": model.name,
        "engine": engine,
        "dt": float(recording.attrs["dt"]),
        "seconds": seconds,
        "us_per_sample": seconds / result.sizes["time"] * 1e6,
        "schema": SCHEMA_VERSION,
        INNOVATIONS: estimator.innovations,
    }
    if (rule := estimator.outliers) is not None:
        result.attrs |= {
            RULE: type(rule).__name__,
            THRESHOLD: rule.threshold,
            OUTLIER_WEIGHT: DOUBTED,
        }
    if positive := [s.name for s in model.states if s.positive]:
        result.attrs[POSITIVE] = " ".join(positive)
    result = with_culprit(with_integration(result, estimator, model), estimator, model)
    remarks = force_remarks(result)
    if remarks:
        result.attrs[REMARKS] = "\n".join(remarks)
    return result


def _dataset(
    values: dict[str, np.ndarray],
    channels: Sequence[Channel],
    model: Model,
    recording: xr.Dataset,
) -> xr.Dataset:
    names = [s.name for s in model.states]
    outputs = [s.name for s in model.outputs]
    inputs = [s.name for s in model.inputs]
    resting = model.resting
    measured = measured_outputs(model, recording)
    # What no sensor has measured has no innovation either.
    seen = (output_mask(model, recording) > 0) & ~dummies(model)
    measured = np.where(seen, with_turns(model, measured, values["y_hat"]), np.nan)
    values["e"] = np.where(np.isfinite(measured), values["e"], np.nan)
    if WEIGHT in values:
        values[WEIGHT] = np.where(np.isfinite(measured), values[WEIGHT], np.nan)
    raised = np.nan_to_num(values["status"]).astype(np.int32)
    diverged = np.where(_worthless(values, measured), int(Status.NOT_FINITE), 0)
    values["status"] = (raised | diverged).astype(np.int32)
    dims = {c.name: ("time", *c.dims) for c in channels}
    if "P" in values:
        variance = np.einsum("kii->ki", values["P"])
        values["x_std"], dims["x_std"] = np.sqrt(np.maximum(variance, 0.0)), ("time", "state")
    if any(s.positive for s in model.states) and "x_std" in values:
        values["x_low"], values["x_high"] = _bands(values["x_hat"], values["x_std"], model)
        dims["x_low"] = dims["x_high"] = ("time", "state")
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
            ROLE: ("state", [UNKNOWN if n in resting else "motion" for n in names]),
            "output_unit": ("output", [s.unit for s in model.outputs]),
            "input_unit": ("input", [s.unit for s in model.inputs]),
        },
    )
    for channel in channels:
        if channel.labels:
            result[channel.dims[0]] = list(channel.labels)
        if channel.ago:
            result[channel.name].attrs[AGO] = channel.ago
    if "force" in result.dims:
        result = _with_forces(result, model)
    if model.virtual is not None:
        of_virtual = [s.unit for s in model.virtual.signals]
        result = result.assign_coords(virtual_unit=("virtual", of_virtual))
    result["u"] = (("time", "input"), recording["u"].sel(input=inputs).values)
    result["y"] = (("time", "output"), measured)
    if SIGMA_FACTOR in recording:
        factors = recording[SIGMA_FACTOR].reindex(output=outputs).values
        result[SIGMA_FACTOR] = (("time", "output"), factors)
    result["status"].attrs |= {
        "flag_masks": [int(f) for f in flags],
        "flag_meanings": " ".join(f.name.lower() for f in flags if f.name),
    }
    if "x_true" in recording:
        truth = recording["x_true"]
        known = [n for n in names if n in truth["state"].values]
        result["x_true"] = truth.sel(state=known).reindex(state=names).transpose("time", "state")
        if model.virtual is not None:
            result[VIRTUAL_TRUE] = _virtual_truth(truth, [s.name for s in model.virtual.signals])
    return result


def _bands(x: Array, std: Array, model: Model) -> tuple[Array, Array]:
    """Ends of the bands of one standard deviation; of positive states as factors."""
    positive = np.array([s.positive for s in model.states])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        factor = np.exp(std / x)
        low, high = np.where(positive, x / factor, x - std), np.where(positive, x * factor, x + std)
    return low, high


def _virtual_truth(truth: xr.DataArray, names: list[str]) -> xr.DataArray:
    """True values of virtual outputs, NaN where they are not known."""
    known = truth.sel(state=[n for n in names if n in truth["state"].values])
    columns = known.reindex(state=names).transpose("time", "state").values
    return xr.DataArray(columns, dims=("time", "virtual"), coords={"time": truth["time"]})


def _worthless(values: dict[str, np.ndarray], measured: Array) -> Array:
    """Whether the filter has diverged at a sample, (n,), whatever it says of itself.

    Its numbers are not finite or not those of a machine, or it says something else of what was just
    measured, beyond its own doubts and by far more than anything that was ever measured.
    """
    parts = [
        values[name].reshape(len(measured), -1)
        for name in ("x_hat", "P", "y_hat", "S")
        if name in values
    ]
    sound = np.logical_and.reduce([(np.abs(part) < HUGE).all(axis=1) for part in parts])
    doubt = np.nanmax(np.abs(measured), initial=0.0, axis=0)
    if "S" in values:
        variance = np.einsum("kii->ki", np.where(sound[:, None, None], values["S"], 0.0))
        doubt = np.maximum(np.sqrt(np.maximum(variance, 0.0)), doubt)
    off = np.abs(np.where(sound[:, None], values["y_hat"], 0.0) - measured)
    return ~sound | (off > ABSURD * doubt).any(axis=1)


def _with_forces(result: xr.Dataset, model: Model) -> xr.Dataset:
    """Add units, positions, and standard deviations where only the covariance is given."""
    known = {s.name: s for s in model.parameters}
    forces = [known[str(name)] for name in result["force"].values]
    result = result.assign_coords(force_unit=("force", [s.unit for s in forces]))
    positions = [s.position for s in forces if s.position is not None]
    if len(positions) == len(forces):
        result = result.assign_coords(force_position=("force", positions))
    if "P_d" in result:
        variance = np.einsum("kii->ki", result["P_d"].values)
        result["d_std"] = (("time", "force"), np.sqrt(np.maximum(variance, 0.0)))
    return result


def _long_name(variable: str) -> str:
    return RESULT_VARIABLES[variable][1] if variable in RESULT_VARIABLES else variable
