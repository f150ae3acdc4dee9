"""The example of an extension, installed beside the package and used from outside."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError, TuningError
from backsight.testing import assert_close, check_estimator, check_model, check_reader
from extensions.distributions import install_project
from relations.linear import DT, GAUSSIANS, P0, X0, A, B, C, Q, R, Run, model, record

PROJECT = Path(__file__).parents[2] / "examples" / "extension"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = install_project(PROJECT, tmp_path_factory.mktemp("site"))
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))


@pytest.fixture
def hinf(site):
    from backsight_example.hinf import HInfinity

    return HInfinity


def test_a_problem_file_uses_all_of_it_in_a_process_of_its_own(site, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "backsight", "run", PROJECT / "problem.toml", "-o", tmp_path / "o"],
        env={**os.environ, "PYTHONPATH": str(site), "COLUMNS": "100"},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stderr == ""
    assert "H-infinity" in done.stdout
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert summary["problem"]["samples"] == 600
    assert (tmp_path / "o" / "report.html").exists()
    text = json.dumps(summary)
    assert "NaN" not in text


def test_the_length_is_found(site):
    from backsight.problem import load
    from backsight.problem.recorded import recording_of

    problem = load(PROJECT / "problem.toml")
    data = recording_of(problem)
    assert int(np.isnan(data["y"]).sum()) == 20
    results = bs.compare(problem.estimators, problem.model, data)
    for result in results.values():
        last = result.sel(state="length").isel(time=-1)
        assert abs(float(last["x_hat"]) - 0.4) < 3 * float(last["x_std"]) < 0.01


def test_it_is_listed(site, backsight):
    code, printed, told = backsight("methods")
    assert (code, told) == (0, "")
    assert "# H-infinity filter (from backsight-example 0.1.0)" in printed
    assert '# [model] kind = "pendulum" (from backsight-example 0.1.0)' in printed
    assert '# [recording] path = "....blk" (from backsight-example 0.1.0)' in printed
    assert "swing: The length of a pendulum from its swing\n" in backsight("study", "list")[1]


def test_its_study_runs(site, backsight, tmp_path):
    code, printed, _ = backsight("study", "run", "swing", "-o", tmp_path / "s", "--seeds", "1")
    assert code == 0
    assert "length: 0.4" in printed or "length: 0.39" in printed
    assert (tmp_path / "s" / "index.html").exists()


def test_the_filter_keeps_the_contract(hinf):
    check_estimator(hinf, holds=["zoh"])


def test_theta_zero_is_the_extended_kalman_filter(hinf):
    u, y = record(60, seed=1, missing=0.3)
    expected = Run(bs.EKF(**GAUSSIANS), model(), DT)(u, y)
    for name, values in Run(hinf(**GAUSSIANS, theta=0.0), model(), DT)(u, y).items():
        assert_close(values, expected[name], 1e-13)


@pytest.mark.parametrize("theta", [0.01, 0.3])
def test_on_a_linear_model_it_is_the_recursion_of_the_book(hinf, theta):
    """Simon (2006), eq. 11.89: one recursion for the prediction, with explicit inverses."""
    u, y = record(40, seed=2, missing=0.0)
    result = Run(hinf(**GAUSSIANS, theta=theta), model(), DT)(u, y)
    S, x, P = np.diag(1 / np.diag(P0)), X0, P0
    for k in range(len(y)):
        inverse = np.linalg.inv(np.eye(3) - theta * S @ P + C.T @ np.linalg.inv(R) @ C @ P)
        K = P @ inverse @ C.T @ np.linalg.inv(R)
        x_post, P_post = x + K @ (y[k] - C @ x), P @ inverse
        np.testing.assert_allclose(result["x_hat"][k], x_post, rtol=0, atol=1e-10)
        np.testing.assert_allclose(result["P"][k], P_post, rtol=0, atol=1e-10)
        x, P = A @ x_post + B @ u[k], A @ P_post @ A.T + Q


def test_a_bound_that_cannot_be_kept_says_so(hinf):
    u, y = record(5, seed=3, missing=0.0)
    walks = {**GAUSSIANS, "noise": bs.Noise(R=R, Q=100 * Q + 10 * np.eye(3))}
    result = Run(hinf(**walks, theta=0.9), model(), DT)(u, y)
    assert int(bs.extend.Status.NOT_POSITIVE_DEFINITE) in result["status"].astype(int)
    assert np.all(np.isfinite(result["x_hat"]))
    with pytest.raises(TuningError, match="theta is 1"):
        hinf(**GAUSSIANS, theta=1.0)


def test_reader_and_model_keep_theirs(site, tmp_path):
    from backsight_example.logger import read_blk, write_blk
    from backsight_example.pendulum import pendulum

    check_model(pendulum(0.4))
    check_reader(read_blk, PROJECT / "swing.blk", columns=["t_ms", "motor", "aside_mm"])
    path = tmp_path / "a.blk"
    write_blk(path, {"a": np.array([1.5, np.nan])}, {"a": 0.5})
    np.testing.assert_array_equal(read_blk(path, ["a"])["a"], [1.5, np.nan])
    for content, message in ((b"other", "no file of a block"), (path.read_bytes()[:-1], "cut off")):
        path.write_bytes(content)
        with pytest.raises(DataError, match=message):
            read_blk(path, ["a"])
