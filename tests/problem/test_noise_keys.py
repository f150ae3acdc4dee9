"""Keys of [noise] for outliers, noisy inputs and noise in common, up to summary and report."""

import json

import numpy as np
import pytest

import small_problem
from backsight.errors import ProblemError
from backsight.problem import load, run_problem

NOISE = "sigma_y = { y = 1e-4 }"
GATE = 'outliers = { kind = "StudentT", nu = 3.0, patience = 30 }'


@pytest.fixture
def write(tmp_path):
    """Write a problem file with other keys of [noise] and three samples that do not belong."""

    def _write(keys):
        path = small_problem.write(tmp_path, small_problem.changed(NOISE, f"{NOISE}\n{keys}"))
        lines = (tmp_path / "spring.csv").read_text(encoding="utf-8").splitlines()
        for k in (51, 101, 151):
            cells = lines[k].split(",")
            lines[k] = ",".join([*cells[:-1], "0.9"])
        (tmp_path / "spring.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return _write


def test_outliers_are_counted_where_people_look(write, tmp_path):
    results = run_problem(load(write(GATE)), tmp_path / "out", progress=lambda *_: None)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    sentence = "3 of 200 samples of y were weighed down as outliers"
    for name in ("EKF", "MHO"):
        doubted = np.flatnonzero(results[name]["weight"][:, 0] < 0.5)
        assert doubted.tolist() == [50, 100, 150]
        entry = summary["estimators"][name]
        assert entry["outliers"] == {"y": {"count": 3, "samples": 200, "opened": 0}}
        assert sentence in entry["verdict"]
        assert abs(entry["final"]["k"]["error"]) < 3 * entry["final"]["k"]["std"]
    assert sentence in page


def test_noise_of_inputs_and_in_common(write):
    keys = "sigma_u = { u = 0.1 }\nsigma_w = { v = 1e-3 }\ncross = [[0], [5e-8], [0], [0]]"
    noise = load(write(keys)).estimators["EKF"].assumed[0]
    assert noise.sigma_u == {"u": 0.1}
    assert np.array_equal(noise.cross[:, 0], [0, 5e-8, 0, 0])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ('outliers = { kind = "Gates" }', r"noise.outliers.kind: unknown kind 'Gates'"),
        ("outliers = { nu = 3.0 }", r"noise.outliers.nu: unknown key"),
        ("outliers = { probability = 2.0 }", r"noise.outliers: .*probability is 2.0"),
        ("sigma_u = { F = 0.1 }", r"noise: sigma_u names 'F'"),
        ("sigma_p = { m = 0.1 }", r"noise: sigma_p names 'm'"),
    ],
)
def test_wrong_keys_are_named(write, keys, message):
    with pytest.raises(ProblemError, match=message):
        load(write(keys))
