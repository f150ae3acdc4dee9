"""Hostile names, units and titles in everything else that is written or printed."""

import json
import shutil
import subprocess

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import backsight as bs
import small_problem
from attack.payloads import CONTROLS, PAYLOADS
from backsight.cli import app
from backsight.engine.c99._interface import comment
from backsight.errors import ModelError, ProblemError
from backsight.export import export_c
from backsight.models import lti
from backsight.problem import load, run_problem
from backsight.problem.recorded import recording_of
from backsight.problem.results_file import read_estimates, write_estimates

EVERYTHING = "".join(text for name, text in PAYLOADS.items() if name != "long")


def hostile(folder, text=EVERYTHING):
    """A problem whose title, model and source are this text."""
    quoted = json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    plain = small_problem.changed('title = "Mass on a spring"', f"title = {quoted}")
    plain = plain.replace(
        '[model]\nkind = "sdof"\nc = 1.0',
        f"""[model]
kind = "equations"
name = {quoted}
states = {{ q = "m", v = "m/s" }}
outputs = {{ y = "q" }}
[model.equations]
q = "v"
v = "u - k*q - b*v"
""",
    )
    return small_problem.write(folder, plain.replace("\u2028", "").replace("\u2029", ""))


def hostile_units(text=EVERYTHING):
    """A model and its recording whose units, free labels in Python, are this text."""
    unit = "".join(c for c in text if c.isprintable())
    model = lti(
        [[0, 1], [-40, -1]], [[0], [1]], [[1, 0]],
        states={"q": unit, "v": unit}, inputs={"u": unit}, outputs={"y": unit}, name=text,
    )  # fmt: skip
    return model, bs.simulate(model, np.ones((60, 1)), dt=0.01, sigma_y=1e-3)


@pytest.mark.parametrize("text", [t for n, t in PAYLOADS.items() if n != "invisible"])
def test_a_unit_that_is_none_is_refused_in_a_file(tmp_path, text):
    unit = json.dumps("".join(c for c in text if c.isprintable()))
    path = small_problem.write(tmp_path, small_problem.changed('unit = "N"', f"unit = {unit}"))
    with pytest.raises(ProblemError) as caught:
        recording_of(load(path))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) <= 2000


def test_units_come_back_from_a_file_of_results(tmp_path):
    model, recording = hostile_units()
    ekf = bs.EKF(bs.Noise(sigma_y=1e-3, sigma_w=1e-3), bs.Prior(sigma_x0=1.0))
    results = {"EKF": bs.estimate(ekf, model, recording, engine="vm")}
    path = tmp_path / "estimates.nc"
    write_estimates(path, results, title=EVERYTHING, problem="", covariance=True)
    read = read_estimates(path)
    assert read.title == EVERYTHING
    xr.testing.assert_equal(read.results["EKF"], results["EKF"])


def test_what_is_written_reads_back_as_text(tmp_path):
    path = hostile(tmp_path)
    problem = load(path)
    results = run_problem(problem, tmp_path / "out", progress=lambda *_: None)
    summed = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summed["problem"]["title"] == problem.title
    assert "sprung" in problem.title
    with xr.open_dataset(tmp_path / "out" / "estimates.nc") as root:
        assert root.attrs["title"] == problem.title
    for name in results:
        with xr.open_dataset(tmp_path / "out" / "estimates.nc", group=name) as read:
            xr.testing.assert_equal(read, results[name].drop_vars("P"))


def test_a_terminal_only_shows_them(tmp_path):
    arguments = ["run", str(hostile(tmp_path)), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0
    for text in (done.stdout, done.stderr):
        assert all(c.isprintable() or c in "\n\t\u202f\u00a0\u2009" for c in text)
    assert "\\u202e" in done.stdout


@pytest.mark.parametrize("text", CONTROLS.values(), ids=CONTROLS)
def test_a_file_with_control_characters_is_refused(tmp_path, text):
    with pytest.raises(ProblemError, match=r"control character U\+00") as caught:
        load(hostile(tmp_path, text))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("text", CONTROLS.values(), ids=CONTROLS)
def test_a_unit_with_control_characters_is_refused(text):
    units = {"states": {"x": text}, "inputs": {"u": ""}, "outputs": {"y": ""}}
    with pytest.raises(ModelError, match="has control characters") as caught:
        lti([[0.0]], [[1.0]], [[1.0]], **units)
    assert str(caught.value).isprintable()


@pytest.mark.skipif(shutil.which("cc") is None, reason="compiles C")
def test_exported_code_compiles_and_says_only_what_it_should(tmp_path):
    model, recording = hostile_units()
    ekf = bs.EKF(bs.Noise(sigma_y=1e-3, sigma_w=1e-3), bs.Prior(sigma_x0=1.0))
    out = export_c(ekf, model, recording, tmp_path / "c", name="ekf")
    # Trigraphs count in C99, and all warnings about comments are errors.
    subprocess.run(["make", "-s", "-C", str(out), "test"], check=True, capture_output=True)
    for file in ("ekf.c", "ekf.h"):
        text = (out / file).read_text(encoding="utf-8")
        head = text[: text.index(" */") + 3]
        assert head.isascii() or all(c.isprintable() or c == "\n" for c in head)
        assert len(head.splitlines()) == 2
    assert not list(tmp_path.rglob("sprung*"))
    readme = (out / "README.md").read_text(encoding="utf-8")
    assert readme.count("\n# ") == 0  # one heading, at the top
    assert readme.count("```") == 2
    assert "<script" not in readme.replace("\\<script", "")


@pytest.mark.parametrize("text", [*PAYLOADS.values(), *CONTROLS.values(), "*\\", "a\\\t \n/"])
def test_a_comment_ends_where_it_should(text):
    written = comment(f"for '{text}', every second")
    inside = written.removeprefix("/* ").removesuffix(" */")
    joined = inside.replace("??/", "\\").replace("\\\n", "")
    assert "*/" not in joined
    assert "/*" not in joined
    assert "??" not in joined
    assert not [line for line in inside.splitlines() if line.rstrip().endswith("\\")]
