"""The examples that ship: what they find on the stage and on measured machines."""

import json
import os
import re
import runpy
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from typer.testing import CliRunner

import backsight as bs
from backsight.cli import app
from backsight.models.lti import state_space
from backsight.problem import load
from report.unpacking import figures_of

EXAMPLES = Path(__file__).parents[2] / "examples"

MEASURED = pytest.mark.skipif(
    not os.environ.get("BACKSIGHT_DATA"),
    reason="needs the recordings of nonlinearbenchmark.org; the problem files in examples/ say "
    "which, and the variable BACKSIGHT_DATA where they are",
)


def summaries(path, folder):
    """What the command line sums up of every estimator."""
    ran = CliRunner().invoke(
        app, ["run", str(EXAMPLES / path), "-o", str(folder)], catch_exceptions=False
    )
    assert ran.exit_code == 0
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))["estimators"]


ALL_METHODS = pytest.param(("EKF", "MHO", "MHE"), marks=pytest.mark.slow)
"""Their programs take most of the time to compile; each is tried on machines of its own, too."""


def finals(path, folder, *estimators):
    """Last estimates of these estimators of a problem file."""
    document = tomlkit.parse((EXAMPLES / path).read_text(encoding="utf-8"))
    for other in set(document["estimators"]) - set(estimators):
        del document["estimators"][other]
    copied = folder / "example"
    shutil.copytree((EXAMPLES / path).parent, copied)
    shorter = copied / Path(path).name
    shorter.write_text(tomlkit.dumps(document), encoding="utf-8")
    written = summaries(shorter, folder / "out")
    assert tuple(written) == estimators
    return {key: entry["final"] for key, entry in written.items()}


@pytest.mark.data
@MEASURED
@pytest.mark.parametrize("methods", [("EKF",), ALL_METHODS])
def test_mass_and_friction_of_the_measured_drive(tmp_path, methods):
    for final in finals("emps/problem.toml", tmp_path, *methods).values():
        for name, tolerance in {"M": 0.005, "Fv": 0.02, "Fc": 0.03, "offset": 0.05}.items():
            assert abs(final[name]["relative_error"]) < tolerance
            assert abs(final[name]["error"]) < 3 * final[name]["std"]


@pytest.mark.data
@pytest.mark.slow
@MEASURED
def test_the_measured_drive_with_an_unknown_force(tmp_path):
    for final in finals("emps/disturbance.toml", tmp_path, "EKF", "MHE").values():
        for name, tolerance in {"M": 0.005, "Fv": 0.02, "Fc": 0.03, "offset": 0.05}.items():
            assert abs(final[name]["relative_error"]) < tolerance
            assert abs(final[name]["error"]) < 3 * final[name]["std"]
        assert abs(final["D"]["value"]) < 3 * final["D"]["std"]


@pytest.mark.data
@MEASURED
@pytest.mark.parametrize("methods", [("EKF",), ALL_METHODS])
def test_stiffness_and_damping_of_the_measured_oscillator(tmp_path, methods):
    for final in finals("silverbox/problem.toml", tmp_path, *methods).values():
        for name, tolerance in {"k1": 0.01, "d": 0.03, "k3": 0.03}.items():
            assert abs(final[name]["relative_error"]) < tolerance
            assert abs(final[name]["error"]) < 3 * final[name]["std"]


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    return summaries("stage/problem.toml", tmp_path_factory.mktemp("stage"))


def test_the_stage_after_the_removal_of_its_payload(stage):
    # The last line of the recording holds the truth.
    last = (EXAMPLES / "stage" / "stage.csv").read_text(encoding="utf-8").splitlines()[-1]
    truth = dict(zip("kbc", map(float, last.split(",")[-3:]), strict=True))
    assert tuple(stage) == ("EKF", "MHO")
    for entry in stage.values():
        final = entry["final"]
        for name, true in truth.items():
            assert abs(final[name]["value"] - true) < min(3 * final[name]["std"], 0.05 * true)


def test_the_stage_is_tuned(stage):
    for entry in stage.values():
        assert entry["verdict"].startswith("consistent")


