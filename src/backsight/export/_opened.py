"""The step of a recursion with its settings as inputs."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.recursion import Recursion
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array

SIGMA = "sigma_y"
"""Field of the standard deviations of the sensors, and the word that asks for them."""

PARAMETERS = "parameters"
"""Field of the parameters of the model."""

DATA = ("u", "y", "mask")


def opened_step(
    inner: Recursion, model: Model, signals: dict[str, tuple[Signal, ...]], R: Array
) -> ca.Function:
    """The step with the settings as inputs of their own, before the data."""
    sizes = {
        "carry": len(inner.carry0),
        **{name: len(group) for name, group in signals.items()},
        **dict(zip(DATA, (model.nu, model.ny, model.ny), strict=True)),
    }
    given = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    u, mask = given["u"], given["mask"]
    if PARAMETERS in given:
        u = ca.vertcat(u, given[PARAMETERS])
    if SIGMA in given:
        mask = _weights(R)(mask, given[SIGMA])
    results = inner.step.call([given["carry"], u, given["y"], mask], True, False)
    if SIGMA in given:
        where = 1 + [c.name for c in inner.channels].index("S")
        results[where] = _unmeasured(R)(results[where], given["mask"], given[SIGMA])
    outputs = [f"o{i}" for i in range(len(results))]
    return ca.Function(inner.name, list(given.values()), results, list(given), outputs)


def _weights(R: Array) -> ca.Function:
    """Weights of a sample whose sensors have other standard deviations than the nominal ones."""
    mask, sigma = ca.SX.sym("mask", len(R)), ca.SX.sym("sigma", len(R))
    return ca.Function("weights", [mask, sigma], [mask * (_nominal(R) / sigma)])


def _unmeasured(R: Array) -> ca.Function:
    """Covariance of the innovation of outputs that were not measured, which have no weight.

    A weight w makes R_ij of it R_ij / (w_i w_j); without one the nominal noise is in it.
    """
    n = len(R)
    S, mask = ca.SX.sym("S", n * (n + 1) // 2), ca.SX.sym("mask", n)
    sigma = ca.SX.sym("sigma", n)
    hidden = ca.logic_not(mask > 0)
    is_ = sigma / _nominal(R) / ca.if_else(hidden, 1, mask)
    was = ca.if_else(hidden, 1, is_)
    added = ca.SX(R) * (is_ @ is_.T - was @ was.T)
    return ca.Function("unmeasured", [S, mask, sigma], [ca.densify(S + vech(added))])


def _nominal(R: Array) -> ca.SX:
    return ca.SX(ca.DM(np.sqrt(np.diag(R))))
