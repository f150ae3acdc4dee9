"""Hits of sensors at their limits, followed from a problem file."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import backsight as bs
from backsight.cli import app
from backsight.errors import ProblemError
from backsight.live._problem import load_live
from backsight.problem import load, run_problem, tune_problem

EXAMPLE = Path(__file__).parents[2] / "examples" / "frame" / "measured.toml"

START, WIDTH, HEIGHT = 30.3, 4.2, 40.0
PROBLEM = """
[recording]
path = "hit.csv"
dt = 0.01
outputs = { a = "a", b = "b" }

[model]
kind = "modal"
frequencies = [2.2, 7.5]
damping = 0.01
sensors.a = { kind = "acceleration", at = [1.0, 0.6] }
sensors.b = { kind = "acceleration", at = [0.7, -0.9] }
forces = { low = [0.9, 0.2], high = [0.5, -0.8], moment = [0.3, 0.3] }

[readings]
outputs = { a = { limit = 6.0 }, b = { limit = 6.0 } }

[prior]
sigma_x0 = { q1 = 1e-2, q2 = 1e-2, q1_dot = 1e-2, q2_dot = 1e-2 }

[noise]
sigma_y = { a = 0.02, b = 0.02 }

[estimators.Hits]
kind = "csmhe"
forces = ["low", "high", "moment"]
lam = 1.0
sigma_force = 0.02
dictionary = { kind = "HalfSines", widths = [3, 5] }
follow = { sizes = [4.0, 60.0], before = 20, after = 25, beside = ["moment"] }
"""


@pytest.fixture
def problem(tmp_path):
    text = PROBLEM

    def read(text: str):
        (tmp_path / "problem.toml").write_text(text, encoding="utf-8")
        return load(tmp_path / "problem.toml")

    pushed = np.zeros((75, 3))
    mean = bs.forces.HalfSines((1,)).means(np.arange(76.0), start=START, width=WIDTH)
    pushed[:, 1], pushed[:, 2] = HEIGHT * mean, -5.0 * mean
    np.savetxt(tmp_path / "hit.csv", np.zeros((2, 2)), delimiter=",", header="a,b", comments="")
    model = bs.forces.forces_as_inputs(read(text).model, ["low", "high", "moment"])
    made = bs.simulate(model, pushed, dt=0.01, sigma_y=0.02, seed=1)
    np.savetxt(tmp_path / "hit.csv", made["y"], delimiter=",", header="a,b", comments="")
    return read, made


def test_the_hit_is_in_all_that_a_run_writes(problem, tmp_path):
    """Far beyond the limit, and by bands that cover: the force, and the states behind it."""
    read, made = problem
    run_problem(read(PROBLEM), tmp_path / "out", progress=lambda *_: None)
    with xr.open_dataset(tmp_path / "out" / "estimates.nc", group="Hits") as result:
        assert list(result["hit_force"].values) == ["high"]
        assert abs(result["hit_start"][0] - 0.01 * START) < 4 * result["hit_start_std"][0] < 1e-3
        assert abs(result["hit_size"][0] - HEIGHT) < 4 * result["hit_size_std"][0] < 4.0
        assert list(result["force"].values) == ["low", "high"]
        d = result["d_hat"].sel(force="high").values
        assert abs(d.sum() - HEIGHT * WIDTH * 2 / np.pi) < 3.0
        assert not result["d_hat"].sel(force="low").any()
        off = (result["x_hat"] - made["x_true"]) / result["x_std"]
        assert float(np.abs(off).max()) < 4.5
        assert not result["status"].any()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["estimators"]["Hits"]["hits"]["largest"][0]["place"] == "high"
    assert '<table class="hits">' in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('["moment"]', '["momnt"]', r"follow\.beside\[0\]: there is no force 'momnt'.*moment"),
        ('"csmhe"', '"ekf"', r"estimators\.Hits\.follow: .* looks for no unknown forces"),
        ("sizes = [4.0, 60.0]", "sizes = [4.0]", r"follow\.sizes"),
        ("lam = 1.0", "lam = 1.0\nsmooth = true", r"follow: goes without smooth"),
        ("dt = 0.01", "dt = 0.01\nparts = { samples = 10 }", r"follow: needs the whole recording"),
    ],
)
def test_what_cannot_be_followed_is_refused_at_its_key(problem, old, new, said):
    read, _ = problem
    text = PROBLEM.replace(old, new)
    if '"ekf"' in text:
        kept = text[: text.index("forces = [")] + text[text.index("follow = ") :]
        text = kept
    with pytest.raises(ProblemError, match=said):
        read(text)


def test_what_goes_sample_by_sample_does_not_follow(problem, tmp_path):
    read, _ = problem
    whole = read(PROBLEM)
    said = "this takes a whole recording"
    with pytest.raises(ProblemError, match=said):
        tune_problem(whole, tmp_path / "tuned.toml")
    with pytest.raises(ProblemError, match=said):
        load_live(tmp_path / "problem.toml")
    export = ["export", str(tmp_path / "problem.toml"), "--estimator", "Hits", "-o", "code"]
    ran = CliRunner().invoke(app, export)
    assert ran.exit_code == 2


@pytest.mark.slow
@pytest.mark.data
def test_heights_of_measured_hits_from_raw_readings(tmp_path):
    """By the example as it ships, through the command line: at least 30 of 33."""
    data = os.environ.get("BACKSIGHT_DATA", "")
    path = Path(data, "frame_hammer", "x160_multi.npz")
    if not path.exists():
        pytest.skip("no frame_hammer/x160_multi.npz in the folder BACKSIGHT_DATA")
    ran = CliRunner().invoke(app, ["run", str(EXAMPLE), "-o", str(tmp_path)])
    assert ran.exit_code == 0, ran.output
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    found = summary["estimators"]["Hits"]["hits"]["largest"]
    with np.load(path) as stored:
        true = stored["hit_time_s"]
    right = [t for t in true if any(_is_right(hit, t) for hit in found)]
    assert len(true) == 33
    assert len(right) >= 30
    assert len(found) <= 33  # and nothing else


def _is_right(hit, time):
    return abs(hit["time"] - time) < 5e-3 and hit["place"] == "at_1_60_m"
