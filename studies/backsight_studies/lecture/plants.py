"""The two plants of the study and their simulated motions."""

import dataclasses

import numpy as np
import xarray as xr

from backsight import schema
from backsight.discrete.exact import zoh
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array

A = np.array([[0.9, 0.2], [-0.1, 0.8]])
B = np.array([[0.1], [1.0]])
C = np.array([[1.0, 0.0]])

EXAMPLE = lti(
    A, B, C, states={"x1": "", "x2": ""}, inputs={"u": ""}, outputs={"y": ""}, dt=1.0,
    name="two states",
)  # fmt: skip

DT = 0.05
"""Sampling period of the two masses [s]."""

STIFFNESS, DAMPING = 40.0, 0.4
"""Of both springs [N/m] and dampers [N s/m]; the masses are 1 kg."""

FORCE = 1.0
"""Largest size of the unknown force on the second mass [N]."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """States (n, nx), inputs (n, nu) and noise-free outputs (n, ny)."""

    x: Array
    u: Array
    y: Array

    def recording(self, model: Model, y: Array) -> xr.Dataset:
        """Recording of measured outputs; NaN is not measured."""
        dt = model.dt or 1.0
        return schema.recording(
            dt * np.arange(len(y)),
            u=self.u,
            y=y,
            inputs={s.name: s.unit for s in model.inputs},
            outputs={s.name: s.unit for s in model.outputs},
            dt=dt,
        )


def two_masses(*, unknown_force: bool) -> Model:
    """Wall, spring, mass, spring, mass; a motor pushes the first mass, whose place is measured.

    An unknown force on the second mass is the fifth state ``d``, held between the samples and
    bounded by `FORCE`.
    """
    a, b, d = _matrices()
    states: dict[str, object] = {"q1": "m", "q2": "m", "v1": "m/s", "v2": "m/s"}
    if unknown_force:
        a = np.block([[a, d], [np.zeros((1, 4)), np.ones((1, 1))]])
        b = np.vstack([b, np.zeros((1, 1))])
        states["d"] = Signal("N", lower=-FORCE, upper=FORCE)
    return lti(
        a, b, np.eye(1, len(a)), states=states, inputs={"F": "N"}, outputs={"y": "m"}, dt=DT,
        name="two masses",
    )  # fmt: skip


def _matrices() -> tuple[Array, Array, Array]:
    """Transition, response to the motor, response to the force on the second mass."""
    coupling = np.array([[2.0, -1.0], [-1.0, 1.0]])
    continuous = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS * coupling, -DAMPING * coupling]]
    )
    a, b = zoh(continuous, np.eye(4)[:, 2:], dt=DT)
    return a, b[:, :1], b[:, 1:]


def example_motion(n: int, *, rng: np.random.Generator, load: Array | None = None) -> Motion:
    """The two-state example under a random staircase and an unknown load beside it."""
    u = np.repeat(rng.standard_normal(n // 8 + 1), 8)[:n, None]
    unknown = np.zeros((n, 1)) if load is None else load[:, None]
    return _respond(A, B, u + unknown, u, C)


def masses_motion(n: int, *, rng: np.random.Generator, force: float) -> Motion:
    """The two masses under a known random motor force and one that switches between +-force.

    States ``q1, q2, v1, v2``, and ``d`` if there is such a force.
    """
    a, b, d = _matrices()
    u = np.repeat(2 * rng.standard_normal(n // 10 + 1), 10)[:n, None]
    switched = force * np.repeat(rng.choice([-1.0, 1.0], n // 40 + 1), 40)[:n, None]
    motion = _respond(a, np.hstack([b, d]), np.hstack([u, switched]), u, np.eye(1, 4))
    return Motion(np.hstack([motion.x, switched]), u, motion.y) if force else motion


def _respond(a: Array, b: Array, acting: Array, known: Array, c: Array) -> Motion:
    x, states = np.zeros(len(a)), []
    for push in acting:
        states.append(x)
        x = a @ x + b @ push
    found = np.array(states)
    return Motion(found, known, found @ c.T)


def every(m: int, y: Array) -> Array:
    """Keep every m-th sample; the others are not measured."""
    kept = np.full_like(y, np.nan)
    kept[::m] = y[::m]
    return kept
