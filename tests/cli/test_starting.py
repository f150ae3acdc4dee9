"""From a recording alone to a result: `backsight columns`, `backsight init`, `backsight run`."""

import json

import numpy as np
import pytest

N = 200


@pytest.fixture
def recording(tmp_path):
    """A logger's text with a unit for everything, a code, and a text column."""
    rng = np.random.default_rng(2)
    y = np.sin(0.1 * np.arange(N)) + 0.01 * rng.standard_normal(N)
    w = rng.standard_normal(N)
    cells = [f"{y[k]:.5f};{w[k]:.3f}".replace(".", ",") for k in range(N)]
    cells[17] = "-999;0,5"
    rows = [f"{2 * k};{cells[k]};ok" for k in range(N)]
    path = tmp_path / "my run.csv"
    path.write_text("\n".join(["t (ms);Höhe (mm);sin;state", *rows]) + "\n", encoding="utf-8")
    return path


def test_columns_are_listed_with_what_looks_wrong(backsight, recording):
    code, printed, told = backsight("columns", recording)
    assert (code, told) == (0, "")
    lines = printed.splitlines()
    assert lines[0].startswith("my run.csv: 200 rows; time 't' (factor 0.001), every 0.002 s")
    assert max(map(len, lines)) <= 80
    (row,) = [line.split() for line in lines if line.startswith("Höhe")]
    assert row[:3] == ["Höhe", "mm", "500"]
    assert "    -999 in one sample: not measured? (missing = [-999])" in lines
    assert "    state: text" in lines


def test_the_problem_file_runs_as_it_is(backsight, recording, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, printed, told = backsight("init", recording)
    assert (code, told) == (0, "")
    problem = tmp_path / "my run.toml"
    assert "backsight run" in printed
    text = problem.read_text(encoding="utf-8")
    assert "missing = [-999.0]" in text
    assert 'time = { column = "t", factor = 0.001 }' in text
    code, printed, told = backsight("run", problem, "--out", tmp_path / "out")
    assert (code, told) == (0, "")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["problem"]["samples"] == N
    assert summary["problem"]["dt"] == pytest.approx(0.002)
    assert "over-confident" not in printed


def test_nothing_is_overwritten(backsight, recording, tmp_path):
    problem = tmp_path / "there.toml"
    problem.write_text("mine")
    code, printed, told = backsight("init", recording, "-o", problem)
    assert (code, printed) == (2, "")
    assert "nothing is overwritten" in told
    assert problem.read_text() == "mine"


def test_without_time_the_file_says_what_to_fill_in(backsight, tmp_path):
    path = tmp_path / "run.npy"
    np.save(path, np.random.default_rng(1).standard_normal((50, 2)))
    problem = tmp_path / "run.toml"
    assert backsight("init", path, "-o", problem)[0] == 0
    text = problem.read_text()
    code, _, told = backsight("run", problem, "-o", tmp_path / "out")
    assert code == 2
    assert "sampling period dt" in told
    problem.write_text(text.replace("# dt = ...", "dt = 0.01 "))
    assert backsight("run", problem, "-o", tmp_path / "out")[0] == 0


def test_bad_files_are_told_in_one_line(backsight, tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("nothing\nbut words\n")
    for command in ("columns", "init"):
        code, _, told = backsight(command, tmp_path / "none.csv")
        assert code == 2
        assert told.count("\n") == 1
    code, _, told = backsight("init", path)
    assert (code, told.count("\n")) == (2, 1)
