"""Outputs of a recursion as a result dataset."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from backsight.analysis.forces import REMARKS, force_remarks
from backsight.analysis.outliers import DOUBTED as OUTLIER_WEIGHT
from backsight.analysis.outliers import RULE, THRESHOLD
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Channel
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.outliers import DOUBTED
from backsight.models.model import Model
from backsight.run.estimation._match import measured_outputs, output_mask, sensed_outputs
from backsight.run.estimation.results._culprit import with_culprit
from backsight.run.estimation.results._integration import with_integration
from backsight.run.estimation.results.outputs import Outputs
from backsight.run.estimation.results.values import Measured, deviation, looked_at, named
from backsight.schema import (
    AGO,
    EVERY,
    INNOVATIONS,
    LOWER,
    POSITIVE,
    RESULT_VARIABLES,
    ROLE,
    SCHEMA_VERSION,
    SIGMA_FACTOR,
    UNKNOWN,
    UPPER,
    VIRTUAL_TRUE,
    Status,
)
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Made:
    """What a result comes from.

    Parameters
    ----------
    estimator, model, recording
    u, y : arrays
        Inputs (n, nu) and outputs (n, ny) in the order of the model; NaN where no sensor measured.
    integrator : Integrator, optional
        How the model was carried from sample to sample.
    coordinates : xarray.Coordinates
        Names and units along all dimensions but time.
    """

    estimator: AbstractEstimator
    model: Model
    recording: xr.Dataset
    u: Array
    y: Array
    integrator: Integrator | None
    coordinates: xr.Coordinates


def as_result(
    outputs: Sequence[Array],
    channels: Sequence[Channel],
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    engine: str,
    seconds: float,
    largest: Array | None = None,
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
    largest : (ny,) array, optional
        Size of every output in all of the recording, if this is a part of one.
    """
    values = named(outputs, channels)
    y = measured_outputs(model, recording)
    measured = sensed_outputs(model, y, output_mask(model, recording, y))
    if "P" in values:
        channels = (*channels, Channel("x_std", ("state",)))
        values["x_std"] = deviation(values["P"])
    made = Made(
        estimator,
        model,
        recording,
        u=recording["u"].sel(input=[s.name for s in model.inputs]).values,
        y=measured,
        integrator=estimator.chosen(model, float(recording.attrs["dt"])),
        coordinates=coordinates(model, channels),
    )
    seen = Measured.of(measured) if largest is None else Measured(measured, largest)
    believed = looked_at(values, seen, model)
    return result_of(believed, channels, made, outputs=Outputs(), engine=engine, seconds=seconds)


def result_of(
    values: Mapping[str, Array],
    channels: Sequence[Channel],
    made: Made,
    *,
    outputs: Outputs,
    engine: str,
    seconds: float,
) -> xr.Dataset:
    """Put together what is kept of a result.

    Parameters
    ----------
    values : dict
        Numbers of the samples that are kept, as of `named`, of variables that are kept.
    channels : sequence of Channel
        What they are.
    made : Made
    outputs : Outputs
        What is kept.
    engine : str
    seconds : float
        Time that the run took.
    """
    dt, estimator = float(made.recording.attrs["dt"]), made.estimator
    result = _dataset(values, channels, made, outputs)
    result.attrs |= {
        "estimator": estimator.key,
        "model": made.model.name,
        "engine": engine,
        "dt": dt * outputs.every,
        "seconds": seconds,
        "us_per_sample": seconds / len(made.u) * 1e6,
        "schema": SCHEMA_VERSION,
        INNOVATIONS: estimator.innovations,
    }
    if outputs.every > 1:
        result.attrs[EVERY] = outputs.every
    if (rule := estimator.outliers) is not None:
        result.attrs |= {
            RULE: type(rule).__name__,
            THRESHOLD: rule.threshold,
            OUTLIER_WEIGHT: DOUBTED,
        }
    if positive := [s.name for s in made.model.states if s.positive]:
        result.attrs[POSITIVE] = " ".join(positive)
    u = made.u[_every(outputs.every)]
    result = with_integration(result, made.integrator, made.model, u=u, dt=dt)
    result = with_culprit(result, estimator, made.model, u=u)
    remarks = force_remarks(result)
    if remarks:
        result.attrs[REMARKS] = "\n".join(remarks)
    return result


