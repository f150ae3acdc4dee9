"""Model, noise and prior of the paper's section VI, and the ways to solve the window."""

import dataclasses

import numpy as np

from backsight.discrete.noise import random_walk
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF, MHO, AbstractEstimator, Noise, Prior
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.solvers.box import GaussNewton, QuasiNewton
from backsight_studies.nanopositioner.plant import DT

SIGMA_Y = 1e-3
SIGMA_W = {"q": 1e-2, "v": 1e2, "k": 1e4, "b": 5e-2, "c": 1e3, "w": 1e4}
NOISE = Noise(sigma_y=SIGMA_Y, Qc=random_walk([*SIGMA_W.values()], dt=DT))
PRIOR = Prior(sigma_x0={"q": 1.0, "v": 1e3, "k": 1e6, "b": 1.0, "c": 1e5, "w": 1.0})
HEUN = Integrator("heun", substeps=8)

HORIZON = 15
"""Sampling periods; section VI.D says that this is one period of oscillation."""

ALPHA = {"MHOa": 1.0, "MHOb": 1e-4}
"""The two weights of the measurements in the window that the paper compares."""

TRUSTING = "EKF, R / 10"
RETUNED = "EKF, faster parameters"
CONVERGED = "converged"
PAPER_RULE = "paper's rule"
PAPER_RULE_NEWTON = "paper's rule, Gauss-Newton"

SOLVERS = {
    CONVERGED: GaussNewton(),
    PAPER_RULE: QuasiNewton(cost_tolerance=2e-5, step_tolerance=1e-6),
    PAPER_RULE_NEWTON: GaussNewton(cost_tolerance=2e-5, step_tolerance=1e-6),
}
"""To convergence; BFGS ended as in section VI.D; Gauss-Newton steps ended by the same rule."""


@dataclasses.dataclass(frozen=True)
class Variant:
    """An estimator of the study.

    Parameters
    ----------
    method : str
        "EKF", "MHOa", "MHOb", or what it is.
    solver : str
        Key of `SOLVERS`; "" for the EKF.
    estimator : AbstractEstimator
    """

    method: str
    solver: str
    estimator: AbstractEstimator

    @property
    def label(self) -> str:
        """Method and solver in one."""
        return f"{self.method}, {self.solver}" if self.solver else self.method


def joint_model() -> Model:
    """Oscillator whose parameters and force are states, scaled as in section VI.C (eq. 37)."""
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
        name="nanopositioning stage",
    )
    joint = augment(oscillator, ["k", "b", "c"], disturbances={"w": "v"})
    *others, force = joint.states
    return dataclasses.replace(joint, states=(*others, dataclasses.replace(force, scale=1e5)))


def ekf() -> Variant:
    """The paper's benchmark, with its covariance equation (eq. 14-16)."""
    return _ekf("EKF", NOISE)


def ekf_trusting() -> Variant:
    """The same, but it believes that the sensor has a tenth of its variance."""
    return _ekf(TRUSTING, dataclasses.replace(NOISE, sigma_y=SIGMA_Y / np.sqrt(10.0)))


def ekf_retuned() -> Variant:
    """The same, but its parameters may change faster."""
    faster = SIGMA_W | {"k": 1e5, "b": 1.0, "c": 1e4}
    return _ekf(RETUNED, dataclasses.replace(NOISE, Qc=random_walk([*faster.values()], dt=DT)))


def mho(method: str, solver: str) -> Variant:
    """The paper's observer with one of its two weights."""
    return Variant(method, solver, _mho(ALPHA[method], solver))


def mho_weighted(alpha: float) -> Variant:
    """The converged observer with any weight."""
    return Variant(f"MHO, alpha = {alpha:g}", CONVERGED, _mho(alpha, CONVERGED))


def _ekf(name: str, noise: Noise) -> Variant:
    return Variant(name, "", EKF(noise, PRIOR, integrator=HEUN, covariance="ode"))


def _mho(alpha: float, solver: str) -> MHO:
    return MHO(
        NOISE,
        PRIOR,
        N=HORIZON,
        alpha=alpha,
        integrator=HEUN,
        covariance="ode",
        optimiser=SOLVERS[solver],
        bands="filters",
    )
