"""The cantilever of Kirchner et al. (2018), section 4: what struck it, and what was measured."""

import numpy as np
from scipy.linalg import expm

from backsight.estimators import CompressiveSensingMHE, Noise, Prior
from backsight.estimators.arrival import SmoothedArrival
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures.beam import beam

DT, SAMPLES, N = 1 / 400, 61, 10
NODES = 0.125 + 0.04 * np.arange(8)
FORCES = tuple(f"F{i}" for i in range(8))
HITS = {(12, 7): -10.0, (24, 6): -5.0, (36, 4): 5.0, (48, 1): 10.0}

PROBLEM = f"""
[recording]
path = "beam.csv"
dt = {DT}
outputs = {{ s1 = "s1", s2 = "s2", s3 = "s3" }}

[model]
kind = "beam"
length = 0.405
width = 0.025
thickness = 0.003
youngs_modulus = 65.9e9
density = 7502
damping = [0.030, 0.037, 0.119]
sensors.s1 = {{ kind = "displacement", at = 0.245 }}
sensors.s2 = {{ kind = "displacement", at = 0.325 }}
sensors.s3 = {{ kind = "displacement", at = 0.405 }}
forces = {{ {", ".join(f"{name} = {x:.3f}" for name, x in zip(FORCES, NODES, strict=True))} }}

[prior]
sigma_x0 = {{ q1 = 1e-5, q2 = 1e-5, q3 = 1e-5, q1_dot = 1e-3, q2_dot = 1e-3, q3_dot = 1e-3 }}

[noise]
sigma_y = {{ s1 = 1e-5, s2 = 1e-5, s3 = 1e-5 }}
"""
"""The beam of 3 mm as a problem file, to which estimators are added."""


def model(thickness: float) -> Model:
    places = (0.245, 0.325, 0.405)
    return beam(
        0.405,
        width=0.025,
        thickness=thickness,
        youngs_modulus=65.9e9,
        density=7502.0,
        damping=[0.030, 0.037, 0.119],
        sensors={f"s{i + 1}": ("displacement", x) for i, x in enumerate(places)},
        forces=dict(zip(FORCES, NODES, strict=True)),
    )


def matrices(thickness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B of the eight forces, and C in discrete time."""
    A, B, C, _ = state_space(forces_as_inputs(model(thickness), FORCES))
    grown = expm(DT * np.block([[A, B], [np.zeros((8, 14))]]))
    return grown[:6, :6], grown[:6, 6:], C


def forces() -> np.ndarray:
    """(samples, 8)."""
    d = np.zeros((SAMPLES, 8))
    for place, size in HITS.items():
        d[place] = size
    return d


def measured() -> np.ndarray:
    """Outputs (samples, 3) of the beam of 3 mm."""
    (A, B, C), x, rows = matrices(0.003), np.zeros(6), []
    for d in forces():
        rows.append(C @ x)
        x = A @ x + B @ d
    return np.array(rows)


def estimator(thickness: float, *, eps_Q: float, eps_R: float, lam: float) -> CompressiveSensingMHE:
    """The paper's, with output at the first sample of the window."""
    B = matrices(thickness)[1]
    return CompressiveSensingMHE(
        Noise(sigma_y=eps_R**0.5),
        Prior(P0=eps_Q * B @ B.T),
        forces=FORCES,
        lam=lam,
        N=N,
        sigma_force=eps_Q**0.5,
        arrival=SmoothedArrival(naive=True),
        threshold=1.0,
        bias="kept",
    )
