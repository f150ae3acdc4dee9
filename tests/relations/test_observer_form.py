"""Observers of models in other coordinates are those of the form that is written by hand."""

import casadi as ca
import numpy as np
import pytest

from backsight.engine import vm
from backsight.errors import ModelError
from backsight.estimators import AHG, HGO, Noise, Prior
from backsight.estimators.observers import AdaptiveGain
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.observer_form import moving_first, observer_form
from backsight.models.signals import Signal

DT, K, B = 0.01, 90.0, 0.6
STATES = {"q": "m", "v": "m/s"}


def model(f, h, states=STATES) -> Model:
    parameters = {"k": K, "b": B}
    return Model(
        f=f, h=h, states=states, inputs={"F": ""}, outputs={"y": ""}, parameters=parameters
    )


def mass(x, u, p):
    return [x.v, -p.k * x.q - p.b * x.v + u.F]


def run(estimator, of):
    rng, n = np.random.default_rng(3), 80
    t = DT * np.arange(n)
    u, y = np.sin(5 * t), 0.1 * np.cos(9 * t) + 1e-3 * rng.standard_normal(n)
    mask = np.ones(n)
    mask[30:40:3] = 0.0
    recursion = estimator.compile(of, DT)
    data = [u[:, None], y[:, None], mask[:, None]]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def gaussians(T, x0=(0.05, -0.3, 80.0, 0.5), P0=(0.1, 1.0, 9.0, 0.1), walk=(0.0, 0.05, 0.1, 0.0)):
    """Noise and prior of x in the coordinates T x."""
    n = len(T)
    P, Q = (T @ np.diag(np.square(v[:n])) @ T.T for v in (P0, walk))
    return {"noise": Noise(sigma_y=1e-2, Q=Q), "prior": Prior(x0=T @ x0[:n], P0=P)}


def assert_mapped(found, expected, T):
    """States of the model, T x in those written by hand."""
    np.testing.assert_allclose(found["x_hat"] @ T.T, expected["x_hat"], rtol=1e-10, atol=1e-10)
    size = np.abs(expected["P"]).max()
    np.testing.assert_allclose(T @ found["P"] @ T.T, expected["P"], rtol=1e-9, atol=1e-12 * size)
    for name in ("y_hat", "e", "S"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(found["status"], expected["status"])


TWICE = np.diag([2.0, 2.0])
SUM = np.array([[1.0, 1.0], [-K, 1.0 - B]])  # q + v, and its derivative without input
SWAPPED = np.array([[0.0, 1.0], [1.0, 0.0]])
SCALED = np.diag([1.0, 3.0])


@pytest.mark.parametrize(
    ("given", "by_hand", "T"),
    [
        pytest.param(
            model(mass, lambda x, u, p: [2 * x.q]),
            model(lambda x, u, p: [x.v, -K * x.q - B * x.v + 2 * u.F], lambda x, u, p: [x.q]),
            TWICE,
            id="output twice the first state",
        ),
        pytest.param(
            model(mass, lambda x, u, p: [x.q + x.v]),
            model(
                lambda x, u, p: [x.v + u.F, -K * x.q - B * x.v + (1 - B) * u.F],
                lambda x, u, p: [x.q],
            ),
            SUM,
            id="relative degree one",
        ),
        pytest.param(
            model(
                lambda x, u, p: [-p.k * x.q - p.b * x.v + u.F, x.v],
                lambda x, u, p: [x.q],
                {"v": "", "q": ""},
            ),
            model(mass, lambda x, u, p: [x.q]),
            SWAPPED,
            id="states in another order",
        ),
        pytest.param(
            model(lambda x, u, p: [3 * x.v, (-K * x.q + u.F) / 3 - B * x.v], lambda x, u, p: [x.q]),
            model(mass, lambda x, u, p: [x.q]),
            SCALED,
            id="scaled",
        ),
    ],
)
def test_high_gain_observer(given, by_hand, T):
    found = run(HGO(**gaussians(np.eye(2)), gain=12.0), given)
    assert_mapped(found, run(HGO(**gaussians(T), gain=12.0), by_hand), T)


def test_the_way_back_of_a_nonlinear_chain():
    """q' = (1 + q^2) v, so that z2 = (1 + q^2) v and v = z2 / (1 + q^2); the walk is that of v."""
    given = model(lambda x, u, p: [(1 + x.q**2) * x.v, -K * x.q + u.F], lambda x, u, p: [x.q])

    def z2(x, u):
        v = x.v / (1 + x.q**2)
        return 2 * x.q * x.v * v + (1 + x.q**2) * (-K * x.q + u.F)

    by_hand = model(lambda x, u, p: [x.v, z2(x, u)], lambda x, u, p: [x.q])
    q, v = 0.05, -0.3
    J = np.array([[1.0, 0.0], [2 * q * v, 1 + q**2]])
    at_start = gaussians(J, x0=(q, v))
    z0 = Prior(x0=[q, (1 + q**2) * v], P0=at_start["prior"].P0)
    none = gaussians(np.eye(2), x0=(q, v), walk=(0.0, 0.0))
    found = run(HGO(**none, gain=12.0), given)
    expected = run(HGO(Noise(sigma_y=1e-2), z0, gain=12.0), by_hand)
    q, z = expected["x_hat"].T
    v = z / (1 + q**2)
    np.testing.assert_allclose(found["x_hat"], np.column_stack([q, v]), rtol=1e-10, atol=1e-10)
    J = np.zeros((len(q), 2, 2))
    J[:, 0, 0], J[:, 1, 0], J[:, 1, 1] = 1, 2 * q * v, 1 + q**2
    mapped = J @ found["P"] @ J.transpose(0, 2, 1)
    np.testing.assert_allclose(mapped, expected["P"], rtol=1e-9, atol=1e-12)
    walking = run(HGO(**gaussians(np.eye(2), x0=(q[0], v[0])), gain=12.0), given)
    assert walking["P"][-1, 1, 1] > 1.1 * found["P"][-1, 1, 1]


ADAPTIVE = AdaptiveGain(lower=6.0, gamma=1e-3, window=0.1, every=0.02)


@pytest.mark.parametrize("adaptive", [None, ADAPTIVE], ids=["fixed", "adaptive"])
def test_adaptive_observer(adaptive):
    """States, parameters, bands, gain and excitation, with the output twice the last state."""
    given = Model(
        f=lambda x, u, p: [0, -x.k * x.q - x.b * x.v + u.F, 0, x.v],
        h=lambda x, u, p: [2 * x.q],
        states={"k": "", "v": "", "b": "", "q": ""},
        inputs={"F": ""},
        outputs={"y": ""},
    )
    plant = model(lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + 2 * u.F], lambda x, u, p: [x.q])
    T = np.zeros((4, 4))
    T[0, 3] = T[1, 1] = 2.0
    T[2, 0] = T[3, 2] = 1.0
    settings = {"gain": 12.0, "Gamma": np.array([3.0, 2.0]), "adaptive": adaptive}
    place = np.array([2, 1, 3, 0])
    x0, P0, walk = ([v[i] for i in place] for v in (
        (0.05, -0.3, 80.0, 0.5), (0.1, 1.0, 9.0, 0.1), (0.0, 0.05, 0.1, 0.0)
    ))  # fmt: skip
    found = run(AHG(**gaussians(np.eye(4), x0, P0, walk), **settings), given)
    expected = run(AHG(**gaussians(T, x0, P0, walk), **settings), augment(plant, ["k", "b"]))
    assert_mapped(found, expected, T)
    np.testing.assert_allclose(found["lam"], expected["lam"], rtol=1e-10)
    np.testing.assert_allclose(found["excitation"], expected["excitation"], rtol=1e-9)
    assert (found["lam"][-1] < 12.0) == (adaptive is not None)


