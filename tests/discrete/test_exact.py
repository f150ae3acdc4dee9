"""Exact discretisation: against SciPy's, closed forms, a fine integration, and itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from backsight.discrete.exact import foh, zoh
from backsight.errors import ModelError

STAGE = np.array([[0.0, 1.0], [-7e6, -77.0]]), np.array([[0.0], [5.4e5]])  # um, V
SYSTEMS = {
    "stage": (*STAGE, 1e-4),
    "double integrator": (np.diag([1.0], 1), np.array([[0.0], [1.0]]), 0.3),
    "overdamped": (np.array([[0, 1], [-1e4, -2e6]]), np.array([[0.0, 1.0], [1.0, 0.0]]), 1e-3),
    "random": (
        np.random.default_rng(5).standard_normal((6, 6)),
        np.random.default_rng(6).standard_normal((6, 3)),
        0.7,
    ),
}
each_system = pytest.mark.parametrize(("A", "B", "dt"), SYSTEMS.values(), ids=SYSTEMS.keys())


@each_system
def test_held_input_equals_scipy(A: np.ndarray, B: np.ndarray, dt: float) -> None:
    C, D = np.eye(len(A)), np.zeros(B.shape)
    expected = cont2discrete((A, B, C, D), dt, method="zoh")
    for ours, theirs in zip(zoh(A, B, dt=dt), expected, strict=False):
        close(ours, theirs)


@each_system
def test_interpolated_input_equals_scipy(A: np.ndarray, B: np.ndarray, dt: float) -> None:
    # SciPy shifts the state, z = x - B1 u, so that only u_k is left in its equation:
    # its B is B0 + Ad B1, and with C = I its D is B1.
    Ad, B0, B1 = foh(A, B, dt=dt)
    C, D = np.eye(len(A)), np.zeros(B.shape)
    theirs = cont2discrete((A, B, C, D), dt, method="foh")
    close(Ad, theirs[0])
    close(B0 + Ad @ B1, theirs[1])
    close(B1, theirs[3])


@each_system
def test_both_holds_agree_on_a_constant_input(A: np.ndarray, B: np.ndarray, dt: float) -> None:
    _, Bd = zoh(A, B, dt=dt)
    _, B0, B1 = foh(A, B, dt=dt)
    close(B0 + B1, Bd)


@each_system
def test_two_periods_are_one_of_twice_the_length(A: np.ndarray, B: np.ndarray, dt: float) -> None:
    Ad, Bd = zoh(A, B, dt=dt)
    A2, B2 = zoh(A, B, dt=2 * dt)
    close(Ad @ Ad, A2)
    close(Ad @ Bd + Bd, B2)
    # A straight line through three samples: u, (u + w) / 2, w.
    _, B0, B1 = foh(A, B, dt=dt)
    _, C0, C1 = foh(A, B, dt=2 * dt)
    close(Ad @ (B0 + B1 / 2) + B0 / 2, C0)
    close(Ad @ B1 / 2 + B0 / 2 + B1, C1)


def test_double_integrator_in_closed_form() -> None:
    h = 0.3
    A, B = np.diag([1.0], 1), [[0.0], [1.0]]
    Ad, Bd = zoh(A, B, dt=h)
    close(Ad, [[1, h], [0, 1]])
    close(Bd, [[h**2 / 2], [h]])
    _, B0, B1 = foh(A, B, dt=h)
    close(B0, [[h**2 / 3], [h / 2]])
    close(B1, [[h**2 / 6], [h / 2]])


def test_a_sample_of_the_stage() -> None:
    # Scaled exact solution after 0.1 ms from an independent implementation of eq. 37.
    k, b, c, w = 1.1 * 7e6, 0.9 * 70, 0.7 * 8e5, 0.25e5
    Ad, Bd = zoh([[0, 1], [-k, -b]], [[0, 0], [c, 1]], dt=1e-4)
    x = Ad @ [0.3 * 5, -0.4 * 1e4] + Bd @ [0.35 * 5, w]
    np.testing.assert_allclose(x / [5, 1e4], [0.2108154075884235, -0.48602533329828845], rtol=1e-11)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_equals_a_fine_integration(hold: str) -> None:
    A, B, dt = SYSTEMS["random"]
    rng = np.random.default_rng(7)
    x, u, u_next = rng.standard_normal(6), rng.standard_normal(3), rng.standard_normal(3)
    slope = (u_next - u) / dt * (hold == "foh")
    if hold == "zoh":
        Ad, Bd = zoh(A, B, dt=dt)
        exact = Ad @ x + Bd @ u
    else:
        Ad, B0, B1 = foh(A, B, dt=dt)
        exact = Ad @ x + B0 @ u + B1 @ u_next
    close(exact, rk4(lambda t, z: A @ z + B @ (u + slope * t), x, dt, steps=2000))


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 2.0))
@settings(max_examples=30, deadline=None, derandomize=True)
def test_steady_state_stays(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((4, 4)) - 5 * np.eye(4)
    B, u = rng.standard_normal((4, 2)), rng.standard_normal(2)
    x = np.linalg.solve(A, -B @ u)
    Ad, Bd = zoh(A, B, dt=dt)
    np.testing.assert_allclose(Ad @ x + Bd @ u, x, atol=1e-11)


def test_no_inputs() -> None:
    Ad, Bd = zoh(np.zeros((2, 2)), np.zeros((2, 0)), dt=1.0)
    close(Ad, np.eye(2))
    assert Bd.shape == (2, 0)
    assert foh(np.zeros((2, 2)), np.zeros((2, 0)), dt=1.0)[2].shape == (2, 0)


@pytest.mark.parametrize(
    ("A", "B", "dt", "reason"),
    [
        ([[0, 1]], [[1]], 1.0, r"A has the shape \(1, 2\); it must be square"),
        ([[0.0]], [1.0], 1.0, r"B has the shape \(1,\); it must have 1 rows"),
        ([[0.0]], [[1.0], [1.0]], 1.0, r"B has the shape \(2, 1\)"),
        ([[np.nan]], [[1.0]], 1.0, "not finite"),
        ([[0.0]], [[1.0]], 0.0, "sampling period dt is 0.0; it must be positive"),
        ([[0.0]], [[1.0]], np.inf, "sampling period dt is inf"),
    ],
)
@pytest.mark.parametrize("discretise", [zoh, foh])
def test_wrong_arguments_are_refused(discretise, A, B, dt: float, reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        discretise(A, B, dt=dt)


def close(ours: object, theirs: object) -> None:
    theirs = np.asarray(theirs)
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12 * np.abs(theirs).max())


def rk4(f, x: np.ndarray, dt: float, *, steps: int) -> np.ndarray:
    h = dt / steps
    for i in range(steps):
        t = i * h
        k1 = f(t, x)
        k2 = f(t + h / 2, x + h / 2 * k1)
        k3 = f(t + h / 2, x + h / 2 * k2)
        k4 = f(t + h, x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x
