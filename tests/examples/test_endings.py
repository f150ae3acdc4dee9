"""Examples end in what they promise, ship what their scripts make, and say the same in Python."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import backsight as bs
from backsight.analysis.comparison import ranked_table, sentence
from backsight.problem import load
from backsight.problem.recorded import recording_of

EXAMPLES = Path(__file__).parents[2] / "examples"
CONSISTENT = "consistent, its innovations are as large as it predicts; within 3σ of every reference"
ENDS = {
    "bridge": CONSISTENT,
    "frame": "4 hits found, the largest at 0.1915 s at middle",
    "motor": CONSISTENT,
    "quarter_car": CONSISTENT,
    "rotor": CONSISTENT,
    "storeys": CONSISTENT,
}
RECORDINGS = {
    "bridge": "crossing.csv",
    "frame": "hits.csv",
    "quarter_car": "ride.csv",
    "rotor": "run_up.csv",
    "storeys": "earthquake.csv",
}
LARGEST = 200_000  # bytes


def program(example, name):
    spec = importlib.util.spec_from_file_location(f"{example}_{name}", EXAMPLES / example / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("example", ENDS)
def test_the_first_estimator_ends_in_what_the_example_is_about(example):
    problem = load(EXAMPLES / example / "problem.toml")
    name, estimator = next(iter(problem.estimators.items()))
    found = bs.estimate(estimator, problem.model, recording_of(problem), engine="vm")
    (row,) = ranked_table({name: found}, problem.reference)
    assert sentence(row).startswith(ENDS[example])


@pytest.mark.slow
@pytest.mark.parametrize("example", RECORDINGS)
def test_recordings_are_what_their_scripts_make(example):
    shipped = (EXAMPLES / example / RECORDINGS[example]).read_text(encoding="utf-8")
    made = program(example, "make_recording.py").recording_text()
    assert len(shipped) < LARGEST
    assert heading(made) == heading(shipped)
    np.testing.assert_allclose(table(made), table(shipped), rtol=1e-6, atol=2e-4)


def test_matrices_of_the_frame_are_what_its_script_makes():
    script = program("frame", "make_recording.py")
    for name, matrix in script.matrices().items():
        assert (EXAMPLES / "frame" / name).read_text(encoding="utf-8") == script.matrix_text(matrix)


@pytest.mark.slow
@pytest.mark.parametrize("example", ENDS)
def test_program_and_problem_file_say_the_same(example):
    problem = load(EXAMPLES / example / "problem.toml")
    name, estimator = next(iter(problem.estimators.items()))
    by_file = bs.estimate(estimator, problem.model, recording_of(problem)).isel(time=-1)
    by_program = program(example, "run.py").estimated()[name].isel(time=-1)
    there = by_program.sel(state=by_file["state"].values)
    off = (there["x_hat"] - by_file["x_hat"]).values / by_file["x_std"].values
    assert np.abs(off).max() < 0.2  # files with digits of their own, walks of another time


def heading(text):
    return [line for line in text.splitlines() if not line[:1].isdigit()]


def table(text):
    rows = [line for line in text.splitlines() if line[:1].isdigit()]
    return np.array([[float(v) for v in row.split(",")] for row in rows])
