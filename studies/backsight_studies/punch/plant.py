"""The simulated punch: a mass on springs with friction, moved by a controller.

Table 1 of Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter
estimation: a comparison to extended and unscented Kalman filter", gives a mass of 125 kg, a damping
of 1500 N s/m and a stiffness of 20 kN/m, while its text speaks of a very stiff spring. Both the
printed value and 20 kN/mm are studied.
"""

import dataclasses
from collections.abc import Mapping

import casadi as ca
import numpy as np
import xarray as xr

from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.simulation import simulate_closed_loop
from backsight.signals import punch_strokes

DT = 1e-4
"""Sampling period [s]."""

PERIOD = punch_strokes().duration
"""Of the strokes [s]."""

SIGMA_Y = 1e-6
"""Noise of the position sensor [m]."""

MASS, DAMPING = 125.0, 1500.0
FRICTION, SHARPNESS = 30.0, 50.0
"""Coulomb friction [N], a tenth of the peak viscous force, and slope of its tanh [s/m]; known."""


@dataclasses.dataclass(frozen=True)
class Reading:
    """One of the two readings of Table 1.

    Parameters
    ----------
    name : str
    stiffness : float
        [N/m].
    bandwidth : float
        Of the position control [rad/s].
    """

    name: str
    stiffness: float
    bandwidth: float

    @property
    def truth(self) -> dict[str, float]:
        """Parameters of the plant."""
        return {"m": MASS, "c": self.stiffness, "d": DAMPING}


SOFT = Reading("soft", 20e3, 200.0)
STIFF = Reading("stiff", 20e6, 600.0)
READINGS = (SOFT, STIFF)


def punch(reading: Reading) -> Model:
    """Equation 20-21, with F/m in place of F (the printed eq. 21 lacks the division)."""
    return Model(
        f=lambda x, u, p: [x.v, (u.F - p.c * x.q - p.d * x.v - friction(x.v)) / p.m],
        h=lambda x, _u, _p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={
            "m": Signal("kg", reading.truth["m"]),
            "c": Signal("N/m", reading.truth["c"]),
            "d": Signal("N s/m", reading.truth["d"]),
        },
        name=f"punch, {reading.name} spring",
    )


def friction(v: ca.SX) -> ca.SX:
    """Force of the dry friction [N]."""
    return FRICTION * ca.tanh(SHARPNESS * v)


def simulate_punch(
    reading: Reading, *, seconds: float, changes: Mapping[float, Mapping[str, float]] | None = None
) -> xr.Dataset:
    """Move the punch along its strokes; the recording has no noise yet, see `with_noise`.

    The controller knows the parameters before any change. It feeds the force of the reference
    forward and the true state back: poles of the nominal loop at the bandwidth, damping 0.8.
    """
    time = np.arange(round(seconds / DT) + 1) * DT
    # A picosecond later than the sample, so that rounding never puts it before a corner.
    motion = punch_strokes().at(time + 1e-12)
    m, c, d = reading.truth.values()
    k_q, k_v = m * reading.bandwidth**2 - c, 1.6 * reading.bandwidth * m - d
    return simulate_closed_loop(
        punch(reading),
        lambda x, r: [
            m * r.a + d * r.v + c * r.q + friction(r.v) + k_q * (r.q - x.q) + k_v * (r.v - x.v)
        ],
        {"q": motion.position, "v": motion.velocity, "a": motion.acceleration},
        dt=DT,
        x0={"q": float(motion.position[0])},
        changes=changes,
    )


def with_noise(recording: xr.Dataset, seed: int, *, sigma: float = SIGMA_Y) -> xr.Dataset:
    """Add white noise to the measured position."""
    noise = sigma * np.random.default_rng(seed).standard_normal(recording["y"].shape)
    return recording.assign(y=recording["y"] + noise)


def excitation(recording: xr.Dataset, reading: Reading) -> dict[str, float]:
    """What every force contributes to the acceleration, root mean square [m/s2]."""
    x = recording["x_true"]
    q, v = (x.sel(state=name).values for name in ("q", "v"))
    terms = {
        "spring": reading.stiffness * q,
        "damper": DAMPING * v,
        "actuator": recording["u"].values[:, 0] - FRICTION * np.tanh(SHARPNESS * v),
    }
    return {name: float(np.sqrt(np.mean((f / MASS) ** 2))) for name, f in terms.items()}
