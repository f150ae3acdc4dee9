"""A reading that cannot be: an estimator comes back by itself, or says from when on it is lost."""

import dataclasses
import functools

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.schema import Status
from backsight.testing import CASES
from backsight.testing.problem import Data

N, AT = 240, 60
SIGMA = np.array([1e-2, 1e-1])
LOST = int(Status.MISLED | Status.NOT_FINITE)
SPIKES = (10.0, 1e2, 1e3, -1e4, 1e6, 1e12, 1e50, 1e150, 1e300)
FAST = [("ekf", 1e3), ("mhe", -1e4), ("ahg", 1e6), ("luenberger", 1e50)]
REMEMBERING = ("ekf", "iekf", "ukf", "mho", "mhe", "ahg")


@functools.lru_cache
def clean(key: str) -> Data:
    return CASES[key].problem.simulate(N, seed=3, hold="zoh", noisy=True)


def estimated(key: str, y: np.ndarray, *, restart: bool = False, **noise) -> xr.Dataset:
    case = CASES[key]
    estimator = case.build(case.problem, bs.Integrator("rk4", 1))
    if noise:
        changed = dataclasses.replace(estimator.assumed[0], **noise)
        estimator = dataclasses.replace(estimator, noise=changed)
    data = clean(key)
    recording = Data(data.u, data.x, y).recording(case.problem.model)
    return bs.estimate(
        estimator, case.problem.model, recording, engine="vm", throw=False, restart=restart
    )


def spiked(key: str, spike: float) -> np.ndarray:
    y = clean(key).y.copy()
    y[AT, 0] += spike * SIGMA[0]
    return y


def burst(key: str, size: float, seed: int) -> np.ndarray:
    y = clean(key).y.copy()
    shape = (20, y.shape[1])
    y[AT : AT + 20] += (
        size * SIGMA[: y.shape[1]] * np.random.default_rng(seed).standard_normal(shape)
    )
    return y


def deviations(key: str, result: xr.Dataset) -> np.ndarray:
    """Errors of the last ten samples in standard deviations; infinite if they are no numbers."""
    truth = clean(key).x[-10:, : result.sizes["state"]]
    with np.errstate(all="ignore"):
        z = np.abs(result["x_hat"].values[-10:] - truth) / result["x_std"].values[-10:]
    return np.where(np.isfinite(z), z, np.inf)


def told(result: xr.Dataset) -> np.ndarray:
    return (result["status"].values.astype(int) & LOST) > 0


EVERY = [
    pytest.param(key, spike, marks=() if (key, spike) in FAST else pytest.mark.slow)
    for key in sorted(CASES)
    for spike in SPIKES
]


@pytest.mark.parametrize(("key", "spike"), EVERY)
def test_after_a_spike_it_comes_back_or_says_so_and_starts_anew_if_asked(key, spike):
    found = estimated(key, spiked(key, spike))
    assert deviations(key, found).max() < 6 or told(found)[-10:].all()
    assert not told(found)[:AT].any() or found.attrs["estimator"] == "csmhe"
    again = estimated(key, spiked(key, spike), restart=True)
    assert deviations(key, again).max() < 6
    assert not told(again)[-10:].any()


@pytest.mark.slow
@pytest.mark.parametrize("key", sorted(CASES))
@pytest.mark.parametrize("size", [1e3, 1e6])
@pytest.mark.parametrize("seed", range(5))
def test_after_a_burst_it_comes_back_or_says_so_and_starts_anew_if_asked(key, size, seed):
    y = burst(key, size, seed)
    found = estimated(key, y)
    assert deviations(key, found).max() < 6 or told(found)[-10:].all()
    assert deviations(key, estimated(key, y, restart=True)).max() < 6


@pytest.mark.slow
@pytest.mark.parametrize("key", sorted(CASES))
def test_what_was_not_measured_or_stands_still_is_no_such_reading(key):
    y = clean(key).y
    gap, stuck, jump = (y.copy() for _ in range(3))
    gap[:] = np.nan
    stuck[AT : AT + 3] = stuck[AT]
    jump[AT : AT + 5] = 5e-324
    for changed in (y, gap, stuck, jump):
        found = estimated(key, changed)
        assert not told(found).any()
        np.testing.assert_array_equal(
            found["x_hat"], estimated(key, changed, restart=True)["x_hat"]
        )


@pytest.mark.parametrize("key", ["ekf"])
def test_it_is_said_from_the_reading_on_and_in_words(key):
    y = spiked(key, 1e4)
    found = estimated(key, y)
    misled = (found["status"].values.astype(int) & int(Status.MISLED)) > 0
    assert misled.tolist() == [False] * AT + [True] * (N - AT)
    assert not told(estimated(key, y, outliers=bs.settings.Gate())).any()
    case = CASES[key]
    recording = Data(clean(key).u, clean(key).x, y).recording(case.problem.model)
    estimator = case.build(case.problem, bs.Integrator("rk4", 1))
    compared = bs.compare({key: estimator}, case.problem.model, recording, engine="vm")
    assert "from t = 1.2 s on its constants are worthless" in compared.verdicts()[-1]


@pytest.mark.parametrize("restart", [False, True])
def test_a_stream_says_the_same(restart):
    key = "ekf"
    case, y = CASES[key], spiked(key, 1e4)
    batch = estimated(key, y, restart=restart)
    estimator = case.build(case.problem, bs.Integrator("rk4", 1))
    live = bs.stream(estimator, case.problem.model, 0.02, engine="vm", restart=restart)
    for k in range(AT + 5):
        sample = live.step(clean(key).u[k], y[k])
        assert int(sample["status"]) & int(Status.MISLED) == int(batch["status"][k]) & int(
            Status.MISLED
        )
        np.testing.assert_array_equal(sample["x_hat"], batch["x_hat"][k])


def test_constants_that_walk_forget():
    """With process noise of its own the stiffness finds back, and nothing is said."""
    walk = {"q": 1e-3, "v": 2e-2, "k": 5.0}
    found = estimated("ekf", spiked("ekf", 1e3), R=None, sigma_y=SIGMA, sigma_w=walk)
    assert not told(found).any()
    assert deviations("ekf", found).max() < 6


def test_a_sensor_without_noise_of_what_is_known_is_no_measure():
    """Its innovation has the variance 0; that of the other sensor still counts."""
    same = {"states": {"a": ""}, "inputs": {}, "outputs": {"exact": "", "noisy": ""}}
    model = bs.lti([[1.0]], np.zeros((1, 0)), [[1.0], [1.0]], dt=1.0, **same)
    ekf = bs.EKF(bs.Noise(sigma_y={"exact": 0.0, "noisy": 1.0}), bs.Prior(sigma_x0=1.0))
    y = np.zeros((9, 2))
    y[4:, 0], y[7, 1] = 1e-3, 1e13
    recording = bs.from_arrays(y=y, dt=1.0, inputs={}, outputs=same["outputs"])
    status = bs.estimate(ekf, model, recording, engine="vm", throw=False)["status"].values
    misled = (status.astype(int) & int(Status.MISLED)) > 0
    assert misled.tolist() == [False] * 7 + [True] * 2
