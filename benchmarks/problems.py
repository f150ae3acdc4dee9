"""The problems that are timed: models, recordings and estimators."""

import dataclasses
import functools

import casadi as ca
import numpy as np
import xarray as xr

from backsight.discrete.noise import random_walk
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Recursion
from backsight.estimators import EKF, MHO, Noise, Prior
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman import UKF
from backsight.estimators.linear_windows import LinearMHE
from backsight.estimators.observers import AHG, AdaptiveGain
from backsight.estimators.scaled import Setting, setting
from backsight.models.augment import augment
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures.second_order import second_order
from backsight.run.estimation import match
from backsight.run.simulation import simulate, simulate_closed_loop
from backsight.signals.profiles import punch_strokes
from backsight.solvers.box import GaussNewton
from backsight.types import Array
from benchmarks import two_masses
from benchmarks.stage import DT, HEUN, HORIZON, NOISE, PRIOR, STEPPING, joint_model, stage

PUNCH_SAMPLES = 8000
"""Samples of the recording of the punch."""

TWICE = GaussNewton(max_iterations=2, tolerance=0.0)
"""Two Gauss-Newton iterations, always: the same work for every engine."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """An estimator, its model, and data.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    recording : xarray.Dataset
    """

    estimator: AbstractEstimator
    model: Model
    recording: xr.Dataset

    @functools.cached_property
    def recursion(self) -> Recursion:
        """The estimator compiled for the model."""
        return self.estimator.compile(self.model, float(self.recording.attrs["dt"]))

    @functools.cached_property
    def data(self) -> list[Array]:
        """Inputs, outputs and mask, one row per sample."""
        return list(match(self.model, self.recording))

    @functools.cached_property
    def setting(self) -> Setting:
        """Model, noise and prior in scaled variables."""
        noise, prior = self.estimator.noise, self.estimator.prior
        return setting(self.model, float(self.recording.attrs["dt"]), noise=noise, prior=prior)


def observer(
    optimiser: GaussNewton = TWICE, *, N: int = HORIZON, integrator: Integrator = HEUN
) -> Problem:
    """The moving horizon observer of the stage: 6 states, window of 15 samples, alpha = 1."""
    mho = MHO(
        NOISE,
        PRIOR,
        N=N,
        alpha=1.0,
        integrator=integrator,
        covariance="ode",
        optimiser=optimiser,
        bands="filters",
    )
    return Problem(mho, joint_model(), stage())


def observer_of(ekf: EKF) -> MHO:
    """The observer with the noise, prior and integrator of a filter."""
    return MHO(
        ekf.noise,
        ekf.prior,
        N=HORIZON,
        integrator=ekf.integrator,
        optimiser=TWICE,
        bands="filters",
    )


def stage_filter(covariance: str = "ode", *, integrator: Integrator = HEUN) -> Problem:
    """The extended Kalman filter of the stage: 6 states, 8 sub-steps."""
    noise = STEPPING if covariance == "discrete" else NOISE
    ekf = EKF(noise, PRIOR, integrator=integrator, covariance=covariance)
    return Problem(ekf, joint_model(), stage())


def free_stage_filter() -> Problem:
    """The same without bounds and with Q added once per sample, which other libraries offer, too.

    The output is scaled by its noise: dynamax adds 1e-9 to the covariance of the innovation.
    """
    model = joint_model()
    free = dataclasses.replace(
        model,
        states=tuple(dataclasses.replace(s, lower=-np.inf, upper=np.inf) for s in model.states),
        outputs=tuple(dataclasses.replace(s, scale=None) for s in model.outputs),
    )
    return Problem(EKF(STEPPING, PRIOR, integrator=HEUN, covariance="discrete"), free, stage())


MASS, DAMPING, STIFFNESS = 125.0, 1500.0, 20e3
FRICTION = 30.0
"""Amplitude of the known friction of the punch [N]; its slope is 50 s/m."""


def friction(v: ca.SX) -> ca.SX:
    """Known friction force [N] of the speed [m/s]."""
    return FRICTION * ca.tanh(50.0 * v)


@functools.cache
def punch() -> xr.Dataset:
    """Simulated recording of the punch with the soft spring, at 10 kHz."""
    wanted = punch_strokes().at(np.arange(PUNCH_SAMPLES) * DT)
    bandwidth = 200.0
    k1 = MASS * bandwidth**2 - STIFFNESS
    k2 = 1.6 * bandwidth * MASS - DAMPING
    return simulate_closed_loop(
        _punch_model({"m": MASS, "c": STIFFNESS, "d": DAMPING}),
        lambda x, r: [
            MASS * r.a + DAMPING * r.v + STIFFNESS * r.q + friction(r.v)
            + k1 * (r.q - x.q) + k2 * (r.v - x.v)
        ],
        {"q": wanted.position, "v": wanted.velocity, "a": wanted.acceleration},
        dt=DT,
        x0={"q": wanted.position[0]},
        sigma_y=1e-6,
        seed=0,
    )  # fmt: skip


def _punch_model(parameters: dict[str, float]) -> Model:
    return Model(
        f=lambda x, u, p: [x.v, (u.F - p.c * x.q - p.d * x.v - friction(x.v)) / p.m],
        h=lambda x, _u, _p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={name: Signal(value=value) for name, value in parameters.items()},
        name="punch",
    )


def punch_observer(*, adaptive: bool) -> Problem:
    """The adaptive high-gain observer of the punch, with fixed gain or with adaptive gain.

    The gain adapts in a window of 40 ms and is evaluated anew every millisecond.
    """
    wrong = {"c": 1.8 * STIFFNESS, "d": 1.8 * DAMPING, "m": 1.8 * MASS}
    model = augment(_punch_model(wrong), list(wrong))
    noise = Noise(sigma_y=1e-6, sigma_w={s.name: 0.0 for s in model.states})
    prior = Prior(sigma_x0={"q": 2e-3, "v": 0.1, "c": 2e4, "d": 2e3, "m": 1e2})
    # For 1/m, c/m, d/m, from the nominal model and its motion.
    Gamma = np.array(
        [
            [1.594256478e-06, -1.147962778, 2.392360265e-03],
            [-1.147962778, 5.097035675e06, -1.722472741e03],
            [2.392360265e-03, -1.722472741e03, 7.248940414e02],
        ]
    )
    gain = AdaptiveGain(lower=100.0, gamma=6e-7, beta=3e7, window=0.04, every=1e-3)
    ahg = AHG(
        noise,
        prior,
        gain=1000.0,
        Gamma=Gamma,
        adaptive=gain if adaptive else None,
        integrator=Integrator("rk4", 2),
    )
    return Problem(ahg, model, punch())


def punch_filter() -> Problem:
    """The unscented Kalman filter of the punch: 5 states, 4 Heun sub-steps, no bounds."""
    scales = {"c": STIFFNESS, "d": DAMPING, "w": 1 / MASS}
    start = {"c": 1.8, "d": 1.8, "w": 1 / 1.8}
    plant = Model(
        f=lambda x, u, p: [x.v, (u.F - p.c * x.q - p.d * x.v - friction(x.v)) * p.w],
        h=lambda x, _u, _p: [x.q],
        states={"q": Signal("m", scale=1e-3), "v": Signal("m/s", scale=0.1)},
        inputs={"F": "N"},
        outputs={"y": Signal("m", scale=1e-3)},
        parameters={n: Signal(value=start[n] * s, scale=s) for n, s in scales.items()},
        name="punch",
    )
    model = augment(plant, list(scales))
    size = np.array([1e-3, 0.1, *scales.values()])
    noise = Noise(
        R=np.array([[1e-12]]), Q=DT * np.diag((np.array([0, 0.1, 0.05, 0.05, 0.05]) * size) ** 2)
    )
    prior = Prior(P0=np.diag((np.array([2.0, 0.1, 0.8, 0.8, 0.8]) * size) ** 2))
    return Problem(UKF(noise, prior, integrator=Integrator("heun", 4)), model, punch())


def masses(*, unknown_force: bool, missing: float = 0.0) -> Problem:
    """Least-squares estimator of the lecture's two masses: 4 states, window of 21 samples.

    With an unknown force on the second mass, which switches between its bounds, as fifth state;
    and with a share of the samples missing.
    """
    sigma_w = {"d": 0.3 * two_masses.FORCE} if unknown_force else 0.0
    mhe = LinearMHE(Noise(two_masses.SENSOR, sigma_w), Prior(1.0), N=20)
    recording = two_masses.recorded(unknown_force=unknown_force, missing=missing)
    return Problem(mhe, two_masses.model(unknown_force=unknown_force), recording)


def chain(masses: int = 30, *, samples: int = 1000) -> Problem:
    """Extended Kalman filter of a row of masses and springs: 2 states for every mass."""
    K = 400.0 * (2 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1))
    M = np.eye(masses)
    model = second_order(
        M,
        0.1 * M + 0.002 * K,
        K,
        forces={"F": "q1"},
        inputs={"F": "N"},
        outputs={"first": ("displacement", "q1"), "last": ("displacement", f"q{masses}")},
        name="chain",
    )
    dt = 2e-3
    noise = Noise(sigma_y=1e-3, Qc=random_walk(np.full(model.nx, 1e-2), dt=dt))
    ekf = EKF(noise, Prior(0.1), integrator=Integrator("heun", 1))
    return Problem(ekf, model, _noisy(model, dt, samples))


def dense(states: int = 60, *, samples: int = 1000) -> Problem:
    """Extended Kalman filter of a discrete-time model in which every state moves every other."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((states, states))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    model = lti(
        A,
        rng.standard_normal((states, 1)),
        rng.standard_normal((2, states)),
        states={f"x{i}": "" for i in range(states)},
        inputs={"u": ""},
        outputs={"y1": "", "y2": ""},
        dt=1.0,
        name="dense",
    )
    noise = Noise(R=0.01 * np.eye(2), Q=0.01 * np.eye(states))
    ekf = EKF(noise, Prior(P0=np.eye(states)), covariance="discrete", gain="exact")
    return Problem(ekf, model, _noisy(model, 1.0, samples))


def _noisy(model: Model, dt: float, samples: int) -> xr.Dataset:
    inputs = np.random.default_rng(0).standard_normal((samples, model.nu))
    return simulate(model, inputs, dt=dt, sigma_y=1e-3, seed=0, substeps=2)