@pytest.mark.slow
def test_the_noise_of_the_stage_is_what_the_command_finds(tmp_path):
    text = (EXAMPLES / "stage" / "problem.toml").read_text(encoding="utf-8")
    (tmp_path / "stage.csv").write_bytes((EXAMPLES / "stage" / "stage.csv").read_bytes())
    guessed = re.sub(r"walk = [0-9.]+", "walk = 500.0", text).replace("y = 0.000", "y = 0.00")
    (tmp_path / "problem.toml").write_text(guessed, encoding="utf-8")
    out = tmp_path / "tuned.toml"
    ran = CliRunner().invoke(app, ["tune", str(tmp_path / "problem.toml"), "-o", str(out)])
    assert ran.exit_code == 0, ran.output
    found, shipped = (tomllib.loads(t) for t in (out.read_text(encoding="utf-8"), text))
    for name, entry in shipped["tune"]["found"].items():
        again = found["tune"]["found"][name]["value"]
        assert again == pytest.approx(entry["value"], abs=0.3 * entry["std"])


BEAM = ("problem.toml", "by_modes.toml", "by_matrices.toml")


@pytest.mark.parametrize("name", BEAM)
def test_the_hits_on_the_beam(tmp_path, name):
    """Place, sample and force of all six, and no other, however the beam is described."""
    made = runpy.run_path(str(EXAMPLES / "beam" / "make_recording.py"))
    listed = summaries(f"beam/{name}", tmp_path)["CS-MHE"]["hits"]
    assert listed["count"] == len(made["HITS"])
    found = {round(hit["start"] / made["DT"]): hit for hit in listed["largest"]}
    for k, (place, force) in made["HITS"].items():
        assert found[k]["place"] == place
        assert abs(found[k]["force"] - force) < min(3 * found[k]["std"], 0.05 * abs(force))
        assert found[k]["position"] in (None, pytest.approx(made["PLACES"][place]))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<table class="hits">' in page
    assert "heatmap" in [trace["type"] for f in figures_of(page) for trace in f["traces"]]


def test_the_three_descriptions_of_the_beam_are_the_same():
    """By what a force does to the sensors over a few samples."""
    answers = []
    for name in BEAM:
        problem = load(EXAMPLES / "beam" / name)
        forces = problem.estimators["CS-MHE"].forces
        A, B, C, _ = state_space(bs.forces.forces_as_inputs(problem.model, forces))
        answers.append([C @ np.linalg.matrix_power(A, i) @ B for i in range(4)])
    for other in answers[1:]:
        for expected, found in zip(answers[0], other, strict=True):
            np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


def test_the_recording_of_the_beam_is_that_of_its_script():
    made = runpy.run_path(str(EXAMPLES / "beam" / "make_recording.py"))
    kept = (EXAMPLES / "beam" / "beam.csv").read_text(encoding="utf-8")
    head, again = made["HEADER"].splitlines(), made["recording_text"]().splitlines()
    assert [line[2:] for line in kept.splitlines()[: len(head)]] == head
    rows = [
        np.loadtxt(text.splitlines()[len(head) + 1 :], delimiter=",")
        for text in (kept, "\n".join(again))
    ]
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["motor", "quarter_car"])
def test_examples_that_end_well(folder, tmp_path):
    """All their estimators find what the recording was made with, and may be believed.

    Of the first one tests/examples says so each time.
    """
    ran = CliRunner().invoke(
        app, ["run", str(EXAMPLES / folder / "problem.toml"), "-o", str(tmp_path)]
    )
    assert ran.exit_code == 0, ran.output
    for entry in json.loads((tmp_path / "summary.json").read_text("utf-8"))["estimators"].values():
        known = [f for f in entry["final"].values() if f.get("reference") is not None]
        assert len(known) == 2
        assert all(abs(f["value"] - f["reference"]) < 3 * f["std"] for f in known)
    assert ran.output.count(": consistent, its innovations are as large as it predicts") == 2


def test_the_motor_in_python_reads_the_german_file(tmp_path):
    found = runpy.run_path(str(EXAMPLES / "motor" / "run.py"))["estimated"]()
    final = found["EKF"].isel(time=-1).sel(state="J")
    assert abs(float(final.x_hat) - 2.4e-3) < 3 * float(final.x_std)


@pytest.mark.parametrize("folder", ["motor", "quarter_car"])
def test_recordings_are_what_their_programs_make(folder):
    made = runpy.run_path(str(EXAMPLES / folder / "make_recording.py"))
    files = made["texts"]() if "texts" in made else {"ride.csv": made["recording_text"]()}
    for name, text in files.items():
        there = (EXAMPLES / folder / name).read_text(encoding="utf-8")
        assert text.splitlines()[:50] == there.splitlines()[:50]
