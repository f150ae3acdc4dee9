"""Another process in the place of that which a force of a model follows."""

import dataclasses

import casadi as ca

from backsight.errors import ModelError, nearest
from backsight.models.forces.driven import Driven
from backsight.models.forces.processes import Process
from backsight.models.model import Model
from backsight.models.signals import Named
from backsight.types import Array


def process_motion(
    process: Process, model: Model, mean: float, z: list[ca.SX], u: ca.SX
) -> tuple[ca.SX, Array]:
    """Rates or next values of a process around the mean of the force, and its noise."""
    middle = ca.vertcat(mean, *[0.0] * (len(z) - 1))
    named = Named("input", [s.name for s in model.inputs], u)
    deviation = ca.vertcat(*z) - middle
    if model.dt is None:
        return process.rates(deviation, named), process.density
    after, noise = process.ahead(deviation, named, dt=model.dt)
    return after + middle, noise


def driven_by(process: Process, names: tuple[str, ...], noise: Array, mean: float) -> Driven:
    """What a process drives, and how."""
    says = f"{names[0]}: {process.words}"
    return Driven(names, noise, process.stationary, says, process=process, mean=mean)


def followed_process(model: Model, force: str) -> Process:
    """Process that a force of a model follows.

    Raises
    ------
    ModelError
        If it follows none.
    """
    return _group(model, force)[1]


def with_process(model: Model, force: str, process: Process) -> Model:
    """Let a force of a model follow another process of the same states, as of another size.

    Raises
    ------
    ModelError
        If the force follows none, or one with other states.
    """
    old, _ = _group(model, force)
    if tuple(force + ending for ending in process.endings) != old.states:
        raise ModelError(f"'{force}' has the states {', '.join(old.states)}, not of this process")
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    places = [model.index(name) for name in old.states]
    moves, noise = process_motion(process, model, old.mean, [x[i] for i in places], u)
    changes = ca.vertsplit(model.f.call([x, u, p])[0])
    for i, change in zip(places, ca.vertsplit(moves), strict=True):
        changes[i] = change
    new = driven_by(process, old.states, noise, old.mean)
    return dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], [ca.vertcat(*changes)]),
        driven=tuple(new if group is old else group for group in model.driven),
    )


def _group(model: Model, force: str) -> tuple[Driven, Process]:
    known = {g.states[0]: (g, g.process) for g in model.driven}
    group, process = known.get(force, (None, None))
    if group is None or process is None:
        raise ModelError(f"'{force}' follows no process: {nearest(force, known)}")
    return group, process
