"""A nanopositioning stage whose payload is taken off: its simulation, and what is estimated.

After Poloni, Eielsen, Rohal-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics with
plant uncertainties in nanopositioning system estimation", ACC 2012, section VI.
"""

import dataclasses
import functools
import math

import numpy as np
import xarray as xr

from backsight.discrete.noise import random_walk
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import Noise, Prior
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.simulation import simulate
from backsight.schema import recording
from backsight.signals import bandpass, filtered, prbs
from backsight.types import Array

DT = 1e-4
"""Sampling period [s]."""

SAMPLES = 4000
"""Of a recording."""

PRE_ROLL, REMOVAL = 2000, 2000
"""Samples before the recording, in which transients fade, and sample of it at the removal."""

HORIZON = 15
"""Sampling periods: one period of oscillation."""

SIGMA_W = {"q": 1e-2, "v": 1e2, "k": 1e4, "b": 5e-2, "c": 1e3, "w": 1e4}
NOISE = Noise(sigma_y=1e-3, Qc=random_walk([*SIGMA_W.values()], dt=DT))
"""The paper's: it acts all the time."""

STEPPING = Noise(sigma_y=1e-3, sigma_w=SIGMA_W)
"""As much, once per sample."""

PRIOR = Prior(sigma_x0={"q": 1.0, "v": 1e3, "k": 1e6, "b": 1.0, "c": 1e5, "w": 1.0})
HEUN = Integrator("heun", substeps=8)

TRUTH = {"q": "um", "v": "um/s", "w": "um/s2", "k": "1/s2", "b": "1/s", "c": "um/s2/V"}
"""Name and unit of what is known of a recording."""


def _plant() -> Model:
    return Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.V],
        h=lambda x, _u, _p: [x.q],
        states={"q": "um", "v": "um/s"},
        inputs={"V": "V"},
        outputs={"y": "um"},
        parameters={n: Signal(unit=TRUTH[n], value=v) for n, v in _per_mass(423.0, 0.0146).items()},
        name="stage, simulated",
    )


def _per_mass(frequency: float, damping: float) -> dict[str, float]:
    omega = 2 * math.pi * frequency
    stiffness = omega**2
    # The actuator's force is the same before and after, so c/m changes like k/m.
    gain = 5.4e5 * stiffness / (2 * math.pi * 423.0) ** 2
    return {"k": stiffness, "b": 2 * damping * omega, "c": gain}


def _removal_force(time: Array) -> Array:
    """Unknown force per mass [um/s2]: a half-sine pulse of 3 ms at the removal, then constant."""
    since = time - (PRE_ROLL + REMOVAL) * DT
    # Rounding of the time must not put the first sample after the removal before it.
    gone = since > -1e-9
    pulse = np.where(since < 3e-3, 2e5 * np.sin(math.pi * since / 3e-3), 0.0)
    return np.where(gone, 2e4 + pulse, 0.0)


@functools.cache
def stage(seed: int = 0) -> xr.Dataset:
    """Simulated recording at 10 kHz, everything but the parameters behind a band-pass filter."""
    n = PRE_ROLL + SAMPLES
    raw = simulate(
        _plant(),
        prbs(n, seed=seed, samples_per_bit=5, amplitude=1.5),
        dt=DT,
        changes={(PRE_ROLL + REMOVAL) * DT: _per_mass(483.0, 0.0143)},
        disturbances={"v": _removal_force},
        sigma_y=1e-3,
        seed=1000 + seed,
    )
    truth = {str(n): raw["x_true"].sel(state=n).values for n in raw["state"].values}
    truth["w"] = _removal_force(raw["time"].values)
    u, y = raw["u"].values, raw["y"].values
    b, a = bandpass(DT, damping=0.1)
    seen = np.column_stack([u, y, truth["q"], truth["v"], truth["w"]])
    u, y, q, v, w = filtered(seen, b=b, a=a)[PRE_ROLL:].T
    made = recording(
        np.arange(SAMPLES) * DT,
        u=u[:, np.newaxis],
        y=y[:, np.newaxis],
        inputs={"V": "V"},
        outputs={"y": "um"},
        dt=DT,
    )
    known = np.column_stack([q, v, w, *(truth[name][PRE_ROLL:] for name in ("k", "b", "c"))])
    made["x_true"] = (("time", "state"), known)
    return made.assign_coords(state=list(TRUTH), state_unit=("state", list(TRUTH.values())))


def joint_model() -> Model:
    """Oscillator whose parameters and force are states, scaled: 6 states."""
    oscillator = Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.V],
        h=lambda x, _u, _p: [x.q],
        states={"q": Signal("um", scale=5.0), "v": Signal("um/s", scale=1e4)},
        inputs={"V": Signal("V", scale=5.0)},
        outputs={"y": Signal("um", scale=5.0)},
        parameters={
            "k": Signal("1/s2", value=6e6, scale=7e6, lower=0.0),
            "b": Signal("1/s", value=70.0, scale=70.0, lower=0.0),
            "c": Signal("um/s2/V", value=5e5, scale=8e5, lower=0.0),
        },
        name="stage",
    )
    joint = augment(oscillator, ["k", "b", "c"], disturbances={"w": "v"})
    *others, force = joint.states
    return dataclasses.replace(joint, states=(*others, dataclasses.replace(force, scale=1e5)))
