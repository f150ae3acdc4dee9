"""A simulation as a recording: measurement noise, and the truth beside it."""

import numpy as np
import xarray as xr

from backsight.models.model import Model
from backsight.schema import recording
from backsight.types import Array


def measured_recording(
    model: Model,
    *,
    dt: float,
    u: Array,
    x: Array,
    y: Array,
    z: Array,
    parameters: Array,
    sigma: Array,
    seed: int,
) -> xr.Dataset:
    """Add noise to the outputs and put a recording together.

    Parameters
    ----------
    model : Model
    dt : float
        Sampling period [s].
    u, x, y, z, parameters : (n, ...) arrays
        Inputs, states, outputs without noise, virtual outputs, and values of all parameters at the
        samples.
    sigma : (ny,) array
        Standard deviation of the noise.
    seed : int
        Of the noise, ``numpy.random.default_rng(seed)``.

    Returns
    -------
    xarray.Dataset
        With ``x_true (time, state)``: states, parameters and virtual outputs.
    """
    noise = sigma * np.random.default_rng(seed).standard_normal(y.shape)
    result = recording(
        np.arange(len(u)) * dt,
        u=u,
        y=y + noise,
        inputs={s.name: s.unit for s in model.inputs},
        outputs={s.name: s.unit for s in model.outputs},
        dt=dt,
    )
    known = [*model.states, *model.parameters]
    known += [] if model.virtual is None else model.virtual.signals
    result["x_true"] = (("time", "state"), np.hstack([x, parameters, z]))
    result = result.assign_coords(
        state=[s.name for s in known], state_unit=("state", [s.unit for s in known])
    )
    result.attrs |= {"model": model.name, "seed": seed}
    return result
