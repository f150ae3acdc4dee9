"""Pick the channels of a recording that a model needs, and weigh its samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from backsight.errors import DataError, nearest
from backsight.estimators.around.saturation import ends
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.schema import SIGMA_FACTOR, check_sigma_factor
from backsight.types import Array
from backsight.units import conversion, convertible, is_unit

if TYPE_CHECKING:
    import xarray as xr


def match(
    model: Model, recording: xr.Dataset, *, estimator: AbstractEstimator | None = None
) -> tuple[Array, Array, Array]:
    """Inputs, outputs and mask in the order of the model.

    Parameters
    ----------
    model : Model
    recording : xarray.Dataset
    estimator : AbstractEstimator, optional
        What the data are for; without one, all samples must have the same noise.

    Returns
    -------
    u : (n, nu) array
    y : (n, ny) array
        Zero where not measured.
    mask : (n, ny) array
        One where measured, else zero; where a sample has a noise of its own, the nominal standard
        deviation by that of the sample.

    Raises
    ------
    DataError
        If a channel is missing, an input is not finite, an output is infinite, or samples have a
        noise of their own and the estimator does not weigh them.
    """
    u = matched_inputs(model, recording)
    y = measured_outputs(model, recording)
    infinite = np.isinf(y)
    if infinite.any():
        k, i = np.argwhere(infinite)[0]
        raise DataError(
            f"output '{model.outputs[i].name}' is infinite at sample {k}; NaN means 'not measured'"
        )
    mask = output_mask(model, recording, y)
    weighted = (mask > 0) & (mask != 1) if SIGMA_FACTOR in recording else np.zeros(0, bool)
    if weighted.any() and not _weighs(estimator):
        k, i = np.argwhere(weighted)[0]
        raise DataError(
            f"output '{model.outputs[i].name}' has a noise of its own at sample {k}, which "
            f"{estimator.title if estimator else 'this method'} cannot take into account: use an "
            f"estimator that can, such as EKF, or leave out '{SIGMA_FACTOR}'"
        )
    return u, np.where(mask > 0, y, 0.0), mask


def matched_inputs(model: Model, recording: xr.Dataset) -> Array:
    """Inputs in the order of the model, (n, nu), all of them known; see `match`."""
    u = _columns(recording, "u", "input", of=model.inputs)
    if len(u) == 0:
        raise DataError("the recording is empty")
    known = np.isfinite(u)
    if not known.all():
        k, i = np.argwhere(~known)[0]
        raise DataError(
            f"input '{model.inputs[i].name}' is {u[k, i]} at sample {k}; inputs must be known at "
            "every sample. Cut the recording there, or estimate the input: make it an output of "
            f"the recording and take augment(model, inputs=['{model.inputs[i].name}'])"
        )
    return u


def measured_outputs(model: Model, recording: xr.Dataset) -> Array:
    """Outputs in the order of the model, (n, ny), NaN where not measured; see `match`.

    Dummy measurements are in no recording; readings at the end of the range of their sensor are no
    measurements.
    """
    real = tuple(s for s in model.outputs if s.dummy is None)
    y = np.empty((recording.sizes["time"], model.ny))
    y[:, dummies(model)] = [s.dummy for s in model.outputs if s.dummy is not None]
    y[:, ~dummies(model)] = _columns(recording, "y", "output", of=real)
    low, high = ends(model)
    return np.where((y > low) & (y < high), y, np.nan)


def with_turns(model: Model, y: Array, near: Array) -> Array:
    """Outputs (n, ny), those that start anew after a turn with as many as bring them `near`."""
    if all(s.wrap is None for s in model.outputs):
        return y
    turned = y.copy()
    for i, s in enumerate(model.outputs):
        if s.wrap is not None:
            known = np.isfinite(near[:, i])
            turned[known, i] += s.wrap * np.round((near[known, i] - y[known, i]) / s.wrap)
    return turned


def dummies(model: Model) -> np.ndarray:
    """Which outputs are dummy measurements, (ny,)."""
    return np.array([s.dummy is not None for s in model.outputs])


def sensed_outputs(model: Model, y: Array, mask: Array) -> Array:
    """Outputs (n, ny) that a sensor has measured, NaN elsewhere and where they are dummies."""
    return np.where((mask > 0) & ~dummies(model), y, np.nan)


def output_mask(model: Model, recording: xr.Dataset, y: Array) -> Array:
    """Mask (n, ny) of `measured_outputs` y, see `match`."""
    if SIGMA_FACTOR not in recording:
        return np.isfinite(y).astype(float)
    real = tuple(s for s in model.outputs if s.dummy is None)
    factor = np.ones(y.shape)
    factor[:, ~dummies(model)] = _columns(recording, SIGMA_FACTOR, "output", of=real)
    check_sigma_factor(factor, [s.name for s in model.outputs], "recording")
    measured = np.isfinite(y) & np.isfinite(factor)
    return np.where(measured, 1 / np.where(measured, factor, 1.0), 0.0)


def _check_unit(kind: str, name: str, given: str, wanted: str) -> None:
    """Raise `DataError` if a signal has another number in the unit of the model, or none."""
    if not (given and wanted) or given == wanted or not (is_unit(given) and is_unit(wanted)):
        return
    if not convertible(given, wanted):
        raise DataError(
            f"{kind} '{name}' is in {given}, the model takes {wanted}, which is another quantity; "
            "take the column that is meant, or mend the unit of one of the two"
        )
    if not conversion(given, wanted).same:
        raise DataError(
            f"{kind} '{name}' is in {given}, the model takes {wanted}; convert it, "
            f"bs.data.convert_units(recording, {{'{name}': '{wanted}'}})"
        )


def _weighs(estimator: AbstractEstimator | None) -> bool:
    return estimator is not None and estimator.weighs


def _columns(recording: xr.Dataset, variable: str, dim: str, *, of: tuple[Signal, ...]) -> Array:
    if variable not in recording:
        raise DataError(f"the recording has no variable '{variable}'; make it with `bs.read`")
    # Variables, not arrays with coordinates: making one takes as long as a hundred samples.
    known = recording.variables
    names = [str(n) for n in (known[dim].values if dim in known else range(recording.sizes[dim]))]
    for s in of:
        if s.name not in names:
            raise DataError(f"the recording has no {dim} '{s.name}': {nearest(s.name, names)}")
    order = [names.index(s.name) for s in of]
    units = known[f"{dim}_unit"].values.tolist() if f"{dim}_unit" in known else []
    for s, k in zip(of, order, strict=True) if units else ():
        _check_unit(dim, s.name, units[k], s.unit)
    return np.ascontiguousarray(known[variable].values[:, order], dtype=float)
