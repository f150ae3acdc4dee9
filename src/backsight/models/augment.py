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
    inputs: Sequence[str] = (),
) -> Model:
    r"""Append parameters, unknown disturbances and inputs with gaps to the state (eq. 3-6).

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
    inputs : sequence of str
        Inputs that were not recorded at every sample. Each becomes a state, held from sample to
        sample like the input itself, and an output of the same name that measures it where it was
        recorded: read it as an output of the recording. Its random walk is what it may do in a gap.

    Returns
    -------
    Model
        States ``[x, parameters, disturbances, inputs]``, without the parameters and inputs that
        moved.

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
    sources = {s.name: i for i, s in enumerate(model.inputs)}
    for name in inputs:
        if name not in sources:
            raise ModelError(f"the model has no input '{name}': {nearest(name, sources)}")

    moved = [known[n] for n in parameters]
    added = [Signal(name=n, unit=_rate_unit(model, model.states[i])) for n, i in targets.items()]
    kept = [s for s in model.parameters if s.name not in parameters]
    held = [model.inputs[sources[n]] for n in inputs]
    recorded = [s for s in model.inputs if s.name not in inputs]
    nx, nd = model.nx, len(added)

    z = ca.SX.sym("z", nx + len(moved) + nd + len(held))
    u = ca.SX.sym("u", len(recorded))
    p = ca.SX.sym("p", len(kept))
    x, theta, d, v = ca.vertsplit(z, [0, nx, nx + len(moved), z.numel() - len(held), z.numel()])
    full_p = _in_order(model.parameters, [(moved, theta), (kept, p)])
    full_u = _in_order(model.inputs, [(held, v), (recorded, u)])

    push = ca.SX.zeros(nx)
    for k, i in enumerate(targets.values()):
        push[i] += d[k]
    rows = model.f.call([x, full_u, full_p])[0] + push
    constant = ca.vertcat(theta, d, v)
    unchanged = ca.SX.zeros(constant.numel()) if model.continuous else constant
    w = ca.SX.sym("w", z.numel())
    return dataclasses.replace(
        model,
        f=ca.Function("f", [z, u, p], [ca.vertcat(rows, unchanged)]),
        h=ca.Function("h", [z, u, p], [ca.vertcat(model.h.call([x, full_u, full_p])[0], v)]),
        states=(*model.states, *moved, *added, *held),
        inputs=tuple(recorded),
        outputs=(*model.outputs, *(Signal(name=s.name, unit=s.unit) for s in held)),
        parameters=tuple(kept),
        virtual=along(model.virtual, [z, u, p, w], [x, full_u, full_p, w[:nx] + push]),
    )


def _in_order(signals: Sequence[Signal], groups: Sequence[tuple[Sequence[Signal], ca.SX]]) -> ca.SX:
    """Vector of all signals from vectors of some of them."""
    known = {s.name: vector[i] for names, vector in groups for i, s in enumerate(names)}
    return ca.vertcat(*(known[s.name] for s in signals))


def _rate_unit(model: Model, state: Signal) -> str:
    if not model.continuous or not state.unit:
        return state.unit
    return f"{state.unit[:-2]}/s2" if state.unit.endswith("/s") else f"{state.unit}/s"
