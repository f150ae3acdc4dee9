"""Two masses in a row: wall, spring, mass, spring, mass; the place of the first one is measured."""

import numpy as np
import xarray as xr

from backsight.discrete.exact import zoh
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.schema import recording
from backsight.types import Array

DT = 0.05
"""Sampling period [s]."""

SAMPLES = 2000
"""Of a recording."""

STIFFNESS, DAMPING = 40.0, 0.4
"""Of both springs [N/m] and dampers [N s/m]; the masses are 1 kg."""

FORCE = 1.0
"""Largest size of the unknown force on the second mass [N]."""

SENSOR = 2e-3
"""Standard deviation of the measured place [m]."""


def model(*, unknown_force: bool) -> Model:
    """A motor pushes the first mass.

    An unknown force on the second mass is the fifth state ``d``, held between the samples and
    bounded by `FORCE`.
    """
    a, b, d = _matrices()
    states: dict[str, object] = {"q1": "m", "q2": "m", "v1": "m/s", "v2": "m/s"}
    if unknown_force:
        a = np.block([[a, d], [np.zeros((1, 4)), np.ones((1, 1))]])
        b = np.vstack([b, np.zeros((1, 1))])
        states["d"] = Signal("N", lower=-FORCE, upper=FORCE)
    C = np.eye(1, len(a))
    return lti(
        a, b, C, states=states, inputs={"F": "N"}, outputs={"y": "m"}, dt=DT, name="two masses"
    )


def recorded(*, unknown_force: bool, missing: float = 0.0) -> xr.Dataset:
    """Record the masses under a known random motor force and one that switches between +-`FORCE`.

    Parameters
    ----------
    unknown_force : bool
        Whether there is the second force.
    missing : float
        Share of the samples that are missing.
    """
    rng = np.random.default_rng(0)
    a, b, d = _matrices()
    u = np.repeat(2 * rng.standard_normal(SAMPLES // 10 + 1), 10)[:SAMPLES, None]
    force = FORCE if unknown_force else 0.0
    switched = force * np.repeat(rng.choice([-1.0, 1.0], SAMPLES // 40 + 1), 40)[:SAMPLES, None]
    x, y = np.zeros(4), np.zeros((SAMPLES, 1))
    response, acting = np.hstack([b, d]), np.hstack([u, switched])
    for k in range(SAMPLES):
        y[k] = x[:1]
        x = a @ x + response @ acting[k]
    y += SENSOR * rng.standard_normal(y.shape)
    y[rng.random(y.shape) < missing] = np.nan
    time = DT * np.arange(SAMPLES)
    return recording(time, u=u, y=y, inputs={"F": "N"}, outputs={"y": "m"}, dt=DT)


def _matrices() -> tuple[Array, Array, Array]:
    """Transition, response to the motor, response to the force on the second mass."""
    coupling = np.array([[2.0, -1.0], [-1.0, 1.0]])
    continuous = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS * coupling, -DAMPING * coupling]]
    )
    a, b = zoh(continuous, np.eye(4)[:, 2:], dt=DT)
    return a, b[:, :1], b[:, 1:]
