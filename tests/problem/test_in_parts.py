"""Problems whose recording is taken in parts: the same numbers, and what needs the whole."""

import json

import pytest
from typer.testing import CliRunner

import backsight as bs
import small_problem
from backsight.cli import app
from backsight.errors import ProblemError
from backsight.problem import load
from backsight.problem.in_parts import failure_in_parts, lines_of_parts, run_in_parts
from backsight.problem.recorded import recording_of

ONLY = small_problem.TEXT.partition("[estimators.MHO]")[0]
IN_PARTS = ONLY.replace('path = "spring.csv"', 'path = "parts/*.csv"') + (
    '\n[recording.parts]\nvariables = ["x_std"]\nevery = 2\n'
)


def divided(folder, text=IN_PARTS):
    """The recording of the small problem as three files, places in millimetres."""
    small_problem.write(folder)
    (folder / "parts").mkdir()
    lines = (folder / "spring.csv").read_text().splitlines()
    for k, rows in enumerate((lines[1:71], lines[71:141], lines[141:])):
        (folder / "parts" / f"{k}.csv").write_text("\n".join([lines[0], *rows]) + "\n")
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_numbers_are_those_of_the_whole_recording(tmp_path):
    path = divided(tmp_path)
    found = run_in_parts(load(path), tmp_path / "out")
    small_problem.write(tmp_path, ONLY)
    whole = load(tmp_path / "problem.toml")
    expected = bs.estimate(whole.estimators["EKF"], whole.model, recording_of(whole))
    row = found["EKF"].isel(recording=0)
    assert row.x_hat.values == pytest.approx(expected.x_hat[-1].values, rel=1e-9)
    assert float(row.mean_nis) == pytest.approx(bs.check.mean_nis(expected), rel=1e-9)
    store = bs.large.read_store(tmp_path / "out" / "parts" / "EKF")
    assert store.sizes["time"] == 100
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["estimators"]["EKF"]["samples"] == 200
    assert told["estimators"]["EKF"]["final"]["k"]["value"] == pytest.approx(
        float(expected.x_hat[-1].sel(state="k"))
    )
    assert failure_in_parts(found["EKF"]) == ""
    assert "after 200 samples" in lines_of_parts(found)[0]


def test_units_are_those_of_the_model(tmp_path):
    path = divided(tmp_path)
    here = run_in_parts(load(path), tmp_path / "metres")
    for file in (tmp_path / "parts").glob("*.csv"):
        head, *rows = file.read_text().splitlines()
        cells = [row.split(",") for row in rows]
        rows = [f"{t},{u},{float(y) * 1e3!r}" for t, u, y in cells]
        file.write_text("\n".join([head, *rows]) + "\n")
    path.write_text(
        IN_PARTS.replace('column = "place", unit = "m"', 'column = "place", unit = "mm"')
    )
    there = run_in_parts(load(path), tmp_path / "millimetres")
    assert here["EKF"].x_hat.values == pytest.approx(there["EKF"].x_hat.values, rel=1e-9)


def test_the_command_goes_on_where_it_ended(tmp_path):
    path = divided(tmp_path)
    call = CliRunner().invoke
    done = call(app, ["run", str(path), "--out", str(tmp_path / "out")])
    assert (done.exit_code, done.stderr) == (0, "")
    assert "k = " in done.stdout
    again = call(app, ["run", str(path), "--out", str(tmp_path / "out")])
    assert again.stdout == done.stdout
    (tmp_path / "parts" / "0.csv").write_text("t,force,place\n0,0,0\n1,0,0\n")
    changed = call(app, ["run", str(path), "--out", str(tmp_path / "out")])
    assert changed.exit_code == 2
    assert changed.stderr.count("\n") == 1
    assert "has changed since it was estimated" in changed.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('time = "t"', 'time = "t"\nstart = 1.0', "recording.start: needs the whole recording"),
        ('unit = "m" }', 'unit = "m", delay = 0.1 }', "'y' has a delay"),
        ('kind = "ekf"', 'kind = "ekf"\nsmooth = true', "keeps every sample"),
        ('variables = ["x_std"]', 'variables = ["nothing"]', "no variable"),
    ],
)
def test_what_needs_the_whole_recording_is_refused(tmp_path, old, new, said):
    path = divided(tmp_path, IN_PARTS.replace(old, new))
    with pytest.raises(ProblemError) as caught:
        run_in_parts(load(path), tmp_path / "out")
    assert said in str(caught.value)


def test_what_is_smoothed_goes_back_part_by_part(tmp_path):
    text = IN_PARTS.replace('kind = "ekf"', 'kind = "ekf"\nsmooth = true')
    path = divided(tmp_path, text.replace("every = 2\n", ""))
    found = run_in_parts(load(path), tmp_path / "out")
    assert failure_in_parts(found["EKF"]) == ""
    assert "smoothed, 200 samples" in lines_of_parts(found)[0]
    told = json.loads((tmp_path / "out" / "summary.json").read_text())["estimators"]["EKF"]
    assert told["smoothed"]
    assert told["failure"] is None
    assert 0 < told["rms_residual"]["y"] < 1
    assert bs.large.read_store(tmp_path / "out" / "parts" / "EKF").sizes["time"] == 200
