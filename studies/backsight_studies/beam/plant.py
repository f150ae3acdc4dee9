"""The cantilever of section 4, its mistaken models, and what strikes it."""

import dataclasses
import functools

import numpy as np
import xarray as xr

from backsight.discrete.exact import zoh
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures.beam import beam
from backsight.run.simulation import measured_recording
from backsight.types import Array

DT = 2.5e-3
"""Sampling period [s]."""

SAMPLES = 61
"""Length of the recording: the last hit passes through a whole window."""

N = 10
"""Horizon in transitions: the paper's window of 11 samples."""

LENGTH, WIDTH, DENSITY, YOUNGS_MODULUS = 0.405, 0.025, 7502.0, 65.9e9
DAMPING = (0.030, 0.037, 0.119)
SENSORS = {"s1": 0.245, "s2": 0.325, "s3": 0.405}
"""Places of the displacement sensors [m]."""

NODES = tuple(round(0.125 + 0.04 * i, 3) for i in range(8))
"""Places at which a force may act [m]."""

FORCES = tuple(f"F{i}" for i in range(len(NODES)))

THICKNESS = {0.0: 3.0e-3, -3.3: 2.9e-3, -6.7: 2.8e-3, -10.0: 2.7e-3}
"""Mismatch of the frequencies in percent to the thickness that a model assumes [m]."""


@dataclasses.dataclass(frozen=True)
class Hit:
    """A force that acts from one sample to the next.

    Parameters
    ----------
    step, node : int
        Sample at which it begins, and number of the place.
    size : float
        [N].
    """

    step: int
    node: int
    size: float


HITS = (Hit(12, 7, -10.0), Hit(24, 6, -5.0), Hit(36, 4, 5.0), Hit(48, 1, 10.0))
"""Table 2."""


def model(thickness: float) -> Model:
    """Three modes of the cantilever; every node may be struck."""
    return beam(
        LENGTH,
        width=WIDTH,
        thickness=thickness,
        youngs_modulus=YOUNGS_MODULUS,
        density=DENSITY,
        damping=DAMPING,
        sensors={name: ("displacement", x) for name, x in SENSORS.items()},
        forces=dict(zip(FORCES, NODES, strict=True)),
        name=f"cantilever of {1e3 * thickness:g} mm",
    )


def frequencies(thickness: float) -> Array:
    """Of the three modes [Hz]."""
    A, _, _, _ = state_space(model(thickness))
    modes = len(A) // 2
    return np.sqrt(-np.diag(A[modes:, :modes])) / (2 * np.pi)


@functools.cache
def sampled(thickness: float) -> tuple[Array, Array, Array]:
    """A, B of all nodes, and C from sample to sample."""
    A, B, C, _ = state_space(forces_as_inputs(model(thickness), FORCES))
    A, B = zoh(A, B, dt=DT)
    return A, B, C


def forces(hits: tuple[Hit, ...] = HITS, samples: int = SAMPLES) -> Array:
    """Forces at all steps and nodes (samples, nodes) [N]."""
    d = np.zeros((samples, len(NODES)))
    for hit in hits:
        d[hit.step, hit.node] += hit.size
    return d


def struck(d: Array, *, sigma: float = 0.0, seed: int = 0) -> xr.Dataset:
    """Simulate the recording of the true beam, which rests at first.

    Parameters
    ----------
    d : (samples, nodes) array
        Forces, held from sample to sample [N].
    sigma : float
        Standard deviation of the noise of every sensor [m].
    seed : int
        Of the noise.
    """
    A, B, C = sampled(THICKNESS[0.0])
    x = np.zeros((len(d), len(A)))
    for k in range(len(d) - 1):
        x[k + 1] = A @ x[k] + B @ d[k]
    return measured_recording(
        model(THICKNESS[0.0]),
        dt=DT,
        u=np.zeros((len(d), 0)),
        x=x,
        y=x @ C.T,
        z=np.zeros((len(d), 0)),
        parameters=d,
        sigma=np.full(len(SENSORS), sigma),
        seed=seed,
    )
