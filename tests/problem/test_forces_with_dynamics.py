"""Forces with dynamics and moving loads in problem files."""

import numpy as np
import pytest

from backsight.errors import ProblemError
from backsight.problem import load

PROBLEM = """
[recording]
path = "r.csv"
dt = 0.01
inputs = { s = "s" }
outputs = { y = { column = "y", unit = "m" } }

[model]
kind = "beam"
length = 20.0
bending_stiffness = 2e9
mass_per_length = 5e3
boundary = "pinned-pinned"
modes = 1
sensors = { y = { kind = "displacement", at = 10.0 } }
forces = { F1 = 5.0, F2 = 10.0, F3 = 15.0, wind = 8.0 }

[moving.P]
position = "s"
along = { F1 = 5.0, F2 = 10.0, F3 = 15.0 }
supports = [0.0, 20.0]

[estimate.P]
start = 0.0
sigma = 1e5

[forces.wind]
kind = "matern"
sigma = 2e3
length = 0.5

[noise]
sigma_y = { y = 1e-5 }

[prior]
sigma_x0 = { q1 = 1e-3, q1_dot = 1e-2 }

[estimators.kf]
kind = "kf"
hold = "foh"
"""


def loaded(tmp_path, text):
    (tmp_path / "p.toml").write_text(text)
    return load(tmp_path / "p.toml")


def test_a_bridge_with_wind_and_a_vehicle(tmp_path):
    problem = loaded(tmp_path, PROBLEM)
    assert [s.name for s in problem.model.states] == ["q1", "q1_dot", "P", "wind", "wind_rate"]
    assert [s.name for s in problem.model.inputs] == ["s"]
    noise, prior = problem.estimators["kf"].assumed
    P0 = prior.covariance(problem.model)
    assert np.allclose(P0.diagonal()[3:], [4e6, 3 * 4e6 / 0.25])
    assert noise.density(problem.model)[4, 4] > 0
    problem.estimators["kf"].compile(problem.model, 0.01)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('kind = "matern"', 'kind = "mattern"'), "forces.wind.kind: .*'matern'"),
        (("sigma = 2e3", "sigma = -1.0"), "forces.wind: .*sigma"),
        (("length = 0.5", "lenght = 0.5"), "forces.wind.lenght: .*length"),
        (("[forces.wind]", "[forces.wnd]"), "forces.wnd: .*'wind'"),
        (("[forces.wind]", '[forces.w]\nacts_on = "q9"'), "forces.w.acts_on: no state 'q9'"),
        (("F3 = 15.0 }\nsupports", "F9 = 15.0 }\nsupports"), "moving.P: .*F9"),
        (
            ('kind = "matern"\nsigma = 2e3\nlength = 0.5', 'kind = "periodic"\nsigma = 1.0\n'
             'frequency = "speed"'), "forces: .*follows 'speed'",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, change, says):
    with pytest.raises(ProblemError, match=says):
        loaded(tmp_path, PROBLEM.replace(*change))


def test_other_kinds(tmp_path):
    gauss = PROBLEM.replace(
        'kind = "matern"\nsigma = 2e3\nlength = 0.5',
        'kind = "gauss_markov"\nsigma = 2e3\ntime = 0.5\nacts_on = "q1_dot"',
    ).replace("[forces.wind]", "[forces.w]").replace(", wind = 8.0", "")  # fmt: skip
    assert [s.name for s in loaded(tmp_path, gauss).model.states][-1] == "w"
    orders = PROBLEM.replace(
        'kind = "matern"\nsigma = 2e3\nlength = 0.5',
        'kind = "periodic"\nsigma = 2e3\nfrequency = 3.0\norders = [1.0, 2.0]\nmemory = 5.0',
    )  # fmt: skip
    assert loaded(tmp_path, orders).model.nx == 7
