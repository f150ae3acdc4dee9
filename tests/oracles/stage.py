"""The nanopositioning stage of Polóni et al. (ACC 2012) and its tuning, sections VI.C and VI.D."""

import dataclasses

import numpy as np
from scipy.linalg import expm

from backsight.discrete.noise import random_walk
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import Noise, Prior
from backsight.estimators.scaled import Setting, setting
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal

DT = 1e-4
SCALES = np.array([5.0, 1e4, 7e6, 70.0, 8e5, 1e5])
SU, SY = 5.0, 5.0
SIGMA_W = np.array([1e-2, 1e2, 1e4, 5e-2, 1e3, 1e4])
SIGMA_X0 = np.array([1.0, 1e3, 1e6, 1.0, 1e5, 1.0])
X0 = np.array([0.0, 0.0, 6e6, 70.0, 5e5, 0.0])
SIGMA_Y = 1e-3
NOISE = Noise(sigma_y=SIGMA_Y, Qc=random_walk(SIGMA_W, dt=DT))
PRIOR = Prior(sigma_x0=SIGMA_X0)
HEUN = Integrator("heun", 8)


def joint() -> Model:
    """q'' = -(k/m) q - (b/m) q' + (c/m) u + w with k/m, b/m, c/m and w as states."""
    q, v, k, b, c, w = SCALES
    plant = Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.V],
        h=lambda x, u, p: [x.q],
        states={"q": Signal("um", scale=q), "v": Signal("um/s", scale=v)},
        inputs={"V": Signal("V", scale=SU)},
        outputs={"y": Signal("um", scale=SY)},
        parameters={
            "k": Signal("1/s2", X0[2], scale=k, lower=0.0),
            "b": Signal("1/s", X0[3], scale=b, lower=0.0),
            "c": Signal("um/s2/V", X0[4], scale=c, lower=0.0),
        },
    )
    model = augment(plant, ["k", "b", "c"], disturbances={"w": "v"})
    *rest, disturbance = model.states
    return dataclasses.replace(model, states=(*rest, dataclasses.replace(disturbance, scale=w)))


def scaled() -> Setting:
    """Model, noise and prior in the scaled variables of eq. 37-42."""
    return setting(joint(), DT, noise=NOISE, prior=PRIOR)


def recording(n: int, *, seed: int, k: float = 7.06e6) -> tuple[np.ndarray, ...]:
    """Input (n,), true states (n, 2) and noisy output (n,) under a random binary voltage.

    The exact solution of the linear plant with a constant force, held input.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.5, 1.5], n // 5 + 1), 5)[:n]
    A = np.array([[0.0, 1.0, 0.0, 0.0], [-k, -77.6, 5.4e5, 2e4], [0.0] * 4, [0.0] * 4])
    Phi = expm(A * DT)
    x, states = np.array([0.05, 100.0]), []
    for voltage in u:
        states.append(x)
        x = (Phi @ [*x, voltage, 1.0])[:2]
    truth = np.array(states)
    return u, truth, truth[:, 0] + SIGMA_Y * rng.standard_normal(n)