def _dataset(
    values: Mapping[str, Array], channels: Sequence[Channel], made: Made, outputs: Outputs
) -> xr.Dataset:
    kept = {c.name: c for c in channels if c.name in values and outputs.keeps(c.name)}
    dims = {name: ("time", *c.dims) for name, c in kept.items()}
    variables = {
        name: xr.Variable(dims[name], values[name], {"long_name": _long_name(name)})
        for name in kept
    }
    for channel in kept.values():
        if channel.ago:
            variables[channel.name].attrs[AGO] = channel.ago
    variables["status"].attrs |= _FLAGS
    thin = _every(outputs.every)
    if outputs.keeps("u"):
        inputs = made.u[thin].astype(outputs.dtype, copy=False)
        variables["u"] = xr.Variable(("time", "input"), inputs)
    if "y" in values and outputs.keeps("y"):
        variables["y"] = xr.Variable(("time", "output"), values["y"])
    if SIGMA_FACTOR in made.recording and outputs.keeps(SIGMA_FACTOR):
        names = [s.name for s in made.model.outputs]
        factors = made.recording[SIGMA_FACTOR].reindex(output=names).values[thin]
        variables[SIGMA_FACTOR] = xr.Variable(
            ("time", "output"), factors.astype(outputs.dtype, copy=False)
        )
    if "x_true" in made.recording and outputs.keeps("x_true"):
        states = [s.name for s in made.model.states]
        variables["x_true"] = _truth(made, "state", states, outputs)
        if made.model.virtual is not None and "virtual" in made.coordinates:
            signals = [s.name for s in made.model.virtual.signals]
            variables[VIRTUAL_TRUE] = _truth(made, "virtual", signals, outputs)
    result = _put_together(variables, made, outputs.every)
    if any(s.positive for s in made.model.states) and "x_std" in result:
        ends = _bands(values["x_hat"], values["x_std"], made.model)
        for name, end in zip(("x_low", "x_high"), ends, strict=True):
            result[name] = (("time", "state"), end, {"long_name": _long_name(name)})
    if "P_d" in result.variables and "d_std" not in result.variables:
        result["d_std"] = (("time", "force"), deviation(result["P_d"].values))
    return result


def _put_together(variables: Mapping[str, xr.Variable], made: Made, every: int) -> xr.Dataset:
    """Variables with all coordinates, whose indices are made already.

    The constructor of xarray merges and aligns what cannot differ here, which takes as long as two
    thousand samples; where this version of it has its own way round that, it is taken.
    """
    recording = made.recording if every == 1 else made.recording[["time"]].isel(time=_every(every))
    indexes = {**made.coordinates.xindexes, "time": recording.xindexes["time"]}
    along = {**made.coordinates.variables, "time": recording.variables["time"]}
    if _DIRECT is None:
        return xr.Dataset(variables, coords=xr.Coordinates(along, indexes=indexes))
    own = {name: variable.copy(deep=False) for name, variable in along.items()}
    return _DIRECT({**variables, **own}, set(own), indexes=indexes)


_DIRECT: Callable[..., xr.Dataset] | None = getattr(xr.Dataset, "_construct_direct", None)


def _every(count: int) -> slice:
    return slice(None, None, count)


def coordinates(model: Model, channels: Iterable[Channel]) -> xr.Coordinates:
    """Names, units and roles along all dimensions of a result but time."""
    names, resting = [s.name for s in model.states], model.resting
    outputs = [s.name for s in model.outputs]
    found: dict[str, Any] = {
        "state": names,
        "state_": names,
        "output": outputs,
        "output_": outputs,
        "input": [s.name for s in model.inputs],
        "state_unit": ("state", [s.unit for s in model.states]),
        ROLE: ("state", [UNKNOWN if n in resting else "motion" for n in names]),
        "output_unit": ("output", [s.unit for s in model.outputs]),
        "input_unit": ("input", [s.unit for s in model.inputs]),
    }
    lower, upper = ([getattr(s, end) for s in model.states] for end in ("lower", "upper"))
    if np.isfinite([*lower, *upper]).any():
        found |= {LOWER: ("state", lower), UPPER: ("state", upper)}
    found |= {c.dims[0]: list(c.labels) for c in channels if c.labels}
    if model.virtual is not None and "virtual" in found:
        found["virtual_unit"] = ("virtual", [s.unit for s in model.virtual.signals])
    if "force" in found:
        known = {s.name: s for s in model.parameters}
        forces = [known[name] for name in found["force"]]
        found["force_unit"] = ("force", [s.unit for s in forces])
        positions = [s.position for s in forces if s.position is not None]
        if len(positions) == len(forces):
            found["force_position"] = ("force", positions)
    return xr.Dataset(coords=found).coords


def _bands(x: Array, std: Array, model: Model) -> tuple[Array, Array]:
    """Ends of the bands of one standard deviation; of positive states as factors."""
    positive = np.array([s.positive for s in model.states])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        factor = np.exp(std / x)
        low, high = np.where(positive, x / factor, x - std), np.where(positive, x * factor, x + std)
    return low, high


def _truth(made: Made, dim: str, names: Sequence[str], outputs: Outputs) -> xr.Variable:
    """True values of states or virtual outputs, NaN where they are not known."""
    # Variables, not arrays with coordinates: making one takes as long as a hundred samples.
    known = made.recording.variables
    truth = known["x_true"].transpose("time", "state")
    column = {name: i for i, name in enumerate(known["state"].values)}
    values = truth.values[_every(outputs.every)]
    found = np.full((len(values), len(names)), np.nan, dtype=outputs.dtype)
    for i, name in enumerate(names):
        if name in column:
            found[:, i] = values[:, column[name]]
    return xr.Variable(("time", dim), found, truth.attrs)


_BITS = [bit for bit in Status if bit]
_FLAGS = {
    "flag_masks": [int(bit) for bit in _BITS],
    "flag_meanings": " ".join(bit.name.lower() for bit in _BITS if bit.name),
}


def _long_name(variable: str) -> str:
    return RESULT_VARIABLES[variable][1] if variable in RESULT_VARIABLES else variable
