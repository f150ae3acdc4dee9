"""From a recording to a report by what the page asks of the server."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.workbench.conftest import MOTOR, serving

from backsight.problem.results_file import read_estimates
from backsight.workbench._bench import Workbench


def test_a_motor_from_its_recording_to_inertia_friction_and_load(served):
    found = served.ask("recording?name=motor.csv", MOTOR.read_bytes(), "PUT")
    assert [s["name"] for s in found["recording"]["signals"]] == ["current", "speed"]
    assert found["recording"]["signals"][1]["band"][0]
    choices = served.ask("suggest", {"machine": "motor"})
    assert choices["inputs"] == {"i": "current"}
    assert choices["outputs"] == {"speed": "speed"}
    assert choices["noise"]["speed"] == pytest.approx(0.05, rel=0.05)  # that of the recording
    choices["quantities"]["kt"]["value"] = 0.11
    checked = served.ask("check", choices)
    assert checked["error"] == ""
    # The first second is enough for a test, and a filter compiles fastest.
    text = checked["text"].replace("[recording]", "[recording]\nstop = 2.0")
    served.ask("runs", {"text": text.replace('kind = "mhe"\nN = 20', 'kind = "ekf"')})
    run = served.finished()
    assert (run["state"], run["error"]) == ("done", "")
    assert any("MHE" in sentence for sentence in run["said"])
    out = served.bench.folder / "run-1"
    result = read_estimates(out / "estimates.nc").results["MHE"]
    last = result["x_hat"].isel(time=-1).to_series()
    assert last["J"] == pytest.approx(2.4e-3, rel=0.05)
    assert last["load"] == pytest.approx(0.035, abs=0.02)
    status, headers, page = served.raw("GET", run["report"])
    assert status == 200
    assert page == (out / "report.html").read_bytes()
    assert "unsafe" not in headers["content-security-policy"]
    assert "frame-ancestors 'self'" in headers["content-security-policy"]


def test_a_run_is_kept_and_compared_with_the_next(served):
    if served.bench.found is None:
        served.ask("recording?name=motor.csv", MOTOR.read_bytes(), "PUT")
    choices = served.ask("suggest", {"machine": "motor"})
    choices["methods"] = ["EKF"]
    text = served.ask("check", choices)["text"].replace("[recording]", "[recording]\nstop = 0.2")
    first = len(served.bench.runs) + 1
    for walk in ("0.000316", "0.001"):
        served.ask("runs", {"text": text.replace("walk = 0.000316", f"walk = {walk}")})
        assert served.finished()["state"] == "done"
    page = served.ask("compare", {"runs": [first, first + 1]})["report"]
    body = served.raw("GET", page)[2].decode()
    assert f"Runs {first}, {first + 1}" in body
    assert served.raw("GET", "/report/guessed")[0] == 404
    path = served.address.split("/", 3)[3]
    status, headers, saved = served.raw("GET", f"/{path}runs/{first}/problem.toml")
    assert status == 200
    assert f'filename="run-{first}.toml"' in headers["content-disposition"]
    # Beside its recording the file that is saved is a problem like any other.
    assert tomllib.loads(saved.decode())["recording"]["path"] == "motor.csv"
    assert served.raw("GET", f"/{path}runs/{first}/.backsight.json")[0] == 404
    assert served.raw("GET", f"/{path}runs/99/report.html")[0] == 422


def test_what_cannot_be_run_is_said_and_nothing_is_left_behind(served):
    served.ask("runs", {"text": "title = 3"})
    run = served.finished()
    assert run["state"] == "failed"
    assert "title" in run["error"]
    assert run["report"] is None
    assert not list(served.bench.folder.glob(".check*"))
    assert served.ask("check", {"text": "x"})["error"].startswith("the problem is not TOML")


def test_a_run_that_is_stopped_writes_nothing(served, monkeypatch):
    run = served.bench.start((MOTOR.parent / "problem.toml").read_text(encoding="utf-8"))
    run.stop()
    found = served.finished()
    assert found["state"] in ("stopped", "failed")
    assert not run.out.exists()


def test_a_problem_file_is_opened_with_the_paths_that_it_has(tmp_path):
    bench = Workbench(tmp_path)
    bench.open(MOTOR.parent / "problem.toml")
    assert bench.found is None
    assert 'kind = "equations"' in bench.text
    assert bench.base == MOTOR.parent


def test_nothing_in_the_folder_is_overwritten(tmp_path):
    (tmp_path / "motor.csv").write_text("mine", encoding="utf-8")
    (tmp_path / "run-1.toml").write_text("mine", encoding="utf-8")
    with serving(Workbench(tmp_path)) as served:
        served.ask("recording?name=motor.csv", MOTOR.read_bytes(), "PUT")
        served.ask("runs", {"text": ""})
        assert served.finished()["number"] == 2
    assert (tmp_path / "motor.csv").read_text(encoding="utf-8") == "mine"
    assert (tmp_path / "run-1.toml").read_text(encoding="utf-8") == "mine"
    assert (tmp_path / "motor-2.csv").read_bytes() == MOTOR.read_bytes()


def test_a_recording_without_time_asks_for_its_period(tmp_path):
    y = np.sin(0.1 * np.arange(50))
    file = tmp_path / "bare.csv"
    file.write_text("\n".join(["speed [rad/s]", *map(str, y)]), encoding="utf-8")
    bench = Workbench(Path(tmp_path))
    bench.open(file)
    listed = bench.listed()
    assert listed is not None
    assert not listed["sure"]
    assert listed["dt"] is None
