"""The observer against an independent implementation, sample for sample."""

import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.estimators import MHO
from backsight.solvers.box import GaussNewton
from closeness import assert_close
from oracles.moving_horizon import Observer
from oracles.stage import DT, NOISE, PRIOR, SCALES, joint, recording

SAMPLES, N = 70, 6


@pytest.mark.parametrize("alpha", [1.0, 1e-4])
def test_observer_is_the_one_in_numpy_and_scipy(alpha):
    u, _, y = recording(SAMPLES, seed=3)
    reference = Observer(N=N, alpha=alpha, substeps=2).run(u, y)
    observer = MHO(
        NOISE,
        PRIOR,
        N=N,
        alpha=alpha,
        integrator=Integrator("heun", 2),
        covariance="ode",
        optimiser=GaussNewton(max_iterations=50, tolerance=1e-9),
        bands="filters",
    )
    recursion = observer.compile(joint(), DT)
    data = [u[:, None], y[:, None], np.ones((SAMPLES, 1))]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    result = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    assert not result["status"].any()
    assert_close(result["x_hat"] / SCALES, reference["x_hat"], 1e-6)
    assert_close(result["P"] / np.outer(SCALES, SCALES), reference["P"], 1e-6)
    assert_close(result["x_start"][N:] / SCALES, reference["x_start"][N:], 1e-6)
    assert result["iterations"][N:].min() >= 2
