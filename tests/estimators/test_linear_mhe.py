"""The batch estimator against its textbook gains, dense least squares, and the Kalman filter."""

import numpy as np
import pytest

from backsight.errors import TuningError
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.linear_windows import LinearMHE
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import lti
from backsight.schema import Status
from closeness import assert_close
from oracles import lecture
from oracles.kalman import kalman_filter
from relations.linear import DT, P0, SYSTEM, X0, A, B, C, Q, R, Run, model, record

UNIT = {"noise": Noise(1.0), "prior": Prior(1.0)}


def example():
    return lti(lecture.A, lecture.B, lecture.C, states={"a": "", "b": ""}, inputs={"u": ""},
               outputs={"y": ""}, dt=1.0)  # fmt: skip


def window(y, u, *, Q, R, x_bar=None, P=None) -> tuple[np.ndarray, np.ndarray]:
    """Last state of a window and its covariance, by pseudo-inverse of all rows at once.

    Unknowns are all states; NaN rows are left out; without `x_bar` nothing is known beforehand.
    A singular Q leaves exact equations, which get a very large weight.
    """
    n, nx = len(y), len(A)
    rows, values, weights = [], [], []

    def add(blocks, value, weight):
        row = np.zeros((len(value), n * nx))
        for i, block in blocks.items():
            row[:, i * nx : (i + 1) * nx] = block
        rows.append(row)
        values.append(value)
        weights.append(weight)

    if x_bar is not None:
        add({0: np.eye(nx)}, x_bar, np.linalg.inv(np.linalg.cholesky(P)))
    for i in range(n):
        seen = np.isfinite(y[i])
        add({i: C[seen]}, y[i][seen], np.linalg.inv(np.linalg.cholesky(R[np.ix_(seen, seen)])))
        if i + 1 < n:
            values_, vectors = np.linalg.eigh(Q)
            inverse = (vectors / np.sqrt(np.maximum(values_, 1e-14))).T
            add({i: -A, i + 1: np.eye(nx)}, B @ u[i], inverse)
    stack = np.vstack([w @ r for w, r in zip(weights, rows, strict=True)])
    target = np.concatenate([w @ v for w, v in zip(weights, values, strict=True)])
    inverse = np.linalg.pinv(stack, rcond=1e-15)
    return (inverse @ target)[-nx:], (inverse @ inverse.T)[-nx:, -nx:]


def test_gains_of_the_example():
    found = LinearMHE(**UNIT, N=4).gains(example(), 1.0)
    np.testing.assert_allclose(found.M, lecture.M, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.N_u[:, :4], lecture.N_u, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.N_u[:, 4:], 0)
    ahead = np.linalg.matrix_power(lecture.A, 4)
    np.testing.assert_allclose(found.P, ahead @ lecture.P_N @ ahead.T, rtol=0, atol=1e-9)


