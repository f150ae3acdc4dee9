"""Without weight on the window the moving horizon observer is the extended filter, to the bit."""

import dataclasses

import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF, MHO
from backsight.schema import Status
from backsight.testing import DT as PERIOD
from backsight.testing import TrialProblem, simulated
from oracles.stage import DT as STAGE_DT
from oracles.stage import HEUN, NOISE, PRIOR, joint, recording
from relations.linear import DT, GAUSSIANS, Run, model, record

SAME = ("x_hat", "P", "y_hat", "e", "S")


def assert_same(observer: MHO, system, dt: float, u: np.ndarray, y: np.ndarray) -> None:
    expected, result = filtered(observer, system, dt, u, y), Run(observer, system, dt)(u, y)
    assert np.all(np.isfinite(expected["x_hat"]))
    for name in SAME:
        np.testing.assert_array_equal(result[name], expected[name], err_msg=name)
    np.testing.assert_array_equal(result["status"], expected["status"])


def filtered(observer: MHO, system, dt: float, u: np.ndarray, y: np.ndarray) -> dict:
    """What the extended Kalman filter of the same settings gives."""
    filter_ = EKF(observer.noise, observer.prior, observer.integrator, observer.covariance)
    return Run(filter_, system, dt)(u, y)


@pytest.mark.parametrize("covariance", ["transition", "ode", "discrete"])
@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("gaps", [False, True])
def test_continuous_model(hold, covariance, gaps):
    data, problem = simulated(60, seed=1, hold=hold, noisy=True), TrialProblem()
    if gaps:
        data.y[:3] = data.y[20:30] = np.nan
        data.y[::2, 1] = np.nan
    observer = MHO(
        problem.noise,
        problem.prior,
        N=6,
        alpha=0.0,
        integrator=Integrator("rk4", 2, hold),
        covariance=covariance,
    )
    assert_same(observer, problem.model, PERIOD, data.u, data.y)


@pytest.mark.parametrize("missing", [0.0, 0.5])
def test_discrete_model(missing):
    u, y = record(50, seed=2, missing=missing)
    assert_same(MHO(**GAUSSIANS, N=4, alpha=0.0), model(), DT, u, y)


def test_bounds_that_clip():
    data, N = simulated(80, seed=3, hold="zoh", noisy=True), 5
    problem = TrialProblem(k_bounds=(100.0, 130.0))
    observer = MHO(problem.noise, problem.prior, N=N, alpha=0.0)
    arguments = problem.model, PERIOD, data.u, data.y
    expected, result = filtered(observer, *arguments), Run(observer, *arguments[:2])(*arguments[2:])
    for name in SAME:
        np.testing.assert_array_equal(result[name], expected[name], err_msg=name)
    assert (expected["status"] == Status.CLIPPED).any()
    np.testing.assert_array_equal(result["status"], expected["status"])


def test_stage_with_the_tuning_of_the_paper():
    u, _, y = recording(120, seed=4)
    observer = MHO(NOISE, PRIOR, N=15, alpha=0.0, integrator=HEUN, covariance="ode")
    assert_same(observer, joint(), STAGE_DT, u[:, None], y[:, None])


def test_some_weight_makes_a_difference():
    """The equality above is not one of two estimators that ignore their window."""
    u, y = record(30, seed=5, missing=0.0)
    none = MHO(**GAUSSIANS, N=4, alpha=0.0)
    some = dataclasses.replace(none, alpha=1e-3)
    difference = Run(some, model(), DT)(u, y)["x_hat"] - Run(none, model(), DT)(u, y)["x_hat"]
    assert np.all(difference[:4] == 0)
    assert np.all(np.abs(difference[4:]).max(axis=1) > 0)
