"""Sensors that could be added to a model, and which of them would show what is hidden."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from backsight.models.model import Model
from backsight.models.signals import Named, Signal
from backsight.types import Array

Sensor = Callable[[Named, Named, Named], Any]
"""``(x, u, p)`` to the output of a sensor that could be added, as in `Model`."""


def repairs(
    model: Model,
    candidates: Mapping[str, Sensor] | None,
    basis: Array,
    unseen: Callable[[Model], Array],
) -> tuple[str, ...]:
    """Names of the candidates any one of which leaves nothing unseen.

    Parameters
    ----------
    model : Model
    candidates : dict, optional
        Name to sensor; every state by itself if not given.
    basis : (nx, d) array
        What is not seen now.
    unseen : callable
        Model to what is not seen with it.
    """
    if not basis.shape[1]:
        return ()
    given = candidates or {s.name: _state(s.name) for s in model.states}
    return tuple(
        name for name, sensor in given.items() if not unseen(with_sensor(model, sensor)).shape[1]
    )


def _state(name: str) -> Sensor:
    return lambda x, *_: x[name]


def with_sensor(model: Model, sensor: Sensor) -> Model:
    """Model with one more output."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    kinds = (("state", model.states, x), ("input", model.inputs, u))
    named = [Named(kind, [s.name for s in of], v) for kind, of, v in kinds]
    named.append(Named("parameter", [s.name for s in model.parameters], p))
    rows = ca.vertcat(model.h.call([x, u, p])[0], sensor(*named))
    return dataclasses.replace(
        model,
        h=ca.Function("h", [x, u, p], [rows]),
        outputs=(*model.outputs, Signal(name=f"sensor_{len(model.outputs)}")),
    )
