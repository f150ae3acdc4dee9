"""The struck cantilever of the compressive-sensing paper, its mistaken models, and its weights.

After Kirchner, Croes, Cosco, Desmet, "Exploiting input sparsity for joint state/input moving
horizon estimation", 2018, section 4, Tables 1 to 3; doi:10.1016/j.ymssp.2017.08.024.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.discrete.exact import zoh
from backsight.estimators import Noise, Prior
from backsight.estimators.arrival import SmoothedArrival
from backsight.estimators.cs_mhe import Carryover, CompressiveSensingMHE
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures.beam import beam
from backsight.schema import recording
from backsight.types import Array

DT = 2.5e-3
"""Sampling period [s]."""

SAMPLES = 61
"""Length of the recording: the last hit passes through a whole window."""

N = 10
"""Horizon in transitions: the paper's window of 11 samples."""

LENGTH, FIRST = 0.405, 0.125
"""Of the beam, and the place next to its clamp at which a force may act [m]."""

SENSORS = {"s1": 0.245, "s2": 0.325, "s3": 0.405}
"""Places of the displacement sensors [m]."""

NODES = tuple(round(FIRST + 0.04 * i, 3) for i in range(8))
"""Places at which a force may act [m]."""

FORCES = tuple(f"F{i}" for i in range(len(NODES)))
"""Names of the forces at these places."""

DAMPING = (0.030, 0.037, 0.119)
"""Of the modes, as shares of the critical one."""

THICKNESS = {0.0: 3.0e-3, -3.3: 2.9e-3, -6.7: 2.8e-3, -10.0: 2.7e-3}
"""Mismatch of the frequencies in percent to the thickness that a model assumes [m]."""

HITS = ((7, -10.0), (6, -5.0), (4, 5.0), (1, 10.0))
"""Number of the place and size [N] of the hits of Table 2."""

APART = 12
"""Steps before the first hit, and from one hit to the next."""


@dataclasses.dataclass(frozen=True)
class Weights:
    """Weights of the cost.

    Parameters
    ----------
    eps_Q : float
        Variance of the forces in the background [N2].
    lam : float
        Weight of the l1 norm [1/N].
    eps_R : float
        Variance of the sensors [m2].
    """

    eps_Q: float
    lam: float
    eps_R: float = math.exp(5) * 1e-10


TABLE = {
    0.0: Weights(math.exp(2) * 1e-2, math.exp(15) * 1e-10),
    -3.3: Weights(math.exp(5) * 1e-2, math.exp(19.5) * 1e-10),
    -6.7: Weights(math.exp(11) * 1e-2, math.exp(14.5) * 1e-10),
    -10.0: Weights(math.exp(11) * 1e-2, math.exp(15) * 1e-10),
}
"""Mismatch to the values of Table 3."""


def model(mismatch: float, places: Sequence[float] = NODES) -> Model:
    """Three modes of the cantilever; every place may be struck, forces ``F0``, ``F1``, ..."""
    return beam(
        LENGTH,
        width=0.025,
        thickness=THICKNESS[mismatch],
        youngs_modulus=65.9e9,
        density=7502.0,
        damping=DAMPING,
        sensors={name: ("displacement", x) for name, x in SENSORS.items()},
        forces={f"F{i}": x for i, x in enumerate(places)},
        name="cantilever",
    )


@functools.cache
def sampled(mismatch: float) -> tuple[Array, Array, Array]:
    """A, B of all places, and C from sample to sample."""
    of = model(mismatch)
    A, B, C, _ = state_space(forces_as_inputs(of, tuple(p.name for p in of.parameters)))
    A, B = zoh(A, B, dt=DT)
    return A, B, C


def struck(hits: Sequence[tuple[int, float]] = HITS, samples: int = SAMPLES) -> xr.Dataset:
    """Record the true beam, which rests at first, without noise; a hit lasts for one step."""
    A, B, C = sampled(0.0)
    d = np.zeros((samples, len(NODES)))
    for i, (place, size) in enumerate(hits, 1):
        d[APART * i, place] = size
    x = np.zeros((samples, len(A)))
    for k in range(samples - 1):
        x[k + 1] = A @ x[k] + B @ d[k]
    return recording(
        DT * np.arange(samples),
        u=np.zeros((samples, 0)),
        y=x @ C.T,
        inputs={},
        outputs=dict.fromkeys(SENSORS, "m"),
        dt=DT,
    )


def estimator(mismatch: float) -> CompressiveSensingMHE:
    """The estimator with the values of Table 3, complete Algorithm 1, output at k = T - N + 1."""
    weights, B = TABLE[mismatch], sampled(mismatch)[1]
    return CompressiveSensingMHE(
        Noise(sigma_y=math.sqrt(weights.eps_R)),
        Prior(P0=weights.eps_Q * B @ B.T),
        forces=tuple(f"F{i}" for i in range(len(NODES))),
        lam=weights.lam,
        N=N,
        sigma_force=math.sqrt(weights.eps_Q),
        arrival=SmoothedArrival(naive=True),
        carryover=Carryover((100.0, 1000.0), "separate"),
        threshold=1.0,
        bias="kept",
    )
