"""A problem with several files: every one has its own clock, rate and delay."""

import numpy as np
import pytest

import small_problem
from backsight.errors import ProblemError
from backsight.problem.reading.loading import load
from backsight.problem.recorded import recording_of

SOURCE = """
[recording.sources.drive]
path = "force.csv"
time = "t"
delay = 0.5
inputs.u = { column = "force", unit = "kN" }

[model]"""


@pytest.fixture
def split(tmp_path):
    """The recording in two files; the clock of the force is late by half a second."""
    t, force, _ = small_problem.table().T
    lines = "".join(
        f"{a + 0.5!r},{b / 1e3!r}\n" for a, b in zip(t.tolist(), force.tolist(), strict=True)
    )
    (tmp_path / "force.csv").write_text("t,force\n" + lines)

    def write(text=SOURCE):
        own = small_problem.changed('inputs.u = { column = "force", unit = "N" }\n', "")
        return small_problem.write(tmp_path, own.replace("\n[model]", text))

    return write


def test_several_files_are_one_recording(split, tmp_path):
    whole = recording_of(load(small_problem.write(tmp_path)))
    joined = recording_of(load(split()))
    np.testing.assert_allclose(joined.u, whole.u, rtol=1e-12)
    np.testing.assert_allclose(joined.y, whole.y, rtol=1e-12)
    np.testing.assert_allclose(joined.time, whole.time, atol=1e-12)


def test_it_runs_from_the_command_line(split, tmp_path):
    from typer.testing import CliRunner

    from backsight.cli import app

    done = CliRunner().invoke(app, ["run", str(split()), "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("inputs.u", "inputs.w", r"recording.inputs.w: the model has no input 'w'"),
        (
            "inputs.u",
            "outputs.y",
            r"recording.sources.drive.outputs.y: is a column of recording, too",
        ),
        ('inputs.u = { column = "force", unit = "kN" }\n', "", "drive: names no column"),
        ("delay", "dely", "recording.sources.drive.dely: unknown key, did you mean 'delay'?"),
        ("kN", "banana", "recording.sources.drive.inputs.u.unit: 'banana' is no"),
        ("force.csv", "forces.csv", "there is no file"),
    ],
)
def test_faults_name_their_file(split, old, new, message):
    from backsight.errors import DataError

    with pytest.raises((ProblemError, DataError), match=message):
        recording_of(load(split(SOURCE.replace(old, new))))
