"""Pick the channels of a recording that a model needs."""

import numpy as np
import xarray as xr

from backsight.errors import DataError, nearest
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array


def match(model: Model, recording: xr.Dataset) -> tuple[Array, Array, Array]:
    """Inputs, outputs and mask in the order of the model.

    Returns
    -------
    u : (n, nu) array
    y : (n, ny) array
        Zero where not measured.
    mask : (n, ny) array
        One where measured, else zero.

    Raises
    ------
    DataError
        If a channel is missing, an input is not finite or an output is infinite.
    """
    u = _columns(recording, "u", "input", of=model.inputs)
    y = _columns(recording, "y", "output", of=model.outputs)
    if len(u) == 0:
        raise DataError("the recording is empty")
    bad = np.argwhere(~np.isfinite(u))
    if len(bad):
        k, i = bad[0]
        raise DataError(
            f"input '{model.inputs[i].name}' is {u[k, i]} at sample {k}; inputs must be known at "
            "every sample: fill the gap or cut the recording there"
        )
    bad = np.argwhere(np.isinf(y))
    if len(bad):
        k, i = bad[0]
        raise DataError(
            f"output '{model.outputs[i].name}' is infinite at sample {k}; NaN means 'not measured'"
        )
    measured = np.isfinite(y)
    return u, np.where(measured, y, 0.0), measured.astype(float)


def _columns(recording: xr.Dataset, variable: str, dim: str, *, of: tuple[Signal, ...]) -> Array:
    if variable not in recording:
        raise DataError(f"the recording has no variable '{variable}'; make it with `bs.read`")
    names = [str(n) for n in recording[dim].values]
    for s in of:
        if s.name not in names:
            raise DataError(f"the recording has no {dim} '{s.name}': {nearest(s.name, names)}")
    order = [names.index(s.name) for s in of]
    return np.ascontiguousarray(recording[variable].values[:, order], dtype=float)
