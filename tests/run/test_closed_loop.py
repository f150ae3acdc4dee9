import numpy as np
import pytest
from scipy.linalg import expm

from backsight.errors import DataError, ModelError, TuningError
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.run.simulation import simulate_closed_loop

A, B = np.array([[0.0, 1.0], [-9.0, -0.4]]), np.array([0.0, 2.0])
K = np.array([30.0, 5.0])
DT, N = 0.02, 200


def plant(**changes) -> Model:
    given = {
        "f": lambda x, u, p: [x.v, -p.k * x.q - 0.4 * x.v + 2.0 * u.F],
        "h": lambda x, u, p: [x.q + 0.01 * u.F],
        "states": {"q": "m", "v": "m/s"},
        "inputs": {"F": "N"},
        "outputs": {"y": "m"},
        "parameters": {"k": (9.0, "1/s2")},
    }
    return Model(**(given | changes))


def law(x, r):
    return [K[0] * (r.target - x.q) - K[1] * x.v]


def loop(model=None, controller=law, reference=None, **settings):
    target = {"target": np.sin(np.arange(N) * 0.1)} if reference is None else reference
    return simulate_closed_loop(model or plant(), controller, target, dt=DT, **settings)


def by_matrix_exponential(target, *, jump: int | None = None, k=9.0):
    """The same loop, exact for an input that is held."""
    x, states, inputs = np.array([0.1, 0.0]), [], []
    for i, r in enumerate(target):
        if i == jump:
            k = 20.0
        F = K[0] * (r - x[0]) - K[1] * x[1]
        states.append(x)
        inputs.append(F)
        block = np.zeros((3, 3))
        block[:2, :2], block[:2, 2] = [[0.0, 1.0], [-k, -0.4]], B
        step = expm(block * DT)
        x = step[:2, :2] @ x + step[:2, 2] * F
    return np.array(states), np.array(inputs)


@pytest.mark.parametrize("jump", [None, 77])
def test_linear_loop(jump):
    changes = {} if jump is None else {jump * DT: {"k": 20.0}}
    result = loop(x0={"q": 0.1}, changes=changes, substeps=40)
    x, F = by_matrix_exponential(np.sin(np.arange(N) * 0.1), jump=jump)
    np.testing.assert_allclose(result["x_true"].values[:, :2], x, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["u"].values[:, 0], F, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result["y"].values[:, 0], x[:, 0] + 0.01 * F, rtol=0, atol=1e-7)
    k = result["x_true"].sel(state="k").values
    np.testing.assert_array_equal(k, np.where(np.arange(N) >= (jump or N), 20.0, 9.0))


def test_noise_is_only_in_the_measurement():
    quiet, noisy = loop(), loop(sigma_y=0.1, seed=3)
    np.testing.assert_array_equal(noisy["u"].values, quiet["u"].values)
    expected = 0.1 * np.random.default_rng(3).standard_normal((N, 1))
    np.testing.assert_allclose(noisy["y"].values - quiet["y"].values, expected, atol=1e-15)
    assert noisy.attrs["seed"] == 3


def test_controller_by_name_and_long_recordings():
    reference = {"target": np.ones(2500)}
    as_list = loop(reference=reference)
    as_dict = loop(controller=lambda x, r: {"F": law(x, r)[0]}, reference=reference)
    np.testing.assert_array_equal(as_list["x_true"].values, as_dict["x_true"].values)
    assert as_list["x_true"].values[-1, 0] == pytest.approx(60 / 69, rel=1e-6)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"controller": lambda x, r: [0.0, 1.0]}, ModelError, "2 values for 1 inputs: F"),
        ({"controller": lambda x, r: {"G": 0.0}}, ModelError, "returns G; the inputs are F"),
        ({"controller": lambda x, r: [None]}, ModelError, "not a number or expression"),
        ({"controller": lambda x, r: [r.aim - x.q]}, ModelError, "no reference 'aim'"),
        ({"controller": lambda x, r: [x.p]}, ModelError, "no state 'p'"),
        ({"controller": lambda x, r: [1e9 * x.q]}, DataError, "no longer finite at t ="),
        ({"reference": {}}, DataError, "references"),
        ({"reference": {"target": np.ones((3, 2))}}, DataError, "columns of equal length"),
        ({"reference": {"target": [np.nan]}}, DataError, "finite at every sample"),
        ({"reference": {"target": []}}, DataError, "not empty"),
        ({"x0": {"q": np.inf}}, DataError, "must be finite"),
        ({"sigma_y": -1.0}, DataError, "sigma_y"),
        ({"changes": {1e9: {"k": 1.0}}}, DataError, "outside the recording"),
        ({"changes": {0.1: {"q": 1.0}}}, ModelError, "names 'q'"),
        ({"substeps": 0}, TuningError, "substeps"),
        ({"model": lti(np.eye(1), B=np.eye(1), C=np.eye(1), states={"a": ""}, inputs={"F": ""},
                       outputs={"y": ""}, dt=DT)}, ModelError, "continuous-time"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(settings, error, message):
    settings = {"x0": {"q": 0.1}} | settings
    with np.errstate(all="ignore"), pytest.raises(error, match=message):
        loop(**settings)
