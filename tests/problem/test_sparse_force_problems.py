"""Sparse forces from a problem file."""

import numpy as np
import pytest
import xarray as xr

from backsight.errors import BacksightError
from backsight.problem import load, run_problem
from backsight.settings import NoArrival, SmoothedArrival
from oracles import struck_beam

FORCES = ", ".join(f'"{name}"' for name in struck_beam.FORCES)
PROBLEM = f"""{struck_beam.PROBLEM}
[estimators.CS]
kind = "csmhe"
forces = [{FORCES}]
lam = 0.3
sigma_force = {{ F0 = 0.05, F4 = 0.05 }}
threshold = 1.0
carryover = {{ drift = [100, 1000], age = 4 }}
dictionary = {{ kind = "HalfSines", widths = [1, 2] }}
"""


@pytest.fixture
def problem(tmp_path):
    rows = struck_beam.measured()
    np.savetxt(tmp_path / "beam.csv", rows, delimiter=",", header="s1,s2,s3", comments="")

    def read(text: str):
        (tmp_path / "problem.toml").write_text(text, encoding="utf-8")
        return load(tmp_path / "problem.toml")

    return read


def test_hits_are_found(problem, tmp_path):
    run_problem(problem(PROBLEM), tmp_path / "out", progress=lambda *_: None)
    with xr.open_dataset(tmp_path / "out" / "estimates.nc", group="CS") as result:
        found = result["d_hat"].transpose("time", "force").values
        assert list(result["force"].values) == list(struck_beam.FORCES)
    np.testing.assert_allclose(found, struck_beam.forces(), atol=0.05)


@pytest.mark.parametrize(
    ("line", "arrival"),
    [
        ("", SmoothedArrival()),
        ('arrival = { kind = "SmoothedArrival", naive = true }', SmoothedArrival(naive=True)),
        ('arrival = { kind = "NoArrival" }\nlag = "N"', NoArrival()),
    ],
)
def test_arrival_cost_and_lag_are_written_as_for_the_mhe(problem, line, arrival):
    made = problem(PROBLEM.replace("lam = 0.3\n", f"lam = 0.3\n{line}\n")).estimators["CS"]
    assert (made.arrival, made.lag, made.delay) == (arrival, "N", made.N)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"HalfSines", widths', '"HalfSine", widths', "dictionary.kind: unknown kind 'HalfSine'"),
        ("widths = [1, 2]", "widths = [1, 12]", "atoms of 12 steps"),
        ("age = 4", "age = 0", "carryover: age is 0"),
        ("lam = 0.3\n", 'lam = 0.3\nlag = "M"\n', "unknown lag 'M'"),
        ("lam = 0.3\n", 'lam = 0.3\narrival = "smoothed"\n', "arrival"),
        ("lam = 0.3\n", "", "estimators.CS.lam: is missing"),
        ("lam = 0.3", "lam = -0.3", "estimators.CS: lam is -0.3"),
        ("F4 = 0.05 }\nthr", "F9 = 0.05 }\nthr", "sigma_force names 'F9'"),
    ],
)
def test_mistakes_are_named(problem, tmp_path, old, new, message):
    assert old in PROBLEM
    with pytest.raises(BacksightError) as caught:
        run_problem(problem(PROBLEM.replace(old, new)), tmp_path / "out", progress=lambda *_: None)
    assert message in str(caught.value)
