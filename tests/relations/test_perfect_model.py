"""Methods that linearise follow noise-free data of a nonlinear model without any error."""

import dataclasses

import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF, MHO, Prior
from backsight.testing import DT, TrialProblem, simulated
from closeness import assert_close
from relations.linear import Run

METHODS = {"ekf": EKF, "mho": MHO}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("gap", [slice(0, 0), slice(0, 12), slice(50, 90)])
def test_exact_start(method, hold, gap):
    data, problem = simulated(120, seed=2, hold=hold, noisy=False), TrialProblem()
    data.y[gap] = np.nan
    prior = Prior(sigma_x0=problem.prior.sigma_x0, x0=data.x[0])
    estimator = METHODS[method](problem.noise, prior, integrator=Integrator("rk4", 1, hold))
    result = Run(estimator, problem.model, DT)(data.u, data.y)
    assert_close(result["x_hat"], data.x, 1e-12)
    assert np.abs(result["e"]).max() < 1e-12


def test_wrong_start_is_corrected():
    """Noise-free data, stiffness 20 % off, hardly any noise assumed: both methods find it."""
    data, problem = simulated(300, seed=3, hold="zoh", noisy=False), TrialProblem()
    certain = dataclasses.replace(problem.noise, R=1e-4 * problem.noise.R, sigma_w=1e-9)
    for method in METHODS.values():
        result = Run(method(certain, problem.prior), problem.model, DT)(data.u, data.y)
        np.testing.assert_allclose(result["x_hat"][-1], data.x[-1], rtol=2e-3, atol=1e-4)
