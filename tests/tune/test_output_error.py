"""Parameters of a simulation of the whole recording, beside those that predict the next sample."""

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import TuningError
from backsight.tune import Simulation, fit

DT, N = 0.1, 600
LAG = bs.Model(
    f=lambda x, u, p: [p.a * (p.c * u.u - x.x)],
    h=lambda x, _u, _p: [x.x],
    states={"x": "1"},
    inputs={"u": "1"},
    outputs={"y": "1"},
    parameters={"a": 0.5, "c": 1.5},
)
PRIOR = bs.Prior(sigma_x0=0.5)


def simulated(a, c, x0, u):
    """First-order lag with a held input, exactly."""
    pole = np.exp(-a * DT)
    return scipy.signal.lfilter([0.0, c * (1 - pole)], [1.0, -pole], u, zi=[x0])[0]


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.standard_normal(N // 20), 20)
    y = simulated(0.8, 2.0, 0.3, u) + 0.2 * rng.standard_normal(N)
    return bs.from_arrays(dt=DT, u=u[:, None], y=y[:, None], inputs={"u": "1"}, outputs={"y": "1"})


def test_output_error_is_the_least_squares_fit_of_a_simulation(recording):
    ekf = bs.EKF(bs.Noise(sigma_y=0.1, sigma_w=1e-3), PRIOR)
    free = [bs.tune.Free(n, spread=float("inf")) for n in ("a", "c", "sigma_y")]
    free.append(bs.tune.Free("x0", sigma=100.0))
    found = fit(ekf, LAG, recording, free=free, criterion=Simulation(), check=False)
    u, y = recording["u"].values[:, 0], recording["y"].values[:, 0]
    best = scipy.optimize.least_squares(lambda p: simulated(*p, u) - y, [0.5, 1.5, 0.0])
    for name, value in zip(("a", "c", "x0.x"), best.x, strict=True):
        assert found.values[name] == pytest.approx(value, abs=1e-2 * found.std[name] + 1e-5)
    rms = np.sqrt(2 * best.cost / N)
    assert found.values["sigma_y.y"] == pytest.approx(rms, rel=1e-3)
    # The standard deviations are those of least squares, but for how they are estimated.
    covariance = np.linalg.inv(best.jac.T @ best.jac) * rms**2
    assert found.std["a"] == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.3)


def test_parameters_that_simulate_badly_are_told(recording):
    trusting = bs.EKF(bs.Noise(sigma_y=0.01, sigma_w=0.2), PRIOR)
    found = fit(trusting, LAG, recording, free=["a", "c"])
    told = [d for d in found.doubts if "a simulation with these parameters misses y" in d]
    assert len(told) == 1
    right = fit(trusting, LAG, recording, free=["a", "c", "sigma_y", "sigma_w"])
    assert not any("simulation" in d for d in right.doubts)


def test_a_simulation_has_no_process_noise(recording):
    ekf = bs.EKF(bs.Noise(sigma_y=0.1, sigma_w=1e-3), PRIOR)
    with pytest.raises(TuningError, match="a simulation has no process noise"):
        fit(ekf, LAG, recording, free=["a", "sigma_w"], criterion=Simulation())
