"""What a problem file says becomes model, noise, prior and estimators."""

from pathlib import Path

import numpy as np
import pytest

import small_problem
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import ProblemError
from backsight.problem import Problem, load
from backsight.solvers.box import QuasiNewton

changed = small_problem.changed


def loaded(folder: Path, text: str) -> Problem:
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def test_unknowns_become_states_with_their_start_and_unit(tmp_path):
    states = loaded(tmp_path, small_problem.TEXT).model.states
    assert [(s.name, s.value, s.unit) for s in states] == [
        ("q", 0.0, "m"),
        ("v", 0.0, "m/s"),
        ("k", 80.0, "1/s2"),
        ("b", 1.0, "1/s"),
    ]


def test_bounds_scale_and_unit_of_an_unknown(tmp_path):
    entry = 'k = { start = 80.0, sigma = 30.0, lower = 1, upper = 1e3, scale = 50.0, unit = "N/m" }'
    problem = loaded(tmp_path, changed("k = { start = 80.0, sigma = 30.0 }", entry))
    k = problem.model.states[2]
    assert (k.lower, k.upper, k.scale, k.unit) == (1.0, 1e3, 50.0, "N/m")


def test_prior_and_noise_are_joined_with_what_the_unknowns_say(tmp_path):
    text = changed("sigma = 1.0 }", "sigma = 1.0, walk = 0.5 }").replace(
        "[estimators.EKF]", 'sigma_w = { v = 0.25 }\n[disturbances]\nw = { acts_on = "v", '
        "sigma = 7.0, walk = 3.0 }\n[estimators.EKF]"
    )  # fmt: skip
    problem = loaded(tmp_path, text)
    ekf = problem.estimators["EKF"]
    assert [s.name for s in problem.model.states] == ["q", "v", "k", "b", "w"]
    assert np.sqrt(np.diag(ekf.noise.process(problem.model))).tolist() == [0, 0.25, 0, 0.5, 3]
    assert np.sqrt(np.diag(ekf.prior.covariance(problem.model))).tolist() == [0.01, 0.1, 30, 1, 7]
    assert ekf.prior.mean(problem.model).tolist() == [0, 0, 80, 1, 0]


def test_matrices_instead_of_standard_deviations(tmp_path):
    text = changed(
        "sigma_y = { y = 1e-4 }", "R = [[4.0]]\nQc = [[0,0,0,0],[0,2,0,0],[0,0,0,0],[0,0,0,0]]"
    )
    problem = loaded(tmp_path, text)
    noise = problem.estimators["EKF"].noise
    assert noise.measurement(problem.model).tolist() == [[4.0]]
    assert np.diag(noise.density(problem.model)).tolist() == [0, 2, 0, 0]


def test_settings_of_an_estimator_come_before_the_common_ones(tmp_path):
    text = small_problem.TEXT + (
        "[integrator]\nsubsteps = 3\n"
        "[estimators.own]\nkind = 'ekf'\nintegrator = { scheme = 'heun' }\n"
        "noise = { sigma_y = { y = 0.5 } }\nprior = { sigma_x0 = { q = 4.0, v = 5.0 } }\n"
        "[estimators.quasi]\nkind = 'mho'\n"
        "optimiser = { kind = 'QuasiNewton', max_iterations = 9 }\n"
    )
    problem = loaded(tmp_path, text)
    common, own = problem.estimators["EKF"], problem.estimators["own"]
    assert common.integrator == Integrator(substeps=3)
    assert own.integrator == Integrator("heun")
    assert own.noise.measurement(problem.model) == 0.25
    assert np.sqrt(np.diag(own.prior.covariance(problem.model))).tolist() == [4.0, 5.0, 30.0, 1.0]
    assert problem.estimators["quasi"].optimiser == QuasiNewton(max_iterations=9)


def test_the_default_integrator_is_that_of_the_method(tmp_path):
    for estimator in loaded(tmp_path, small_problem.TEXT).estimators.values():
        assert estimator.integrator == type(estimator)(estimator.noise, estimator.prior).integrator


EQUATIONS = """
kind = "equations"
states = { q = "m", v = "m/s" }
outputs = { y = "q" }
equations = { q = "v", v = "u - k*q - b*v + g" }
parameters = { g = { value = 9.81, unit = "m/s2" } }
"""

STRUCTURE = """
kind = "second_order"
mass = 1.0
damping = "b"
stiffness = "k"
forces = { u = "q", "9.81" = "q" }
outputs.y = { kind = "displacement", at = "q" }
coordinates = { q = "m" }
"""


def rates(model, x, u):
    return np.array(model.f(x, u, model.theta)).ravel()


@pytest.mark.parametrize(("model", "speed"), [(EQUATIONS, "v"), (STRUCTURE, "q_dot")])
def test_the_same_oscillator_in_other_words(tmp_path, model, speed):
    text = changed('kind = "sdof"\nc = 1.0', model).replace("v = 0.1", f"{speed} = 0.1")
    other = loaded(tmp_path, text).model
    same = loaded(tmp_path, small_problem.TEXT).model
    x, u = np.array([0.3, -2.0, 90.0, 3.0]), np.array([1.5])
    gravity = np.array([0.0, 9.81, 0.0, 0.0])
    np.testing.assert_allclose(rates(other, x, u), rates(same, x, u) + gravity, rtol=1e-14)
    assert float(other.h(x, u, other.theta)) == 0.3
    assert [s.unit for s in (*other.inputs, *other.outputs)] == ["N", "m"]


def test_a_linear_model_by_its_matrices(tmp_path):
    model = (
        'kind = "lti"\nA = [[0, 1], [-100, -2]]\nB = [[0], [1]]\nC = [[1, 0]]\n'
        'states = { q = "m", v = "m/s" }'
    )
    text = changed('kind = "sdof"\nc = 1.0', model)
    text = text.replace(text[text.index("[estimate]") : text.index("[prior]")], "")
    problem = loaded(tmp_path, text[: text.index("[reference]")])
    assert rates(problem.model, [1.0, 1.0], [1.0]).tolist() == [1.0, -101.0]


def test_numbers_of_a_builtin_model_may_come_from_either_table(tmp_path):
    text = changed("k = { start = 80.0, sigma = 30.0 }\n", "")
    with pytest.raises(ProblemError, match=r"^model\.k: is missing; give its value, or estimate"):
        loaded(tmp_path, text)
    text = text.replace("c = 1.0", "c = 1.0\nk = 100.0").replace("k = 100.0\nb = 2.0", "")
    assert [s.name for s in loaded(tmp_path, text).model.parameters] == ["k", "c"]
