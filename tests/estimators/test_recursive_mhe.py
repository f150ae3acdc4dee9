"""The recursive form against the batch form and against Kalman filters."""

import numpy as np
import pytest

from backsight.engine import vm
from backsight.errors import TuningError
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.linear_windows import LinearMHE, RecursiveMHE
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import lti
from oracles import lecture
from relations.linear import DT, A, B, C, R, Run, record

UNIT = {"noise": Noise(1.0), "prior": Prior(1.0)}


def discrete(A, B, C):
    nx, nu, ny = len(A), np.shape(B)[1], len(C)
    return lti(A, B, C, states={f"x{i}": "" for i in range(nx)}, dt=1.0,
               inputs={f"u{i}": "" for i in range(nu)},
               outputs={f"y{i}": "" for i in range(ny)})  # fmt: skip


EXAMPLE = discrete(lecture.A, lecture.B, lecture.C)
INTEGRATORS = discrete([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
UNSTABLE = discrete([[1.1, 0.3], [-0.2, 1.2]], [[0.5], [1.0]], [[1.0, 0.0]])


def test_gains_and_eigenvalues_of_the_example():
    L, L_out = RecursiveMHE(**UNIT, N=4).gains(EXAMPLE, 1.0)
    np.testing.assert_allclose(L[:, 0], lecture.L_N, rtol=0, atol=1e-9)
    np.testing.assert_allclose(L_out[:, 0], lecture.Ltilde_N, rtol=0, atol=1e-9)
    for alpha, modulus in lecture.EIGENVALUES.items():
        found = RecursiveMHE(**UNIT, N=4, alpha=alpha).eigenvalues(EXAMPLE, 1.0)
        np.testing.assert_allclose(np.abs(found), modulus, rtol=1e-9)


@pytest.mark.parametrize("plant", [EXAMPLE, UNSTABLE])
def test_eigenvalues_of_the_exact_window_are_those_of_the_inverse(plant):
    A_ = lecture.A if plant is EXAMPLE else np.array([[1.1, 0.3], [-0.2, 1.2]])
    found = RecursiveMHE(**UNIT, N=5, alpha=1.0).eigenvalues(plant, 1.0)
    expected = 1 / np.linalg.eigvals(A_)
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-9)


@pytest.mark.filterwarnings("ignore:the recursion")
@pytest.mark.parametrize("plant", [EXAMPLE, INTEGRATORS, UNSTABLE])
@pytest.mark.parametrize(("m", "N"), [(1, 4), *lecture.MULTIRATE])
def test_recursion_is_the_batch(plant, m, N):
    rng = np.random.default_rng(1)
    n = N + 6 * m
    u, y = rng.standard_normal((n, 1)), rng.standard_normal((n, 1))
    y[np.arange(n) % m != 0] = np.nan
    batch = Run(LinearMHE(**UNIT, N=N), plant, 1.0)(u, y)
    result = Run(RecursiveMHE(**UNIT, N=N, alpha=1.0, every=m), plant, 1.0)(u, y)
    size = np.abs(batch["x_hat"]).max()
    for k in range(N, N + 5 * m + 1, m):
        np.testing.assert_allclose(result["x_hat"][k], batch["x_hat"][k], rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(result["P"][k], batch["P"][k], rtol=1e-10, atol=1e-12)


@pytest.mark.filterwarnings("ignore:the recursion")
def test_several_outputs_and_inputs():
    decaying = A.copy()
    decaying[2, 2] = 0.9
    plant = lti(decaying, B, C, states=dict.fromkeys("abc", ""), inputs={"f": "", "g": ""},
                outputs={"y": "", "z": ""}, dt=DT)  # fmt: skip
    u, y = record(30, seed=2, missing=0.0)
    settings = {"noise": Noise(R=R), "prior": Prior(1.0), "N": 7}
    batch = Run(LinearMHE(**settings), plant, DT)(u, y)
    result = Run(RecursiveMHE(**settings, alpha=1.0), plant, DT)(u, y)
    np.testing.assert_allclose(result["x_hat"][:20], batch["x_hat"][:20], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(result["P"][:20], batch["P"][:20], rtol=1e-9, atol=1e-11)


@pytest.mark.filterwarnings("ignore:the recursion")
def test_interpolated_input():
    plant = lti([[0.0, 1.0], [-30.0, -0.8]], [[0.0], [2.0]], [[1.0, 0.0]], [[0.3]],
                states={"q": "", "v": ""}, inputs={"f": ""}, outputs={"y": ""})  # fmt: skip
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((12, 1)), rng.standard_normal((12, 1))
    settings = {**UNIT, "N": 5, "hold": "foh"}
    batch = Run(LinearMHE(**settings), plant, 0.1)(u, y)
    result = Run(RecursiveMHE(**settings, alpha=1.0), plant, 0.1)(u, y)
    np.testing.assert_allclose(result["x_hat"], batch["x_hat"], rtol=1e-9, atol=1e-10)


def test_rounding_errors_grow_unless_it_starts_again():
    rng = np.random.default_rng(4)
    u, y = rng.standard_normal((255, 1)), rng.standard_normal((255, 1))
    batch = Run(LinearMHE(**UNIT, N=4), EXAMPLE, 1.0)(u, y)["x_hat"]
    unstable = RecursiveMHE(**UNIT, N=4, alpha=1.0)
    with pytest.warns(UserWarning, match=r"alpha = 1 is unstable: eigenvalues 1\.149\+0\.1788j"):
        drifted = Run(unstable, EXAMPLE, 1.0)(u, y)["x_hat"]
    error = np.abs(drifted - batch).max(axis=1)
    assert error[10] < 1e-12
    assert 1e-8 < error[150] < 1e-3
    assert error[250] > 0.1
    again = Run(RecursiveMHE(**UNIT, N=4, alpha=1.0, reinitialise=20), EXAMPLE, 1.0)(u, y)["x_hat"]
    np.testing.assert_allclose(again[4:], batch[4:], rtol=0, atol=1e-11)


def test_growing_window_is_the_kalman_filter_without_prior():
    """Gains of windows that grow with k, applied one after the other, are full least squares."""
    rng = np.random.default_rng(5)
    y = rng.standard_normal((40, 1))
    rows = np.array([lecture.C[0] @ np.linalg.matrix_power(lecture.A, i) for i in range(40)])
    x = np.linalg.lstsq(rows[:2], y[:2, 0], rcond=None)[0]
    x = lecture.A @ x
    information = rows[:2].T @ rows[:2]
    for k in range(2, 40):
        prior = lecture.A @ x
        L = RecursiveMHE(**UNIT, N=k).gains(EXAMPLE, 1.0)[0][:, 0]
        x = prior + L * (y[k, 0] - prior[0])
        information = information + np.outer(rows[k], rows[k])
        first = np.linalg.lstsq(rows[: k + 1], y[: k + 1, 0], rcond=None)[0]
        ahead = np.linalg.matrix_power(lecture.A, k)
        np.testing.assert_allclose(x, ahead @ first, rtol=0, atol=1e-10)
        P = ahead @ np.linalg.solve(information, ahead.T)
        np.testing.assert_allclose(L, P @ lecture.C[0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("N", [4, 8])
@pytest.mark.parametrize("plant", [EXAMPLE, INTEGRATORS, UNSTABLE])
def test_fixed_window_is_a_steady_kalman_filter(plant, N):
    """The process noise has the rank of the outputs: A P c' (1 - c P c')^-1 c P A', c = C A^-N."""
    estimator = RecursiveMHE(**UNIT, N=N)
    fixed = LinearMHE(**UNIT, N=N).gains(plant, 1.0).P
    A_ = np.column_stack([np.array(plant.f(v, [0], [])).ravel() for v in np.eye(2)])
    c = np.array([[1.0, 0.0]]) @ np.linalg.matrix_power(np.linalg.inv(A_), N)
    noise = A_ @ fixed @ c.T @ np.linalg.solve(1 - c @ fixed @ c.T, c @ fixed @ A_.T)
    K, _ = KalmanFilter(Noise(1.0, Q=(noise + noise.T) / 2), Prior(1.0)).steady(plant, 1.0)
    np.testing.assert_allclose(estimator.gains(plant, 1.0)[0], K, rtol=0, atol=1e-10)
    assert np.abs(estimator.eigenvalues(plant, 1.0)).max() < 1


def test_shortest_window_is_deadbeat():
    found = RecursiveMHE(**UNIT, N=1).eigenvalues(EXAMPLE, 1.0)
    np.testing.assert_allclose(found, 0, atol=1e-7)


def impulses(estimator: RecursiveMHE, y: np.ndarray) -> np.ndarray:
    """Derivative of every estimate by every measurement, (n, nx, n)."""
    recursion = estimator.compile(EXAMPLE, 1.0)
    mask, columns = np.isfinite(y).astype(float), []
    for i in range(len(y)):
        impulse = np.zeros_like(y)
        impulse[i] = mask[i]
        _, outputs = vm.run(recursion, [0 * impulse, impulse, mask], carry=recursion.carry0)
        columns.append(outputs[0])
    return np.stack(columns, axis=2)


@pytest.mark.parametrize(
    ("alpha", "m", "again"), [(0.5, 1, 0), (0.5, 2, 0), (0.8, 1, 3), (0.5, 1, -1)]
)
@pytest.mark.filterwarnings("ignore:the recursion")
def test_covariance_is_that_of_the_recursion(alpha, m, again):
    """The estimate is linear in the measurements, each with unit noise: P = G G'."""
    n, N = 12, 4
    y = np.zeros((n, 1))
    y[np.arange(n) % m != 0] = np.nan
    if again < 0:
        y[7] = np.nan
    estimator = RecursiveMHE(**UNIT, N=N, alpha=alpha, every=m, reinitialise=max(again, 0))
    P = Run(estimator, EXAMPLE, 1.0)(np.zeros((n, 1)), y)["P"]
    G = impulses(estimator, y)
    for k in range(N, n):
        np.testing.assert_allclose(P[k], G[k] @ G[k].T, rtol=1e-9, atol=1e-12)


def test_wrong_descriptions():
    with pytest.raises(TuningError, match="every = 6 is more than the horizon N = 4"):
        RecursiveMHE(**UNIT, N=4, every=6)
    with pytest.raises(TuningError, match="no multiple of every = 3; use 6 or 9"):
        RecursiveMHE(**UNIT, N=8, every=3)
    with pytest.raises(TuningError, match=r"alpha is 1\.5"):
        RecursiveMHE(**UNIT, alpha=1.5)
    with pytest.raises(TuningError, match="reinitialise is -1"):
        RecursiveMHE(**UNIT, reinitialise=-1)
    delay = discrete([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    with pytest.raises(TuningError, match=r"singular.*alpha = 0 or LinearMHE"):
        RecursiveMHE(**UNIT, N=4, alpha=0.5).compile(delay, 1.0)
    assert RecursiveMHE(**UNIT, N=4).compile(delay, 1.0).carry0.shape == (5,)
    with pytest.raises(TuningError, match="no process noise"):
        RecursiveMHE(Noise(1.0, 0.1), Prior(1.0), N=4, alpha=0.2).compile(EXAMPLE, 1.0)
    hidden = discrete([[0.9, 0.0], [0.1, 0.8]], np.zeros((2, 1)), [[1.0, 0.0]])
    with pytest.raises(TuningError, match="do not see x1"):
        RecursiveMHE(**UNIT, N=4).compile(hidden, 1.0)
