"""Sparse forces of a whole recording, from a problem file."""

import json

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.errors import BacksightError, ProblemError
from backsight.problem import load, run_problem
from oracles import struck_beam

AT, SIZE = 12, 6.0
PLACES = dict(zip(struck_beam.FORCES, map(float, struck_beam.NODES), strict=True))
NODES = ", ".join(f"{x:.3f}" for x in PLACES.values())
PROBLEM = f"""{struck_beam.PROBLEM}
[estimators.CS]
kind = "csmhe"
forces = [{", ".join(f'"{name}"' for name in PLACES)}]
lam = 1.0

[estimators.CS.search]
locate = true
line = {{ places = [{NODES}], supports = [0.0] }}
"""


@pytest.fixture
def problem(tmp_path):
    def read(text: str):
        (tmp_path / "problem.toml").write_text(text, encoding="utf-8")
        return load(tmp_path / "problem.toml")

    np.savetxt(tmp_path / "beam.csv", np.zeros((2, 3)), delimiter=",", header="s1,s2,s3")
    d = np.zeros((40, len(PLACES)))
    d[AT, 4] = SIZE
    model = bs.forces.forces_as_inputs(read(PROBLEM).model, list(PLACES))
    made = bs.simulate(model, d, dt=struck_beam.DT, sigma_y=1e-5, seed=1)
    path = tmp_path / "beam.csv"
    np.savetxt(path, made["y"], delimiter=",", header="s1,s2,s3", comments="")
    return read


def test_forces_and_hits_of_the_whole_recording(problem, tmp_path):
    """Where, when and how hard, on the grid and between, with bands that cover."""
    found = run_problem(problem(PROBLEM), tmp_path / "out", progress=lambda *_: None)
    with xr.open_dataset(tmp_path / "out" / "estimates.nc", group="CS") as result:
        assert np.argwhere(result["d_hat"].values).tolist() == [[AT, 4]]
        assert result.sizes["hit"] == 1
        true = {"place": PLACES["F4"], "start": struck_beam.DT * AT, "size": SIZE}
        for name, value in true.items():
            off, std = abs(result[f"hit_{name}"][0] - value), result[f"hit_{name}_std"][0]
            assert off < 4 * std < 0.1 * value
        assert result.attrs["nonzeros"] == 1
        place = float(result["hit_place"][0])
    assert "CS: 1 hit " in found.table()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    (hit,) = summary["estimators"]["CS"]["fitted_hits"]
    assert (hit["place"]["value"], hit["place"]["unit"]) == (place, "m")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "hits fitted as pulses" in page


def test_the_choice_of_forces_is_written_as_in_python(problem, tmp_path):
    """A price beyond all forces leaves none, and then there is nothing to locate."""
    text = PROBLEM + 'selection = { kind = "Greedy", penalty = 1e9 }\n'
    found = run_problem(problem(text), tmp_path / "out", progress=lambda *_: None)["CS"]
    assert not found["d_hat"].values.any()
    assert "hit_place" not in found


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("line = ", "# line = ", "estimators.CS: locate needs a line"),
        ("supports = [0.0]", "supports = [0.125]", "which is a support"),
        ("locate = true", 'selection = { kind = "L2" }', r"search\.selection\.kind: .* 'L2'"),
        ("locate = true", "selection = { penalty = -1.0 }", "penalty"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_first_sample(problem, tmp_path, old, new, said):
    text = PROBLEM.replace(old, new)
    with pytest.raises(BacksightError, match=said):
        run_problem(problem(text), tmp_path / "out", progress=lambda *_: None)
    assert not (tmp_path / "out").exists()


def test_one_way_to_go_over_a_recording(problem):
    with pytest.raises(ProblemError, match=r"estimators\.CS\.search: goes without smooth"):
        problem(PROBLEM.replace("lam = 1.0", "lam = 1.0\nsmooth = true"))
