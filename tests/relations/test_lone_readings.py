"""An outlier that was believed is named, for every estimator, and a rule keeps it away."""

import dataclasses

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.schema import Status
from backsight.testing import CASES

N, AT = 160, 80
TOLD = "unlike the readings around it, first at t = 1.6 s: an outlier that was believed"


def verdict(key: str, spike: float, **noise) -> tuple[str, xr.Dataset]:
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, bs.Integrator("rk4", 1))
    estimator = dataclasses.replace(estimator, noise=dataclasses.replace(estimator.noise, **noise))
    data = problem.simulate(N, seed=3, hold="zoh", noisy=True)
    data.y[AT, 0] += spike * 1e-2
    recording = data.recording(problem.model)
    found = bs.compare({key: estimator}, problem.model, recording, engine="vm", throw=False)
    return found.verdicts()[-1], found[key]


@pytest.mark.parametrize("key", ["ekf", "kf"])
@pytest.mark.parametrize("spike", [30.0, -1e4])
def test_it_is_named_with_its_sample(key, spike):
    told, _ = verdict(key, spike)
    assert "'position' has a reading up to" in told
    assert TOLD in told


def test_nothing_is_said_without_one_or_with_a_rule():
    assert TOLD not in verdict("ekf", 0.0)[0]
    told, result = verdict("ekf", 1e6, outliers=bs.settings.Gate())
    assert TOLD not in told
    assert abs(float(result["x_hat"][-1, 2]) - 150.0) < 4 * float(result["x_std"][-1, 2])


def test_a_signal_of_impacts_is_no_outlier():
    """Many readings that are alone are what the sensor measures, and the model's to explain."""
    problem = CASES["kf"].problem
    estimator = CASES["kf"].build(problem, bs.Integrator("rk4", 1))
    data = problem.simulate(N, seed=3, hold="zoh", noisy=True)
    data.y[5::9, 0] += 0.5
    recording = data.recording(problem.model)
    found = bs.compare({"kf": estimator}, problem.model, recording, engine="vm", throw=False)
    assert TOLD[:30] not in found.verdicts()[-1]


@pytest.mark.parametrize("spike", [1e12, 1e50])
def test_no_covariance_is_indefinite_without_a_word(spike):
    """After an outlier beyond all reason an iterated filter linearises far away."""
    _, result = verdict("iekf", spike)
    P, status = result["P"].values, result["status"].values.astype(int)
    for k in np.flatnonzero(np.isfinite(P).all(axis=(1, 2))):
        size = np.sqrt(np.abs(np.diag(P[k])))
        size[size == 0] = 1
        if np.linalg.eigvalsh(P[k] / np.outer(size, size))[0] < -1e-9:
            assert status[k] & int(Status.NOT_POSITIVE_DEFINITE)
