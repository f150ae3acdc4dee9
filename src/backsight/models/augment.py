"""Parameters, gains and disturbances become states: the joint model of eq. 3-6.

Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer for vibration
dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import casadi as ca

from backsight.description import checked
from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import Signal, along


@checked(ModelError)
def augment(
    model: Model,
    parameters: Sequence[str] = (),
    *,
    disturbances: Mapping[str, str] | None = None,
) -> Model:
    r"""Append parameters and unknown disturbances to the state (eq. 3-6).

    The new states are constant in the model, :math:`\dot p = 0`; the process noise of the
    estimator makes them random walks.

    Parameters
    ----------
    model : Model
        Any model; an unknown force or an actuator gain is a parameter of it.
    parameters : sequence of str
        Parameters to estimate. Unit, scale, bounds and value are kept.
    disturbances : dict, optional
        Name of the new state to the state into whose derivative (next value, if the model is
        discrete) it is added: ``{"w": "v"}``.

    Returns
    -------
    Model
        States ``[x, parameters, disturbances]``, without the parameters that moved.

    Raises
    ------
    ModelError
        If a name is unknown or used twice.
    """
    disturbances = disturbances or {}
    known = {s.name: s for s in model.parameters}
    for name in parameters:
        if name not in known:
            raise ModelError(f"the model has no parameter '{name}': {nearest(name, known)}")
    targets = {name: model.index(target) for name, target in disturbances.items()}

    moved = [known[n] for n in parameters]
    added = [Signal(name=n, unit=_rate_unit(model, model.states[i])) for n, i in targets.items()]
    kept = [s for s in model.parameters if s.name not in parameters]
    nx, nd = model.nx, len(added)

    z = ca.SX.sym("z", nx + len(moved) + nd)
    u = ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(kept))
    x, theta, d = z[:nx], z[nx : nx + len(moved)], z[nx + len(moved) :]
    symbols = {s.name: theta[i] for i, s in enumerate(moved)}
    symbols |= {s.name: p[i] for i, s in enumerate(kept)}
    full = ca.vertcat(*(symbols[s.name] for s in model.parameters))

    push = ca.SX.zeros(nx)
    for k, i in enumerate(targets.values()):
        push[i] += d[k]
    rows = model.f.call([x, u, full])[0] + push
    w = ca.SX.sym("w", nx + len(moved) + nd)
    unchanged = ca.SX.zeros(len(moved) + nd) if model.continuous else ca.vertcat(theta, d)
    return dataclasses.replace(
        model,
        f=ca.Function("f", [z, u, p], [ca.vertcat(rows, unchanged)]),
        h=ca.Function("h", [z, u, p], model.h.call([x, u, full])),
        states=(*model.states, *moved, *added),
        parameters=tuple(kept),
        virtual=along(model.virtual, [z, u, p, w], [x, u, full, w[:nx] + push]),
    )


def _rate_unit(model: Model, state: Signal) -> str:
    if not model.continuous or not state.unit:
        return state.unit
    return f"{state.unit[:-2]}/s2" if state.unit.endswith("/s") else f"{state.unit}/s"
