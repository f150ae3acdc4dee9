"""What a check and a run say of a recording: on the terminal, in the summary and in the report."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import backsight as bs
import small_problem
from backsight.analysis.comparison._summary import assess
from backsight.cli import app


@pytest.fixture
def problem(tmp_path):
    """Write the small problem with its output so many samples late and in other units."""

    def write(*, late: int = 0, factor: float = 1.0):
        path = small_problem.write(tmp_path)
        table = small_problem.table()
        table[:, 2] = factor * np.roll(table[:, 2], late)
        rows = [f"{t!r},{u!r},{y!r}" for t, u, y in table.tolist()]
        text = "\n".join(["t,force,place", *rows]) + "\n"
        (tmp_path / "spring.csv").write_text(text, encoding="utf-8")
        return path

    return write


def command(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    return result.exit_code, " ".join(result.stdout.split())


@pytest.mark.parametrize(
    ("changes", "code", "says"),
    [
        ({}, 0, "y and u are aligned: "),
        ({"late": 1}, 1, "misaligned by one sample: y is late (shift y by -1"),
        ({"late": -1}, 1, "misaligned by one sample: y is early (shift y by +1"),
        (
            {"factor": 1e3},
            1,
            "times larger than the model's response to the input (milli or kilo?)",
        ),
        ({"factor": -1.0}, 1, "opposite sign"),
    ],
)
def test_check_says_what_is_wrong_with_the_recording(problem, changes, code, says):
    found, printed = command("check", problem(**changes))
    assert says in printed
    assert found == code


def test_check_certifies_an_estimator(problem):
    path = problem()
    code, printed = command("check", path, "--certify", "EKF")
    assert code == 0
    assert "Certificate: Extended Kalman filter" in printed
    assert "equals the Kalman filter and the full-information estimate" in printed
    code, printed = command("check", path, "--certify", "MHO")
    assert code == 1
    assert "does NOT equal" in printed


def test_check_knows_the_names_of_the_estimators(problem):
    result = CliRunner().invoke(app, ["check", str(problem()), "--certify", "EFK"])
    assert result.exit_code == 2
    assert "there is no 'EFK', did you mean 'EKF'?" in result.stderr


def test_run_says_it_everywhere(problem, tmp_path):
    out = tmp_path / "out"
    _, printed = command("run", problem(late=1), "--out", out)
    says = "misaligned by one sample: y is late"
    assert says in printed
    page = (out / "report.html").read_text(encoding="utf-8")
    assert says in page
    assert page.count('<table class="consistency">') == 1
    written = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert says in written["problem"]["alignment"][0]
    for entry in written["estimators"].values():
        assert entry["verdict"].endswith(".")
        assert set(entry["innovations"]) == {"y"}
        assert -1 < entry["innovations"]["y"]["lag1"] < 1


def test_results_of_a_comparison_know_what_was_found():
    machine = bs.sdof(k=100.0, b=2.0, c=1.0)
    u = np.repeat(np.sign(np.random.default_rng(5).standard_normal(300)), 5)
    made = bs.simulate(machine, u, dt=0.01, sigma_y=2e-4, disturbances={"v": 0.3 * wobble(1500)})
    believed = bs.Noise(sigma_y=1e-4, sigma_w={"v": 3e-3})
    estimators = {"KF": bs.KalmanFilter(believed, bs.Prior(sigma_x0=0.1))}
    result = bs.compare(estimators, machine, made)["KF"]
    row = assess(result)
    assert row.aligned
    assert row.alignment[0].startswith("y and u are aligned")
    assert pytest.approx(4.0, rel=0.25) == row.consistency.noise.R
    assert "R is about" in bs.compare(estimators, machine, made).verdicts()[-1]
    assert str(bs.check.check_consistency(result)).count("\n") >= 4


def wobble(n: int) -> np.ndarray:
    """White force of unit size."""
    return np.random.default_rng(6).standard_normal(n)