def test_full_window_is_the_product_with_the_gains():
    estimator = LinearMHE(Noise(R=R), Prior(1.0), N=6)
    gains = estimator.gains(model(), DT)
    u, y = record(30, seed=1, missing=0.0)
    result = Run(estimator, model(), DT)(u, y)
    for k in range(6, 30):
        window_ = slice(k - 6, k + 1)
        expected = gains.M @ y[window_].ravel() + gains.N_u @ u[window_].ravel()
        np.testing.assert_allclose(result["x_hat"][k], expected, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(result["P"][k], gains.P, rtol=1e-12)
    assert not result["status"].any()


@pytest.mark.parametrize("noise", [np.zeros((3, 3)), Q, Q + 1e-3 * np.eye(3)])
def test_missing_samples_are_left_out(noise):
    u, y = record(25, seed=2, missing=0.4)
    result = Run(LinearMHE(Noise(R=R, Q=noise), Prior(1.0), N=8), model(), DT)(u, y)
    assert not result["status"].any()
    for k in range(8, 25):
        x, P = window(y[k - 8 : k + 1], u[k - 8 : k + 1], Q=noise, R=R)
        np.testing.assert_allclose(result["x_hat"][k], x, rtol=2e-5, atol=2e-5)
        np.testing.assert_allclose(result["P"][k], P, rtol=2e-5, atol=2e-6)


def test_every_channel_has_its_own_rate():
    u, y = record(30, seed=10, missing=0.0)
    k = np.arange(30)
    y[k % 2 != 0, 0] = np.nan
    y[k % 3 != 1, 1] = np.nan
    result = Run(LinearMHE(Noise(R=R), Prior(1.0), N=9), model(), DT)(u, y)
    for i in range(9, 30):
        x, P = window(y[i - 9 : i + 1], u[i - 9 : i + 1], Q=np.zeros((3, 3)), R=R)
        np.testing.assert_allclose(result["x_hat"][i], x, rtol=2e-5, atol=2e-5)
        np.testing.assert_allclose(result["P"][i], P, rtol=2e-5, atol=2e-6)


def test_half_filled_window_uses_the_prior():
    u, y = record(9, seed=3, missing=0.2)
    prior = Prior(P0=P0, x0=X0)
    result = Run(LinearMHE(Noise(R=R, Q=Q), prior, N=9), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-11)
    assert_close(result["P"], P, 1e-11)


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_full_arrival_cost_gives_the_kalman_filter(missing):
    u, y = record(50, seed=4, missing=missing)
    settings = {"noise": Noise(R=R, Q=Q), "prior": Prior(P0=P0, x0=X0)}
    mhe = Run(LinearMHE(**settings, N=5, arrival_weight=1.0), model(), DT)(u, y)
    kf = Run(KalmanFilter(**settings), model(), DT)(u, y)
    for name in ("x_hat", "P", "e", "S"):
        assert_close(mhe[name], kf[name], 1e-10)


def test_many_states():
    """Beyond the size at which the filters change to loops over matrices."""
    n = 13
    chain = 0.9 * np.eye(n) + 0.3 * np.eye(n, k=1)
    plant = lti(chain, np.ones((n, 1)), np.eye(n)[::3], dt=1.0, inputs={"u": ""},
                states={f"x{i}": "" for i in range(n)},
                outputs={f"y{i}": "" for i in range(5)})  # fmt: skip
    rng = np.random.default_rng(11)
    u, y = rng.standard_normal((12, 1)), rng.standard_normal((12, 5))
    y[4:6, 1] = np.nan
    settings = {"noise": Noise(0.5, 0.1), "prior": Prior(1.0)}
    kf = Run(KalmanFilter(**settings), plant, 1.0)(u, y)
    mhe = Run(LinearMHE(**settings, N=4, arrival_weight=1.0), plant, 1.0)(u, y)
    for name in ("x_hat", "P"):
        assert_close(mhe[name], kf[name], 1e-9)


def test_arrival_cost_has_its_weight():
    u, y = record(20, seed=5, missing=0.2)
    settings = {"noise": Noise(R=R, Q=Q + 1e-3 * np.eye(3)), "prior": Prior(P0=P0, x0=X0)}
    result = Run(LinearMHE(**settings, N=4, arrival_weight=0.3), model(), DT)(u, y)
    kf = Run(KalmanFilter(**settings), model(), DT)(u, y)
    for k in range(5, 20):
        x_bar = A @ kf["x_hat"][k - 5] + B @ u[k - 5]
        P = A @ kf["P"][k - 5] @ A.T + Q + 1e-3 * np.eye(3)
        x, spread = window(y[k - 4 : k + 1], u[k - 4 : k + 1], Q=Q + 1e-3 * np.eye(3), R=R,
                           x_bar=x_bar, P=P / 0.3)  # fmt: skip
        np.testing.assert_allclose(result["x_hat"][k], x, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(result["P"][k], spread, rtol=1e-8, atol=1e-11)


@pytest.mark.parametrize(("m", "N"), lecture.MULTIRATE)
def test_every_mth_sample_is_the_multirate_formula(m, N):
    """At slow instants the estimate is A^N (Phi'Phi)^-1 Phi' Y with the rows of slow samples."""
    rng = np.random.default_rng(6)
    n = 5 * m + N + 1
    y = rng.standard_normal((n, 1))
    y[np.arange(n) % m != 0] = np.nan
    result = Run(LinearMHE(**UNIT, N=N), example(), 1.0)(np.zeros((n, 1)), y)
    for k in range(N, n, m):
        expected = lecture.MULTIRATE[m, N] @ y[k - N : k + 1 : m, 0]
        np.testing.assert_allclose(result["x_hat"][k], expected, rtol=0, atol=1e-9)


def test_interpolated_input():
    plant = lti([[0.0, 1.0], [-30.0, -0.8]], [[0.0], [2.0]], [[1.0, 0.0]],
                states={"q": "", "v": ""}, inputs={"f": ""}, outputs={"y": ""})  # fmt: skip
    rng = np.random.default_rng(7)
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((40, 1))
    settings = {"noise": Noise(0.1, 0.01), "prior": Prior(1.0), "hold": "foh"}
    kf = Run(KalmanFilter(**settings), plant, DT)(u, y)
    mhe = Run(LinearMHE(**settings, N=5, arrival_weight=1.0), plant, DT)(u, y)
    assert_close(mhe["x_hat"], kf["x_hat"], 1e-10)
    batch = LinearMHE(Noise(0.1), Prior(1.0), N=5, hold="foh")
    whole = Run(batch, plant, DT)(u, y)["x_hat"]
    y[-3] = np.nan
    gaps = Run(batch, plant, DT)(u, y)["x_hat"]
    assert_close(whole[:-3], gaps[:-3], 1e-12)
    gains = batch.gains(plant, DT)
    np.testing.assert_allclose(
        whole[36], gains.M @ y[31:37, 0] + gains.N_u @ u[31:37, 0], rtol=1e-10
    )


def test_window_that_does_not_determine_the_state_is_reported():
    u, y = record(40, seed=8, missing=0.0)
    y[15:26] = np.nan
    settings = {"noise": Noise(R=R), "prior": Prior(P0=P0, x0=X0)}
    result = Run(LinearMHE(**settings, N=6), model(), DT)(u, y)
    unobserved = (result["status"].astype(int) & int(Status.UNOBSERVED)) != 0
    assert unobserved[22:26].all()
    assert not unobserved[:19].any()
    assert not unobserved[33:].any()
    kf = Run(KalmanFilter(**settings), model(), DT)(u, y)
    np.testing.assert_allclose(result["x_hat"][25], kf["x_hat"][25], rtol=1e-9)


def test_wrong_descriptions():
    for N in (0, 2.5):
        with pytest.raises(TuningError, match="horizon N"):
            LinearMHE(**UNIT, N=N)
    with pytest.raises(TuningError, match="arrival_weight is 2"):
        LinearMHE(**UNIT, arrival_weight=2)
    three = lti(np.eye(3, k=1), np.zeros((3, 0)), [[1.0, 0, 0]], states=dict.fromkeys("abc", ""),
                inputs={}, outputs={"y": ""}, dt=1.0)  # fmt: skip
    with pytest.raises(TuningError, match=r"holds 2 measured samples, fewer than .* index 3"):
        LinearMHE(**UNIT, N=1).compile(three, 1.0)
    hidden = lti(np.diag([0.9, 0.8]), np.zeros((2, 0)), [[1.0, 0.0]], dt=1.0,
                 states={"seen": "", "unseen": ""}, inputs={}, outputs={"y": ""})  # fmt: skip
    with pytest.raises(TuningError, match="do not see unseen"):
        LinearMHE(**UNIT).compile(hidden, 1.0)


def test_arrival_cost_stands_in_for_what_the_outputs_do_not_see():
    hidden = lti(np.diag([0.9, 0.8]), np.zeros((2, 0)), [[1.0, 0.0]], dt=1.0,
                 states={"seen": "", "unseen": ""}, inputs={}, outputs={"y": ""})  # fmt: skip
    settings = {"noise": Noise(0.3, 0.1), "prior": Prior(1.0, x0=[0.5, 2.0])}
    y, u = np.random.default_rng(9).standard_normal((20, 1)), np.zeros((20, 0))
    mhe = Run(LinearMHE(**settings, N=4, arrival_weight=1.0), hidden, 1.0)(u, y)
    kf = Run(KalmanFilter(**settings), hidden, 1.0)(u, y)
    assert_close(mhe["x_hat"], kf["x_hat"], 1e-10)
    assert_close(mhe["P"], kf["P"], 1e-10)