def test_bounds_are_those_of_the_states():
    bounded = {"q": Signal("m", upper=0.04), "v": "m/s"}
    found = run(
        HGO(**gaussians(np.eye(2), x0=(0.0, 0.0)), gain=12.0),
        model(mass, lambda x, u, p: [2 * x.q], bounded),
    )
    assert found["x_hat"][:, 0].max() == pytest.approx(0.04, rel=1e-12)
    assert len(set(found["status"].ravel())) == 2


def test_a_chain_stays_as_it_is():
    assert observer_form(model(mass, lambda x, u, p: [x.q])).coordinates is None
    plant = model(mass, lambda x, u, p: [x.q])
    assert moving_first(plant)[0] is plant


@pytest.mark.parametrize(
    ("f", "h", "message"),
    [
        (mass, lambda x, u, p: [x.q + u.F], r"contains the input: '\(q\+F\)'|contains the input"),
        (mass, lambda x, u, p: [ca.sin(x.q)], r"the output of 'y' is 'sin\(q\)'.*there is q"),
        (
            lambda x, u, p: [x.v * (1 + u.F), -p.k * x.q],
            lambda x, u, p: [x.q],
            r"equation of 'q': the input enters by",
        ),
        (
            lambda x, u, p: [x.v, -p.b * x.v + u.F],
            lambda x, u, p: [x.v],
            "do not determine q: not observable",
        ),
        (
            lambda x, u, p: [x.v + x.q * x.v, -p.b * x.v + u.F],
            lambda x, u, p: [x.q + x.v],
            "one state that those before do not contain, and that one linearly",
        ),
    ],
)
def test_what_is_in_the_way_is_named(f, h, message):
    with pytest.raises(ModelError, match=message):
        observer_form(model(f, h))


def test_parameters_in_the_way_are_named():
    joint = augment(model(mass, lambda x, u, p: [x.q + x.v]), ["k"])
    with pytest.raises(ModelError, match=r"parameter 'k' enters derivative 1 of 'y'.*derivative 2"):
        observer_form(joint)
    held = augment(model(mass, lambda x, u, p: [p.k * x.q]), ["k"])
    with pytest.raises(ModelError, match="the output contains the constant state k"):
        HGO(**gaussians(np.eye(3)), gain=12.0).compile(held, DT)
