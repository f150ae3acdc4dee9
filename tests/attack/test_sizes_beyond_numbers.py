"""Values whose squares are no numbers: one sentence, never a warning of NumPy or a traceback."""

import numpy as np
import pytest
import xarray as xr

import backsight as bs
import small_problem
from backsight.analysis.comparison import summary
from backsight.analysis.consistency._noise_factors import FilterPath, noise_factors
from backsight.analysis.forces import find_impacts
from backsight.data import from_arrays
from backsight.errors import BacksightError, ModelError
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.uncertainty import Noise, Prior
from backsight.forces import moving_load
from backsight.models.lti import lti
from backsight.models.structures import beam, reduced
from backsight.problem import load, run_problem
from backsight.schema import Status


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("sigma = 30.0", "sigma = 30.0, scale = 1e200", r"estimators\.EKF: 'k' is of the size"),
        ("sigma = 30.0", "sigma = 30.0, scale = 1e-200", "'k' is of the size 1e-200"),
        ("q = 0.01,", "q = 1e200,", "sigma_x0 is too large"),
        (
            "y = 1e-4",
            "y = 1e-200",
            "sigma_y is too small for its square",
        ),
    ],
)
def test_sizes_of_signals(tmp_path, old, new, says):
    path = small_problem.write(tmp_path, small_problem.changed(old, new))
    with pytest.raises(BacksightError, match=says):
        run_problem(load(path), tmp_path / "out", progress=lambda *_: None)
    assert not (tmp_path / "out").exists()


def test_limits_whose_size_is_no_number(tmp_path):
    limit = 'kind = "mhe"\nlimits = [{ name = "far", weights = { q = 1e200 }, lower = -1.0 }]\n'
    path = small_problem.write(tmp_path, small_problem.changed('kind = "mho"\n', limit))
    with pytest.raises(BacksightError, match="limit 'far' has weights"):
        run_problem(load(path), tmp_path / "out", progress=lambda *_: None)


@pytest.mark.parametrize("last", [1e308, 1e12, 3.0 + 1e-12])
def test_a_path_that_is_none(last):
    places = {"F1": 1.0, "F2": 2.0, "F3": 3.0, "F4": last}
    plain = beam(
        length=5.0, width=0.1, thickness=0.1, youngs_modulus=1e9, density=1e3, modes=1,
        sensors={"y": ("displacement", 1.0)}, forces={f"F{k}": float(k) for k in range(1, 5)},
    )  # fmt: skip
    with pytest.raises(ModelError, match=r"'P' moves along places .* no path"):
        moving_load(plain, "P", position="s", along=places)


def test_a_mass_that_is_too_small_to_be_one():
    with pytest.raises(ModelError, match="its diagonal is from 1e-100 to 1; a coordinate without"):
        reduced(
            np.diag([1.0, 1e-100]), [[2000.0, -1000.0], [-1000.0, 1000.0]], modes=2,
            damping=0.01, sensors={"y": ("displacement", 1)},
        )  # fmt: skip


@pytest.mark.parametrize("size", [1e150, 1e200, 1e300])
def test_a_recording_beyond_numbers_has_a_status_and_a_verdict(size):
    n = 60
    y = np.zeros((n, 1))
    y[n // 2 :] = size * np.cos(np.arange(n // 2))[:, None]
    recording = from_arrays(y=y, dt=0.1, inputs={}, outputs={"y": "m"})
    model = lti(
        [[0.0, 1.0], [-1.0, -0.1]], B=np.zeros((2, 0)), C=[[1.0, 0.0]],
        inputs={}, states={"q": "m", "v": "m/s"}, outputs={"y": "m"},
    )  # fmt: skip
    kf = KalmanFilter(Noise(sigma_y=1e-3, sigma_w=[1e-3, 1e-3]), Prior(1.0))
    result = bs.estimate(kf, model, recording, throw=False, engine="vm")
    assert (result.status.values[n // 2 :] & Status.NOT_FINITE.value).any()
    assert summary(result)["verdict"].startswith("diverged")


def test_noise_factors_of_innovations_beyond_numbers_are_unknown():
    n, one = 60, np.ones((60, 1, 1))
    path = FilterPath(
        F=one, H=one, P=one, e=np.full((n, 1), 1e300), S=1e-300 * one, Q=one, R=np.eye(1)
    )
    assert np.isnan(noise_factors(path).R)


def test_hits_of_an_estimate_that_diverged():
    d = np.full((4, 1), 1e308)
    result = xr.Dataset(
        {"d_hat": (("time", "force"), d), "d_std": (("time", "force"), d)},
        coords={"time": 0.1 * np.arange(4), "force": ["F"]}, attrs={"dt": 0.1},
    )  # fmt: skip
    assert len(find_impacts(result)) == 1
