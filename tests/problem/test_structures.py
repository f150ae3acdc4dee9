"""Beams and other structures with unknown forces, from problem files."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from backsight.discrete.exact import zoh
from backsight.errors import ProblemError
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.structures import beam, modal, reduced
from backsight.problem import load, run_problem

DT, N = 1 / 400, 80
HIT = 40
HEAD = """
[recording]
path = "beam.csv"
dt = 0.0025
outputs.y1 = { column = "y1", unit = "m" }
outputs.y2 = "y2"
"""
BEAM = """
[model]
kind = "beam"
length = 0.405
width = 0.025
thickness = 0.003
youngs_modulus = 65.9e9
density = 7502
modes = 3
damping = [0.030, 0.037, 0.119]
sensors.y1 = { kind = "displacement", at = 0.325 }
sensors.y2 = { kind = "displacement", at = 0.405 }
forces = { tip = 0.405, middle = 0.2 }
"""
MODAL = """
[model]
kind = "modal"
frequencies = [10.0, 60]
damping = [0.01, 0.02]
sensors.y1 = { kind = "displacement", at = [1.0, -0.5] }
sensors.y2 = { kind = "strain", at = [1e-3, 2e-3] }
forces = { tip = [2.0, -2.0], middle = [0.7, 1.4] }
"""
REDUCED = """
[model]
kind = "reduced"
mass = [[1, 0, 0], [0, 2, 0], [0, 0, 1]]
stiffness = [[2e3, -1e3, 0], [-1e3, 2e3, -1e3], [0, -1e3, 1e3]]
damping = 0.02
modes = 2
sensors.y1 = { kind = "displacement", at = 0 }
sensors.y2 = { kind = "displacement", at = [0.0, 0.0, 1.0] }
forces = { tip = 2, middle = 1 }
"""
TAIL = """
[prior]
sigma_x0 = { STATES }

[noise]
sigma_y = { y1 = 1e-6, y2 = 1e-6 }

[estimators.joint]
kind = "joint_input"
forces = ["tip"]
sigma_force = { tip = 30.0 }
"""


def problem(folder: Path, model: str, *, states: int = 2, tail: str = TAIL):
    names = [f"q{i + 1}{end}" for end in ("", "_dot") for i in range(states)]
    text = HEAD + model + tail.replace("STATES", ", ".join(f"{n} = 1e-4" for n in names))
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


EXPECTED = {
    BEAM: lambda: beam(
        0.405,
        width=0.025,
        thickness=0.003,
        youngs_modulus=65.9e9,
        density=7502,
        damping=[0.030, 0.037, 0.119],
        sensors={"y1": ("displacement", 0.325), "y2": ("displacement", 0.405)},
        forces={"tip": 0.405, "middle": 0.2},
    ),
    MODAL: lambda: modal(
        [10.0, 60.0],
        damping=[0.01, 0.02],
        sensors={"y1": ("displacement", [1.0, -0.5]), "y2": ("strain", [1e-3, 2e-3])},
        forces={"tip": [2.0, -2.0], "middle": [0.7, 1.4]},
    ),
    REDUCED: lambda: reduced(
        [[1, 0, 0], [0, 2, 0], [0, 0, 1]],
        [[2e3, -1e3, 0], [-1e3, 2e3, -1e3], [0, -1e3, 1e3]],
        damping=0.02,
        modes=2,
        sensors={"y1": ("displacement", 0), "y2": ("displacement", 2)},
        forces={"tip": 2, "middle": 1},
    ),
}


@pytest.mark.parametrize("text", list(EXPECTED))
def test_a_structure_is_the_one_that_the_function_makes(tmp_path, text):
    found = problem(tmp_path, text, states=3 if text is BEAM else 2).model
    expected = EXPECTED[text]()
    assert str(found) == str(expected)
    pairs = [state_space(forces_as_inputs(m, ["tip", "middle"])) for m in (found, expected)]
    for a, b in zip(*pairs, strict=True):
        np.testing.assert_array_equal(a, b)


def test_forces_to_find_by_a_random_walk_are_estimated(tmp_path):
    tail = TAIL.replace(
        "[prior]", "[estimate]\ntip = { start = 0.0, sigma = 5.0, walk = 1.0 }\n[prior]"
    )
    tail = tail[: tail.index("[estimators")] + '[estimators.walk]\nkind = "kf"\n'
    found = problem(tmp_path, BEAM, states=3, tail=tail)
    assert [s.name for s in found.model.states][-1] == "tip"
    assert found.model.states[-1].unit == "N"


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [
        (BEAM, "tip = 0.405", "tip = 0.5", "model: force 'tip' is at 0.5 m, off the beam"),
        (BEAM, "at = 0.325", "at = 0.0", "model: sensor 'y1' at 0 m sees no mode"),
        (BEAM, "density", "destiny", "model.destiny: unknown key, did you mean 'density'"),
        (BEAM, "width = 0.025\n", "", "model: the cross-section lacks width"),
        (
            BEAM,
            'kind = "displacement", at = 0.325',
            "at = 0.1",
            "model.sensors.y1.kind: is missing",
        ),
        (BEAM, "modes = 3", "modes = 1.5", "model.modes: must be a whole number"),
        (MODAL, "frequencies = [10.0, 60]\n", "", "model.frequencies: is missing"),
        (MODAL, "[2.0, -2.0]", "[0.0, 0.0]", "model: force 'tip' moves no mode"),
        (REDUCED, "tip = 2", "tip = 3", "model: force 'tip' is at coordinate 3"),
        (REDUCED, "damping = 0.02\n", "", "model: give either damping"),
    ],
)
def test_bad_structures_are_said_by_key(tmp_path, text, old, new, message):
    assert text.count(old) == 1
    with pytest.raises(ProblemError, match=message):
        problem(tmp_path, text.replace(old, new), states=3 if text is BEAM else 2)


def test_a_hit_is_found(tmp_path):
    """From the file to the force: its sample, its size, and a band."""
    found = problem(tmp_path, BEAM, states=3)
    force = np.zeros((N, 1))
    force[HIT] = -10.0
    y = driven(forces_as_inputs(found.model, ["tip"]), force)
    rows = ["y1,y2", *(f"{a!r},{b!r}" for a, b in y.tolist())]
    (tmp_path / "beam.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    run_problem(found, tmp_path / "out", progress=lambda *_: None)
    result = xr.open_dataset(tmp_path / "out" / "estimates.nc", group="joint", engine="h5netcdf")
    with result:
        d = result["d_hat"].sel(force="tip")
        assert d[HIT + 1] == pytest.approx(-10.0, rel=1e-4)
        assert np.abs(d.drop_isel(time=HIT + 1)).max() < 0.1
        assert result["P_d"].dims == ("time", "force", "force_")
        assert (result["P_d"] > 0).all()


def driven(model, force):
    """Outputs of the model, sampled exactly, from rest."""
    A, B, C, _ = state_space(model)
    A, B = zoh(A, B, dt=DT)
    x, rows = np.zeros(len(A)), []
    for push in force:
        rows.append(C @ x)
        x = A @ x + B @ push
    return np.array(rows)
