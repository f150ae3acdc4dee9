import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from backsight.errors import DataError, ModelError, TuningError
from backsight.models.builtin import duffing, sdof
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.run.simulation import simulate

DT = 1e-2
OSCILLATOR = sdof(k=400.0, b=1.0, c=2.0)


def drive(n, seed=1):
    return np.random.default_rng(seed).standard_normal(n)


def exact_step(A, B, u, x, h):
    """One step of x' = A x + B u by the matrix exponential."""
    nx = len(A)
    block = np.zeros((nx + 1, nx + 1))
    block[:nx, :nx], block[:nx, nx] = A, B * u
    return (expm(block * h) @ [*x, 1.0])[:nx]


def oscillator(k, b):
    return np.array([[0.0, 1.0], [-k, -b]]), np.array([0.0, 2.0])


def test_linear_model_equals_the_matrix_exponential():
    u = drive(50)
    r = simulate(OSCILLATOR, u, dt=DT, x0={"q": 0.3})
    A, B = oscillator(400.0, 1.0)
    x = np.array([0.3, 0.0])
    for k, held in enumerate(u):
        np.testing.assert_allclose(r["x_true"][k, :2], x, rtol=0, atol=1e-10)
        x = exact_step(A, B, held, x, DT)


def test_duffing_with_ramped_input_and_disturbance_equals_a_tight_variable_step_solver():
    model = duffing(k1=30.0, d=0.5, k3=40.0, b=3.0)
    n, dt = 40, 0.05
    u, time = drive(n), np.arange(40) * 0.05
    r = simulate(
        model, u, dt=dt, x0=[0.5, -1.0], hold="foh", disturbances={"v": lambda t: np.sin(4 * t)},
        substeps=80,
    )  # fmt: skip

    def rhs(t, x):
        force = 3.0 * np.interp(t, time, u) + np.sin(4 * t)
        return [x[1], -30.0 * x[0] - 0.5 * x[1] - 40.0 * x[0] ** 3 + force]

    x = np.array([0.5, -1.0])
    for k in range(n - 1):
        span = (time[k], time[k + 1])
        x = solve_ivp(rhs, span, x, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(r["x_true"][k + 1, :2], x, rtol=0, atol=1e-6)


def test_without_a_disturbance_duffing_is_exact_to_the_order_of_the_method():
    model = duffing(k1=30.0, d=0.5, k3=40.0)
    r = simulate(model, np.zeros(30), dt=0.05, x0=[1.0, 0.0])
    reference = solve_ivp(
        lambda _, x: [x[1], -30.0 * x[0] - 0.5 * x[1] - 40.0 * x[0] ** 3],
        (0, 1.5), [1.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=r["time"].values,
    )  # fmt: skip
    np.testing.assert_allclose(r["x_true"][:, :2], reference.y.T, rtol=0, atol=1e-9)


@pytest.mark.parametrize("inside", [0.0, 0.25])
def test_a_jump_changes_parameters_and_keeps_the_state_continuous(inside):
    moment = (20 + inside) * DT
    r = simulate(OSCILLATOR, np.zeros(40), dt=DT, x0=[1.0, 0.0], changes={moment: {"k": 900.0}})
    before, after = oscillator(400.0, 1.0), oscillator(900.0, 1.0)
    x = np.array([1.0, 0.0])
    for k in range(40):
        np.testing.assert_allclose(r["x_true"][k, :2], x, rtol=0, atol=1e-9)
        assert r["x_true"][k].sel(state="k") == (900.0 if k * DT >= moment else 400.0)
        if k == 20:
            x = exact_step(*before, 0.0, x, inside * DT)
            x = exact_step(*after, 0.0, x, (1 - inside) * DT)
        else:
            x = exact_step(*(before if k < 20 else after), 0.0, x, DT)


def test_a_disturbance_is_like_an_input_of_gain_one():
    u, push = drive(60), drive(60, seed=2)
    both = simulate(OSCILLATOR, u, dt=DT, disturbances={"v": push})
    combined = simulate(OSCILLATOR, u + push / 2.0, dt=DT)
    np.testing.assert_allclose(both["y"], combined["y"], rtol=0, atol=1e-13)


def test_the_blocks_do_not_show(monkeypatch):
    arguments = {
        "dt": DT,
        "x0": [1.0, 0.0],
        "changes": {0.3: {"b": 5.0}},
        "disturbances": {"v": np.cos},
        "sigma_y": 1e-3,
        "hold": "foh",
    }
    whole = simulate(OSCILLATOR, drive(100), **arguments)
    monkeypatch.setattr("backsight.run.simulation._simulate.BLOCK", 37)
    assert whole.identical(simulate(OSCILLATOR, drive(100), **arguments))


def test_a_discrete_model_is_iterated():
    model = lti(
        [[0.9, 0.1], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 0.0]],
        states={"a": "m", "b": "m"}, inputs={"u": "N"}, outputs={"y": "m"}, dt=DT,
    )  # fmt: skip
    u, push = drive(30), drive(30, seed=2)
    r = simulate(model, u, dt=DT, x0=[1.0, 2.0], disturbances={"a": push})
    x = np.array([1.0, 2.0])
    for k in range(30):
        np.testing.assert_allclose(r["x_true"][k], x, rtol=1e-13)
        x = np.array([[0.9, 0.1], [0.0, 0.5]]) @ x + [push[k], u[k]]


def test_the_noise_is_reproducible_and_has_the_stated_size():
    u = np.zeros(2000)
    first, again, other = (
        simulate(OSCILLATOR, u, dt=DT, sigma_y=0.2, seed=s)["y"].values for s in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, again)
    assert abs(np.mean(first)) < 4 * 0.2 / np.sqrt(2000)
    assert abs(np.std(first) / 0.2 - 1) < 4 / np.sqrt(2 * 2000)
    assert abs(np.corrcoef(first[:, 0], other[:, 0])[0, 1]) < 4 / np.sqrt(2000)
    np.testing.assert_array_equal(first[:, 0], 0.2 * np.random.default_rng(5).standard_normal(2000))


def test_outputs_see_the_input_of_their_own_sample():
    model = Model(
        f=lambda x, u, p: [u.a], h=lambda x, u, p: [x.s + u.b, p.g * u.a],
        states={"s": "m"}, inputs={"a": "m/s", "b": "m"}, outputs={"y": "m", "z": "m"},
        parameters={"g": 3.0},
    )  # fmt: skip
    a, b = drive(5), drive(5, seed=2)
    r = simulate(model, {"b": b, "a": a}, dt=0.5, changes={1.0: {"g": 4.0}, 1.75: {"g": 5.0}})
    s = np.concatenate([[0.0], np.cumsum(a)[:-1]]) * 0.5
    np.testing.assert_allclose(r["y"].sel(output="y"), s + b, atol=1e-14)
    np.testing.assert_allclose(r["y"].sel(output="z"), a * [3, 3, 4, 4, 5])
    assert list(r["state_unit"].values) == ["m", ""]


def test_a_model_without_inputs():
    model = Model(
        f=lambda x, u, p: [-x.s], h=lambda x, u, p: [x.s], states={"s": 1.0}, outputs={"y": ""}
    )
    r = simulate(model, np.empty((4, 0)), dt=0.1)
    np.testing.assert_allclose(r["y"][:, 0], np.exp(-0.1 * np.arange(4)), rtol=1e-12)


@pytest.mark.parametrize(
    ("u", "arguments", "error", "message"),
    [
        (np.zeros((5, 2)), {}, DataError, r"shape \(5, 2\); it must be \(samples, 1\)"),
        ([], {}, DataError, "no samples"),
        ([0.0, np.nan], {}, DataError, "input 'u' is nan at sample 1"),
        (["a"], {}, DataError, "not an array of numbers"),
        ({"w": [0.0]}, {}, ModelError, "u names 'w'"),
        ({}, {}, ModelError, "no values for u"),
        ([0.0], {"dt": 0.0}, DataError, "must be positive"),
        ([0.0], {"parameters": {"kk": 1.0}}, ModelError, "did you mean 'k'"),
        ([0.0], {"parameters": {"k": np.inf}}, DataError, "finite"),
        ([0.0], {"changes": {1.0: {"k": 2.0}}}, DataError, "change at 1 s lies outside"),
        ([0.0], {"changes": {0.0: {"q": 2.0}}}, ModelError, "the change at 0 s names 'q'"),
        ([0.0], {"disturbances": {"w": [1.0]}}, ModelError, "no state 'w'"),
        ([0.0], {"disturbances": {"v": [1.0, 2.0]}}, DataError, "one value for each of the 1"),
        ([0.0], {"disturbances": {"v": [np.nan]}}, DataError, "is nan at sample 0"),
        ([0.0], {"disturbances": {"v": lambda t: [1.0]}}, DataError, "functions of NumPy"),
        ([0.0], {"disturbances": {"v": lambda t: np.nan}}, DataError, "not finite"),
        ([0.0], {"sigma_y": -1.0}, DataError, "must not be negative"),
        ([0.0], {"x0": {"p": 1.0}}, ModelError, "x0 names 'p'"),
        ([0.0], {"x0": np.nan}, DataError, "x0"),
        ([0.0], {"substeps": 0}, TuningError, "substeps"),
        ([0.0], {"hold": "spline"}, TuningError, "hold"),
        (np.zeros(300), {"parameters": {"k": -1e9}, "x0": 1.0}, DataError, "finite at t = "),
    ],
)
def test_wrong_arguments_are_refused(u, arguments, error, message):
    with pytest.raises(error, match=message):
        simulate(OSCILLATOR, u, **({"dt": DT} | arguments))


def test_a_discrete_model_refuses_another_period():
    model = lti(
        [[1.0]], [[1.0]], [[1.0]], states={"s": ""}, inputs={"u": ""}, outputs={"y": ""}, dt=0.1
    )
    with pytest.raises(DataError, match=r"dt = 0.1 s; it cannot be simulated with 0.2 s"):
        simulate(model, [0.0], dt=0.2)
