"""Hits by compressive-sensing moving horizon estimation.

The estimator is linear: it needs signals of sensors without a limit.
"""

import dataclasses
import math

import numpy as np
import xarray as xr

import backsight as bs
from backsight import schema
from backsight.analysis.forces import Impact, find_impacts
from backsight.models.views.sensors import Sensor, with_sensors
from backsight.types import Array
from backsight_studies.frame_hammer.rig import DT, HEIGHTS, SENSORS, Axis
from backsight_studies.frame_hammer.straight import slow

FORCES = {f"F{100 * z:.0f}": z for z in HEIGHTS}
"""Unknown force to its height [m]."""

TWIST = "twist"
"""One more unknown force: not a hit, but what a hit beside the axis does besides."""

HORIZON = 20
"""Transitions of a window."""

PULSES = (2, 3)
"""Widths of the half-sine pulses [samples]."""

SIGMA_Y, SIGMA_FORCE = 0.5, 1.0
"""Of the straightened signals [m/s2], and of small forces everywhere all the time [N]."""

LARGEST = 100.0
"""Raw acceleration of a mode that is expected at the start [m/s2]."""

SHARE = 0.4
"""The weight lam is this share of the one from which on nothing would be found at all."""

SMALLEST = 0.15
"""Hits below this share of the largest one are none."""

GHOST = 0.3
"""A force at another height at the same time below this share of the largest is not a hit."""


@dataclasses.dataclass(frozen=True)
class Sparse:
    """Result of the estimator.

    Parameters
    ----------
    result : xarray.Dataset
    hits : tuple of Impact
        Forces of neighbouring steps joined, without the twist.
    lam, lam_max : float
        The weight [1/N] and the one from which on nothing is found.
    """

    result: xr.Dataset
    hits: tuple[Impact, ...]
    lam: float
    lam_max: float


def model(axis: Axis) -> bs.Model:
    """The modes below half the sampling frequency, seen through the low-pass of the sensors."""
    few = axis.only(slow(axis))
    forces = {name: few.driven[i] for i, name in enumerate(FORCES)}
    structure = bs.modal(
        few.frequencies,
        damping=few.damping,
        sensors={f"a{j + 1}": ("acceleration", few.seen[:, j]) for j in range(len(SENSORS))},
        forces={**forces, TWIST: np.eye(few.modes)[-1]},
    )
    slow_sensor = Sensor(cutoff=axis.cutoff)
    return with_sensors(structure, {s.name: slow_sensor for s in structure.outputs})


def sparse(axis: Axis, values: Array) -> Sparse:
    """Find hits in accelerations (n, 4) [m/s2] of sensors without a limit."""
    rig, signals = model(axis), recording(values)
    blind = bs.estimate(_estimator(axis, math.inf), rig, signals)
    lam_max = float(blind["lam_max"].max())
    result = bs.estimate(_estimator(axis, SHARE * lam_max), rig, signals)
    return Sparse(result, _hits(result), SHARE * lam_max, lam_max)


def _hits(result: xr.Dataset) -> tuple[Impact, ...]:
    """Forces joined over time, without the twist and without what is too small to be a hit."""
    found = [hit for hit in find_impacts(result, gap=2, ghost=GHOST) if hit.place != TWIST]
    largest = max((abs(hit.impulse) for hit in found), default=0.0)
    return tuple(hit for hit in found if abs(hit.impulse) >= SMALLEST * largest)


def recording(values: Array) -> xr.Dataset:
    """Accelerations (n, 4) as a recording without inputs."""
    return schema.recording(
        DT * np.arange(len(values)),
        u=np.zeros((len(values), 0)),
        y=values,
        inputs={},
        outputs={f"a{j + 1}": "m/s2" for j in range(len(SENSORS))},
        dt=DT,
    )


def _estimator(axis: Axis, lam: float) -> bs.CompressiveSensingMHE:
    few = axis.only(slow(axis))
    omega = 2 * np.pi * np.array(few.frequencies)
    start = np.concatenate([LARGEST / omega**2, LARGEST / omega, np.full(len(SENSORS), LARGEST)])
    return bs.CompressiveSensingMHE(
        noise=bs.Noise(sigma_y=SIGMA_Y),
        prior=bs.Prior(P0=np.diag(start**2)),
        forces=(*FORCES, TWIST),
        lam=lam,
        N=HORIZON,
        sigma_force=SIGMA_FORCE,
        dictionary=bs.forces.HalfSines(PULSES),
        bias="kept",
    )
