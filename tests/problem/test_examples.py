"""The examples that ship: what they find on the stage and on measured machines."""

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from backsight.cli import app

EXAMPLES = Path(__file__).parents[2] / "examples"

MEASURED = pytest.mark.skipif(
    not os.environ.get("BACKSIGHT_DATA"),
    reason="needs the recordings of nonlinearbenchmark.org; the problem files in examples/ say "
    "which, and the variable BACKSIGHT_DATA where they are",
)


def finals(name, folder):
    """Last estimates of every estimator, from the command line."""
    ran = CliRunner().invoke(
        app,
        ["run", str(EXAMPLES / name / "problem.toml"), "-o", str(folder)],
        catch_exceptions=False,
    )
    assert ran.exit_code == 0
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert list(written["estimators"]) == ["EKF", "MHO"]
    return {key: entry["final"] for key, entry in written["estimators"].items()}


@pytest.mark.data
@MEASURED
def test_mass_and_friction_of_the_measured_drive(tmp_path):
    for final in finals("emps", tmp_path).values():
        for name, tolerance in {"M": 0.005, "Fv": 0.02, "Fc": 0.03, "offset": 0.05}.items():
            assert abs(final[name]["relative_error"]) < tolerance
            assert abs(final[name]["error"]) < 3 * final[name]["std"]


@pytest.mark.data
@MEASURED
def test_stiffness_and_damping_of_the_measured_oscillator(tmp_path):
    for final in finals("silverbox", tmp_path).values():
        for name, tolerance in {"k1": 0.01, "d": 0.03, "k3": 0.03}.items():
            assert abs(final[name]["relative_error"]) < tolerance
            assert abs(final[name]["error"]) < 3 * final[name]["std"]


def test_the_stage_after_the_removal_of_its_payload(tmp_path):
    # The last line of the recording holds the truth.
    last = (EXAMPLES / "stage" / "stage.csv").read_text(encoding="utf-8").splitlines()[-1]
    truth = dict(zip("kbc", map(float, last.split(",")[-3:]), strict=True))
    for final in finals("stage", tmp_path).values():
        for name, true in truth.items():
            assert abs(final[name]["value"] - true) < min(3 * final[name]["std"], 0.05 * true)
