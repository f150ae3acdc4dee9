"""Linear models: matrices to model and back."""

import casadi as ca
import numpy as np
import pytest

from backsight.errors import ModelError
from backsight.models import Model, duffing, from_equations, lti, sdof
from backsight.models.lti import state_space

NAMES = {"states": {"a": "m", "b": "m/s"}, "inputs": {"u": "N"}, "outputs": {"y": "m"}}
A, B, C, D = [[0, 1], [-4, -0.2]], [[0], [2]], [[1, 0]], [[0.5]]


@pytest.mark.parametrize("dt", [None, 0.1])
def test_matrices_come_back(dt: float | None) -> None:
    rng = np.random.default_rng(3)
    given = [rng.standard_normal(shape) for shape in ((4, 4), (4, 3), (2, 4), (2, 3))]
    given[0][rng.random((4, 4)) < 0.5] = 0
    model = lti(
        *given,
        states=dict.fromkeys("abcd", "m"),
        inputs=dict.fromkeys("uvw", "N"),
        outputs=dict.fromkeys("yz", "m"),
        dt=dt,
    )
    assert model.dt == dt
    for matrix, back in zip(given, state_space(model), strict=True):
        np.testing.assert_array_equal(matrix, back)


def test_equations_are_those_of_the_matrices() -> None:
    model = lti(A, B, C, D, **NAMES)
    x, u = np.array([0.3, -1.0]), np.array([2.0])
    np.testing.assert_allclose(at(model.f, x, u, []), A @ x + B @ u)
    np.testing.assert_allclose(at(model.h, x, u, []), C @ x + D @ u)


def test_no_inputs_and_no_feedthrough() -> None:
    model = lti(A, np.zeros((2, 0)), C, **NAMES | {"inputs": {}})
    _, b, _, d = state_space(model)
    assert b.shape == (2, 0)
    assert d.shape == (1, 0)
    np.testing.assert_array_equal(state_space(lti(A, B, C, **NAMES))[3], [[0.0]])


def test_all_wrong_matrices_are_named() -> None:
    with pytest.raises(ModelError) as caught:
        lti([[0, 1]], [0, 2], [[1, np.nan]], [[10**400]], **NAMES)
    message = str(caught.value)
    assert "A has the shape (1, 2); it must be (2, 2), states x states" in message
    assert "B has the shape (2,); it must be (2, 1), states x inputs" in message
    assert "C is not finite in row 1, column 2: nan" in message
    assert "D is not a matrix of numbers" in message
    with pytest.raises(ModelError, match="A is not a matrix of numbers"):
        lti([["x", 0], [0, 0]], B, C, **NAMES)


def test_parameters_are_taken_at_their_values() -> None:
    a, b, _, _ = state_space(sdof(k=9.0, b=0.3, c=2.0))
    np.testing.assert_array_equal(a, [[0, 1], [-9, -0.3]])
    np.testing.assert_array_equal(b, [[0], [2]])
    assert state_space(duffing(k1=9.0, d=0.3, k3=0.0))[0][1, 0] == -9


@pytest.mark.parametrize("term", ["q*v", "q**2", "sin(v)", "abs(v)", "min(q, v)", "q*u", "1/v"])
def test_nonlinear_equations_are_named(term: str) -> None:
    model = _oscillator(f"-q + {term}", "q")
    with pytest.raises(ModelError, match=r"the equation of 'v' is nonlinear$"):
        state_space(model)


def test_a_step_is_nonlinear_although_its_derivative_is_zero() -> None:
    with pytest.raises(ModelError, match="output equation of 'y' is nonlinear"):
        state_space(_oscillator("-q", "q + sign(v)"))
    remainder = Model(
        f=lambda x, *_: [x.v, ca.fmod(x.q, 2) + ca.floor(x.v)],
        h=lambda x, *_: [x.q],
        states={"q": "", "v": ""},
        outputs={"y": ""},
    )
    with pytest.raises(ModelError, match="the equation of 'v' is nonlinear"):
        state_space(remainder)


def test_constant_terms_are_named() -> None:
    with pytest.raises(ModelError) as caught:
        state_space(_oscillator("u - 3", "q + v*v"))
    message = str(caught.value)
    assert "the equation of 'v' has the constant term -3; make it an input" in message
    assert "the output equation of 'y' is nonlinear" in message


def _oscillator(v: str, y: str) -> Model:
    return from_equations(
        states={"q": "m", "v": "m/s"},
        inputs={"u": "N"},
        outputs={"y": "m"},
        equations={"q": "v", "v": v},
        output_equations={"y": y},
    )


def at(function: ca.Function, *arguments: object) -> np.ndarray:
    return function(*arguments).full().ravel()
