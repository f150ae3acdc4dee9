"""Parameters, gains and disturbances become states: the joint model of eq. 3-6.

Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer for vibration
dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import casadi as ca

from backsight.description import checked
from backsight.errors import ModelError, nearest
from backsight.models.forces.changing import driven_by, process_motion
from backsight.models.forces.processes import Process
from backsight.models.model import Model
from backsight.models.signals import Signal, along


@checked(ModelError)
def augment(
    model: Model,
    parameters: Sequence[str] = (),
    *,
    disturbances: Mapping[str, str] | None = None,
    inputs: Sequence[str] = (),
    forces: Mapping[str, Process] | None = None,
) -> Model:
    r"""Append parameters, disturbances, forces and inputs with gaps to the state (eq. 3-6).

    The new states are constant in the model, :math:`\dot p = 0`; the process noise of the
    estimator makes them random walks. Forces with dynamics bring their noise and their prior
    along, see `backsight.models.forces.processes`: an estimator's `Noise` and `Prior` need not
    name them.

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
    forces : dict, optional
        Name of a parameter, or of a disturbance, to the process that it is:
        ``{"F": bs.forces.Matern(10.0, 0.1)}``. Its mean is the value of the parameter. The force is
        the state of its own name; what else the process needs comes behind all other states.

    Returns
    -------
    Model
        States ``[x, parameters, disturbances, forces, inputs]`` and what the forces need, without
        the parameters and inputs that moved.

    Raises
    ------
    ModelError
        If a name is unknown or used twice.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> print(bs.augment(spring, parameters=["k"], disturbances={"w": "v"}))
    sdof (continuous)
    ├── states      q [m], v [m/s], k [1/s2], w [m/s2]
    ├── inputs      u [N]
    ├── outputs     y [m]
    └── parameters  b = 0.8, c = 1
    """
    disturbances, forces = disturbances or {}, forces or {}
    known = {s.name: s for s in model.parameters}
    plain = [n for n in forces if n not in disturbances]
    for name in (*parameters, *plain):
        if name not in known:
            raise ModelError(f"the model has no parameter '{name}': {nearest(name, known)}")
    for name in plain:
        if name in parameters:
            raise ModelError(f"'{name}' is a parameter and a force; give it once")
    sources = {s.name: i for i, s in enumerate(model.inputs)}
    for name, process in forces.items():
        needed = process.input_needed
        if needed is not None and needed not in sources:
            raise ModelError(f"force '{name}' follows '{needed}': {nearest(needed, sources)}")
    targets = {name: model.index(target) for name, target in disturbances.items()}
    for name in inputs:
        if name not in sources:
            raise ModelError(f"the model has no input '{name}': {nearest(name, sources)}")

    # New states: constants, disturbances, forces, and what more the forces need.
    moved = [known[n] for n in (*parameters, *plain)]
    added = [Signal(name=n, unit=_rate_unit(model, model.states[i])) for n, i in targets.items()]
    held = [model.inputs[sources[n]] for n in inputs]
    recorded = [s for s in model.inputs if s.name not in inputs]
    walking = (*moved[: len(parameters)], *added, *moved[len(parameters) :], *held)
    new = {s.name: s for s in walking}
    more = [
        Signal(name=n + ending, unit=new[n].unit if "rate" not in ending else "")
        for n, process in forces.items()
        for ending in process.endings[1:]
    ]
    kept = [s for s in model.parameters if s.name not in new]
    states = (*model.states, *new.values(), *more)

    z = ca.SX.sym("z", len(states))
    u = ca.SX.sym("u", len(recorded))
    p = ca.SX.sym("p", len(kept))
    x, w = z[: model.nx], ca.SX.sym("w", len(states))
    of_state = {s.name: z[i] for i, s in enumerate(states)}
    full_p = _in_order(model.parameters, of_state | {s.name: p[i] for i, s in enumerate(kept)})
    full_u = _in_order(model.inputs, of_state | {s.name: u[i] for i, s in enumerate(recorded)})
    given = [x, full_u, full_p]

    push = ca.SX.zeros(model.nx)
    for name, i in targets.items():
        push[i] += of_state[name]
    still = {s.name: ca.SX(0) if model.continuous else of_state[s.name] for s in states}
    driven = []
    for name, process in forces.items():
        names = [name + ending for ending in process.endings]
        chain = [of_state[n] for n in names]
        moves, noise = process_motion(process, model, new[name].value, chain, full_u)
        still |= dict(zip(names, ca.vertsplit(moves), strict=True))
        driven.append(driven_by(process, tuple(names), noise, new[name].value))
    changes = [still[s.name] for s in states[model.nx :]]
    seen = ca.vertcat(model.h.call(given)[0], *(of_state[s.name] for s in held))
    return dataclasses.replace(
        model,
        f=ca.Function("f", [z, u, p], [ca.vertcat(model.f.call(given)[0] + push, *changes)]),
        h=ca.Function("h", [z, u, p], [seen]),
        states=states,
        inputs=tuple(recorded),
        outputs=(*model.outputs, *(Signal(name=s.name, unit=s.unit) for s in held)),
        parameters=tuple(kept),
        driven=(*model.driven, *driven),
        unsolved=model.unsolved_at([z, u, p], given),
        virtual=along(model.virtual, [z, u, p, w], [*given, w[: model.nx] + push]),
    )


def _in_order(signals: Sequence[Signal], known: Mapping[str, ca.SX]) -> ca.SX:
    """Vector of the signals."""
    return ca.vertcat(*(known[s.name] for s in signals))


def _rate_unit(model: Model, state: Signal) -> str:
    if not model.continuous or not state.unit:
        return state.unit
    return f"{state.unit[:-2]}/s2" if state.unit.endswith("/s") else f"{state.unit}/s"


def with_idle_inputs(model: Model, names: Sequence[str]) -> Model:
    """The model with further inputs that do nothing in it, as factors of noise."""
    if not names:
        return model
    x, p, w = (
        ca.SX.sym("x", model.nx),
        ca.SX.sym("p", len(model.parameters)),
        ca.SX.sym("w", model.nx),
    )
    u = ca.SX.sym("u", model.nu + len(names))
    given = [x, u[: model.nu], p]
    return dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], model.f.call(given)),
        h=ca.Function("h", [x, u, p], model.h.call(given)),
        unsolved=model.unsolved_at([x, u, p], given),
        virtual=along(model.virtual, [x, u, p, w], [*given, w]),
        inputs=(*model.inputs, *(Signal(name=n) for n in names)),
    )
