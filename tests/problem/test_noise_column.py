"""The noise of single samples in a problem file."""

import numpy as np
import pytest

import small_problem
from backsight.errors import DataError
from backsight.problem import load, run_problem
from backsight.problem.recorded import recording_of

COLUMN = '\nsigma_factor.y = { column = "sigma", factor = 1e4 }'
OUTPUTS = 'outputs.y = { column = "place", unit = "m" }'


@pytest.fixture
def write(tmp_path):
    """A problem whose sensor is three times as noisy in the second half."""

    def _write(text):
        path = small_problem.write(tmp_path, text)
        lines = (tmp_path / "spring.csv").read_text(encoding="utf-8").splitlines()
        sigma = np.where(np.arange(small_problem.SAMPLES) < 100, 1e-4, 3e-4)
        rows = [f"{line},{s!r}" for line, s in zip(lines[1:], sigma.tolist(), strict=True)]
        table = "\n".join([lines[0] + ",sigma", *rows, ""])
        (tmp_path / "spring.csv").write_text(table, encoding="utf-8")
        return path

    return _write


def test_a_column_with_the_standard_deviation(write, tmp_path):
    problem = load(write(small_problem.changed(OUTPUTS, OUTPUTS + COLUMN)))
    factor = np.repeat([1.0, 3.0], 100)[:, None]
    np.testing.assert_allclose(recording_of(problem).sigma_factor, factor)
    results = run_problem(problem, tmp_path / "out", progress=lambda *_: None)
    np.testing.assert_allclose(results["EKF"]["sigma_factor"], factor)
    assert results["EKF"]["S"].values[150, 0, 0] > 9e-8


def test_an_estimator_that_cannot_weigh_is_found_before_the_first_one_runs(write, tmp_path):
    text = small_problem.changed(OUTPUTS, OUTPUTS + COLUMN)
    text = text.replace('kind = "mho"\nN = 5', 'kind = "hgo"\ngain = 5.0')
    started = []
    with pytest.raises(DataError, match=r"High-gain observer cannot .*sigma_factor"):
        run_problem(load(write(text)), tmp_path / "out", progress=lambda *s: started.append(s))
    assert not started
