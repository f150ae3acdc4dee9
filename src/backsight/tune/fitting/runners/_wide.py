r"""An estimator and its model with every free value as an input.

Parameters of the model are inputs, those of the process noise multiply it (`VariedNoise`), and
settings are read from inputs (`VariedNumber`). An output that comes late by d shows

.. math:: y_i(t) = h_i(x(t - d)),

where the state is carried back along the model's own rates by one step of a Runge-Kutta method,
with the input of the sample before if d is positive.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import explicit
from backsight.estimators import Compilable
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.scaled import Setting, setting
from backsight.estimators.varied_number import VariedNumber
from backsight.models.augment import with_idle_inputs
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.tune.fitting.runners._free_noise import FreeNoise
from backsight.tune.fitting.values import Unknown, number_at, with_setting
from backsight.types import Array

PREVIOUS = "previous_"
"""Begin of the names of inputs that are those of the sample before."""

BACK = Integrator("rk4", 1)
"""How the state is carried back by the delay of an output."""


@dataclasses.dataclass(frozen=True)
class Wide:
    """Estimator and model with values as inputs, behind those of the recording.

    Parameters
    ----------
    varied : Compilable
    model : Model
    names : tuple of str
        Of the inputs that are values.
    numbers : callable
        Values of these inputs, from the values of the unknowns by name.
    remembers : bool
        Whether the inputs of the sample before stand behind those of the sample.
    """

    varied: Compilable
    model: Model
    names: tuple[str, ...]
    numbers: Callable[[Mapping[str, float]], Array]
    remembers: bool


def opened_to_inputs(
    estimator: AbstractEstimator, model: Model, dt: float, unknowns: Sequence[Unknown]
) -> Wide:
    """Make inputs of all values but those of the prior and those that are factors of sensors."""
    by_kind = {
        kind: [u for u in unknowns if u.kind == kind] for kind in ("parameter", "setting", "delay")
    }
    parameters = [u.entry for u in by_kind["parameter"]]
    late = {u.entry.partition(".")[2]: u for u in by_kind["delay"] if u.late_output}
    factors = FreeNoise(tuple(unknowns))
    wide = _scaled(estimator, model, dt)
    if late:
        wide = with_idle_inputs(wide, [PREVIOUS + s.name for s in model.inputs])
    wide = forces_as_inputs(wide, parameters) if parameters else wide
    names = factors.names
    names += [f"setting_{u.entry}".replace(".", "_") for u in by_kind["setting"]]
    names += [f"delay_of_{output}" for output in late]
    first = len(wide.inputs)
    wide = with_idle_inputs(wide, names)
    if late:
        at = {output: first + names.index(f"delay_of_{output}") for output in late}
        wide = _with_late_outputs(wide, model.nu, at)

    def numbers(values: Mapping[str, float]) -> Array:
        return np.array(
            [
                *(values[u.name] for u in by_kind["parameter"]),
                *factors.numbers(values),
                *(values[u.name] for u in by_kind["setting"]),
                *(values[u.name] for u in late.values()),
            ]
        )

    bends = bool(parameters or late)
    varied = _varied(estimator, model, dt, unknowns, bends=bends)
    for k, u in enumerate(by_kind["setting"]):
        at = first + len(factors.names) + k
        varied = with_setting(varied, u.entry, VariedNumber(number_at(varied, u.entry), at))
    return Wide(varied, wide, (*parameters, *names), numbers, bool(late))


def _scaled(estimator: AbstractEstimator, model: Model, dt: float) -> Model:
    """The model with the scales that the estimator would choose, fixed."""
    noise, prior = estimator.assumed
    s: Setting = setting(model, dt, noise=noise, prior=prior)

    def sized(group: Sequence[Signal], scales: Array) -> tuple[Signal, ...]:
        pairs = zip(group, scales, strict=True)
        return tuple(dataclasses.replace(x, scale=float(k)) for x, k in pairs)

    return dataclasses.replace(
        model, states=sized(model.states, s.sx), outputs=sized(model.outputs, s.sy)
    )


def _with_late_outputs(model: Model, nu: int, late: Mapping[str, int]) -> Model:
    """The model with outputs that show the state some time ago, by the input at this place."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    rows = ca.vertsplit(model.h.call([x, u, p])[0])
    for i, output in enumerate(model.outputs):
        if output.name not in late:
            continue
        d = u[late[output.name]]
        then = ca.vertcat(*(ca.if_else(d > 0, u[nu + k], u[k]) for k in range(nu)), u[nu:])
        back = BACK.substep(lambda v, w: model.f.call([v, w, p])[0], x, ua=then, ub=then, h=-d)
        rows[i] = model.h.call([back, then, p])[0][i]
    return dataclasses.replace(model, h=ca.Function("h", [x, u, p], [ca.vertcat(*rows)]))


def _varied(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    unknowns: Sequence[Unknown],
    *,
    bends: bool,
) -> Compilable:
    """The estimator with noise that inputs multiply, and its integrator settled.

    With parameters as inputs a linear model is not linear any more (`bends`): instead of the matrix
    exponential there is a Runge-Kutta method then.
    """
    changes: dict[str, Any] = {}
    if any(u.kind in ("walk", "matrix") for u in unknowns):
        changes["noise"] = FreeNoise(tuple(unknowns)).varied(estimator.assumed[0], model)
    stand_in = estimator.varied(parameters=bends)
    chosen = stand_in.chosen(model, dt)
    if chosen is not None:
        if bends and chosen.scheme == "exact":
            given = dataclasses.replace(chosen, scheme="auto", substeps="auto")
            chosen = explicit(given, lambda: stand_in.modes(model), dt=dt)
        changes["integrator"] = chosen
    return dataclasses.replace(stand_in, **changes)
