import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backsight.errors import ModelError
from backsight.models.augment import augment
from backsight.models.canonical.affine import affine_form, moving_states
from backsight.models.lti import lti
from backsight.models.model import Model

PARAMETERS = {"m": 125.0, "c": 2e4, "d": 1500.0}
STATES = {"q": "m", "v": "m/s"}


def friction(v):
    return 30 * ca.tanh(50 * v)


def oscillator(f, h=lambda x, u, p: [x.q], states=STATES, outputs=("y",)) -> Model:
    """A model with the parameters m, c, d among its states."""
    plant = Model(
        f=f,
        h=h,
        states=states,
        inputs={"F": "N"},
        outputs=dict.fromkeys(outputs, "m"),
        parameters=PARAMETERS,
    )
    return augment(plant, list(PARAMETERS))


def punch() -> Model:
    return oscillator(lambda x, u, p: [x.v, (u.F - p.c * x.q - p.d * x.v - friction(x.v)) / p.m])


def test_canonical_form_of_the_punch():
    """Equation 22: theta = c/m, d/m, 1/m and psi = -x1, -x2, F - friction."""
    form = affine_form(punch())
    assert form.states == ("q", "v")
    assert form.parameters == ("m", "c", "d")
    assert set(form.combinations) == {"c/m", "d/m", "1/m"}
    x, F = np.array([1e-3, 0.02]), 800.0
    psi = dict(zip(form.combinations, np.asarray(form.psi(x, F))[:, 0], strict=True))
    assert psi["c/m"] == -x[0]
    assert psi["d/m"] == -x[1]
    assert psi["1/m"] == pytest.approx(F - 30 * np.tanh(1.0), rel=1e-15)
    np.testing.assert_array_equal(np.asarray(form.phi(x, F)), np.zeros((2, 1)))
    assert [form.combinations[i] for i in form.divisors] == ["1/m"]


sizes = st.floats(0.1, 10.0)
values = st.floats(-3.0, 3.0)


@given(m=sizes, c=sizes, d=sizes, q=values, v=values, F=values)
def test_the_form_is_the_model(m, c, d, q, v, F):
    """The same derivative from combinations as from the model, and the parameters back again."""
    model = punch()
    form = affine_form(model)
    p = np.array([m, c, d])
    theta = form.theta(p)
    np.testing.assert_allclose(np.asarray(form.physical(theta))[:, 0], p, rtol=1e-13)
    z, u = ca.SX([q, v, *p]), ca.SX(F)
    expected = np.asarray(ca.evalf(model.rhs(z, u)))[:2, 0]
    found = np.asarray(ca.evalf(form.rhs(ca.SX([q, v]), ca.SX(theta), u)))[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_signs_of_parameters_survive():
    form = affine_form(oscillator(lambda x, u, p: [x.v, (u.F * p.d - p.c * x.q) / p.m - p.d]))
    p = np.array([-2.0, 3.0, -5.0])
    np.testing.assert_allclose(np.asarray(form.physical(form.theta(p)))[:, 0], p, rtol=1e-13)


def test_powers_and_products():
    form = affine_form(
        oscillator(lambda x, u, p: [x.v, p.m**2 * u.F + p.m * p.c * x.q + 2 * p.c * p.d * x.v])
    )
    assert set(form.combinations) == {"m**2", "m*c", "c*d"}
    p = np.array([2.0, 3.0, 5.0])
    np.testing.assert_allclose(np.asarray(form.physical(form.theta(p)))[:, 0], p, rtol=1e-13)


def test_longer_chain_with_nonlinear_rows():
    form = affine_form(
        oscillator(
            lambda x, u, p: [
                x.v - ca.sin(x.q),
                x.a + x.q * x.v + u.F,
                -p.m * x.a - p.c * x.q + p.d * u.F + x.v**3,
            ],
            states={"q": "", "v": "", "a": ""},
        )
    )
    assert form.n == 3
    x = np.array([0.3, -0.7, 0.2])
    expected = [-np.sin(0.3), 0.3 * -0.7 + 2.0, (-0.7) ** 3]
    np.testing.assert_allclose(np.asarray(form.phi(x, 2.0))[:, 0], expected, rtol=1e-14)


def test_no_parameters():
    plant = Model(
        f=lambda x, u, p: [x.v, -9.0 * x.q + u.F],
        h=lambda x, u, p: [x.q],
        states=STATES,
        inputs={"F": "N"},
        outputs={"y": "m"},
    )
    form = affine_form(plant)
    assert form.p == 0
    assert form.combinations == form.divisors == ()


def test_moving_states():
    assert moving_states(punch()) == [0, 1]
    constant = lti(
        np.eye(2),
        np.zeros((2, 0)),
        [[1, 0]],
        inputs={},
        outputs={"y": ""},
        states={"a": "", "b": ""},
        dt=1.0,
    )
    assert moving_states(constant) == []


def chain(x, p):
    return [x.v, -(p.c * x.q + p.d * x.v) / p.m]


@pytest.mark.parametrize(
    ("f", "message"),
    [
        (lambda x, u, p: [x.v, (u.F - p.c * x.q) / p.m + ca.sin(p.d * x.v)], "sin"),
        (lambda x, u, p: [x.v, (u.F - p.c * x.q) / (p.m + p.d)], r"divisor in .*\(m\+d\)"),
        (lambda x, u, p: [x.v, u.F / p.m - p.c * x.q - p.d * ca.sqrt(p.d) * x.v], "sqrt"),
        (lambda x, u, p: [p.c * x.v, u.F / p.m], "equation of 'q': it must be 'v' plus"),
        (lambda x, u, p: [x.v + p.d * x.q, u.F / p.m - p.c * x.q], "parameter 'd' may only enter"),
        (lambda x, u, p: [x.v**2, (u.F - p.c * x.q - p.d * x.v) / p.m], "equation of 'q'"),
        (lambda x, u, p: [x.v, (u.F - p.c * x.q - p.d * x.q) / p.m], "c/m, d/m .* told apart"),
        (lambda x, u, p: [x.v, p.c * x.q], "the parameters m, c, d enter by c;"),
        (lambda x, u, p: [x.v, u.F], "enter by nothing"),
    ],
)  # fmt: skip
def test_the_term_in_the_way_is_named(f, message):
    with pytest.raises(ModelError, match=message):
        affine_form(oscillator(f))


@pytest.mark.parametrize(
    ("h", "outputs"),
    [
        (lambda x, u, p: [x.v], ("y",)),
        (lambda x, u, p: [2 * x.q], ("y",)),
        (lambda x, u, p: [x.q, x.v], ("y", "z")),
    ],
)
def test_the_output_is_the_first_state(h, outputs):
    with pytest.raises(ModelError, match="one output, the first state 'q'"):
        affine_form(oscillator(lambda x, u, p: chain(x, p), h=h, outputs=outputs))


def test_order_and_time():
    parameters_first = Model(
        f=lambda x, u, p: [0, x.v, x.c * x.q],
        h=lambda x, u, p: [x.q],
        states={"c": "", **STATES},
        outputs={"y": ""},
    )
    with pytest.raises(ModelError, match="moving states first"):
        affine_form(parameters_first)
    discrete = lti(
        [[1.0]], np.zeros((1, 0)), [[1.0]], states={"a": ""}, inputs={}, outputs={"y": ""}, dt=1.0
    )
    with pytest.raises(ModelError, match="continuous"):
        affine_form(discrete)
