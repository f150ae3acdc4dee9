"""Sensors between a model and its readings: a limited range, then a low-pass."""

import dataclasses
import math

import casadi as ca
import numpy as np

from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.signals import Signal, along, vector
from backsight.types import ByName

ENDING = "_sensor"
"""Of the name of the state that a sensor adds."""


def sensor_lag(model: Model, cutoff: ByName, *, limit: ByName = math.inf) -> Model:
    r"""Read every output through a sensor with a low-pass of the first order.

    .. math:: \dot s_j = 2 \pi f_j \, (\mathrm{clip}(h_j(x, u, p), \pm l_j) - s_j), \qquad y_j = s_j

    Where a sensor is clipped before its low-pass, as accelerometers are, the readings look like
    small, smooth and plausible accelerations while the sensor is at its limit most of the time.

    Parameters
    ----------
    model : Model
        Continuous in time.
    cutoff : dict, sequence or number
        Frequency at which the reading is 3 dB too small, of every output [Hz]; outputs that a dict
        leaves out have no low-pass and stay as they are.
    limit : dict, sequence or number
        Range of every sensor, plus or minus [unit of the output]; without limit if not given.

    Returns
    -------
    Model
        With one more state per sensor, ``"<output>_sensor"``; linear if the model is and no sensor
        has a limit.

    Raises
    ------
    ModelError
        If the model is discrete in time, or a cutoff or limit is not positive or names no output.

    Examples
    --------
    >>> from backsight.models.builtin import sdof
    >>> [s.name for s in sensor_lag(sdof(k=100.0, b=1.0), cutoff=50.0).states]
    ['q', 'v', 'y_sensor']
    """
    if not model.continuous:
        raise ModelError("a sensor's low-pass needs a model that is continuous in time")
    none = np.full(model.ny, np.inf)
    cutoffs = vector(cutoff, model.outputs, what="cutoff", default=none)
    limits = vector(limit, model.outputs, what="limit", default=none)
    for what, values in (("cutoff", cutoffs), ("limit", limits)):
        for value, output in zip(values, model.outputs, strict=True):
            if not value > 0:
                raise ModelError(f"the {what} of '{output.name}' is {value:g}; it must be positive")
    slow = [j for j in range(model.ny) if math.isfinite(cutoffs[j])]
    x, s = ca.SX.sym("x", model.nx), ca.SX.sym("s", len(slow))
    u, p = ca.SX.sym("u", model.nu), ca.SX.sym("p", len(model.parameters))
    rows = ca.vertsplit(model.h.call([x, u, p])[0])
    seen = [_clipped(row, limit) for row, limit in zip(rows, limits, strict=True)]
    rates = [2 * np.pi * cutoffs[j] * (seen[j] - s[k]) for k, j in enumerate(slow)]
    read = dict(zip(slow, ca.vertsplit(s), strict=True)) if slow else {}
    z, w = ca.vertcat(x, s), ca.SX.sym("w", model.nx + len(slow))
    return dataclasses.replace(
        model,
        f=ca.Function("f", [z, u, p], [ca.vertcat(model.f.call([x, u, p])[0], *rates)]),
        h=ca.Function("h", [z, u, p], [ca.vertcat(*(read.get(j, e) for j, e in enumerate(seen)))]),
        states=(*model.states, *(_state(model.outputs[j]) for j in slow)),
        unsolved=model.unsolved_at([z, u, p], [x, u, p]),
        virtual=along(model.virtual, [z, u, p, w], [x, u, p, w[: model.nx]]),
    )


def _clipped(value: ca.SX, limit: float) -> ca.SX:
    return ca.fmax(ca.fmin(value, limit), -limit) if math.isfinite(limit) else value


def _state(output: Signal) -> Signal:
    return Signal(unit=output.unit, name=output.name + ENDING)
