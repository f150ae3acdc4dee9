"""On a linear Gaussian system moving horizon estimation is the Kalman filter and its smoother."""

import numpy as np
import pytest

from backsight.data import from_arrays
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native
from backsight.estimators import (
    EKF,
    MHE,
    ConstantArrival,
    EKFArrival,
    NoArrival,
    Noise,
    Prior,
    SmoothedArrival,
    UKFArrival,
)
from backsight.models.structures.second_order import second_order
from backsight.run.estimation import estimate
from backsight.solvers.box import GaussNewton
from closeness import assert_close
from oracles.kalman import kalman_filter
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, A, B, C, Q, R, Run, model, record

EXACT = (EKFArrival(), UKFArrival(), SmoothedArrival())
ONCE = GaussNewton(1, tolerance=0.0)


def smoother(u, y, *, Q=Q, P0=P0):
    """Filter and Rauch-Tung-Striebel smoother with a pseudo-inverse, (n, nx) and (n, nx, nx)."""
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    xs, Ps = x.copy(), P.copy()
    for k in reversed(range(len(u) - 1)):
        ahead = A @ P[k] @ A.T + Q
        G = P[k] @ A.T @ np.linalg.pinv(ahead)
        xs[k] = x[k] + G @ (xs[k + 1] - A @ x[k] - B @ u[k])
        Ps[k] = P[k] + G @ (Ps[k + 1] - ahead) @ G.T
    return xs, Ps


@pytest.mark.parametrize("arrival", EXACT, ids=lambda a: type(a).__name__)
@pytest.mark.parametrize("optimiser", [ONCE, GaussNewton()], ids=["once", "converged"])
def test_newest_sample_is_the_kalman_filter(arrival, optimiser):
    u, y = record(60, seed=1, missing=0.3)
    result = Run(MHE(**GAUSSIANS, N=5, arrival=arrival, optimiser=optimiser), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-12)
    assert_close(result["P"], P, 1e-12)
    extended = Run(EKF(**GAUSSIANS), model(), DT)(u, y)
    for name in ("y_hat", "e", "S"):
        assert_close(result[name], extended[name], 1e-12)
    assert not result["status"].any()


@pytest.mark.parametrize("arrival", EXACT, ids=lambda a: type(a).__name__)
@pytest.mark.parametrize("lag", [1, 5])
def test_lag_is_the_fixed_lag_smoother(arrival, lag):
    """The smoother of the data so far, `lag` samples before their end."""
    u, y = record(20, seed=2, missing=0.3)
    result = Run(MHE(**GAUSSIANS, N=5, arrival=arrival, lag=lag, optimiser=ONCE), model(), DT)(u, y)
    for k in (lag, 7, 12, 19):
        xs, Ps = smoother(u[: k + 1], y[: k + 1])
        assert_close(result["x_hat"][k][None], xs[k - lag][None], 1e-9)
        assert_close(result["P"][k][None], Ps[k - lag][None], 1e-9)


def test_results_with_lag_are_put_to_their_samples():
    """The last rows know all of the recording; innovations are those of the row's own sample."""
    u, y = record(25, seed=2, missing=0.3)
    channels = {"inputs": {"f": "", "g": ""}, "outputs": {"y": "", "z": ""}}
    recording = from_arrays(u=u, y=y, dt=DT, **channels)
    lagged, newest = (
        estimate(MHE(**GAUSSIANS, N=5, lag=lag, optimiser=ONCE), model(), recording)
        for lag in (4, 0)
    )
    for k in (0, 9, 20):
        xs, Ps = smoother(u[: k + 5], y[: k + 5])
        assert_close(lagged["x_hat"].values[k][None], xs[k][None], 1e-9)
        assert_close(lagged["P"].values[k][None], Ps[k][None], 1e-9)
    xs, Ps = smoother(u, y)
    assert_close(lagged["x_hat"].values[-4:], xs[-4:], 1e-9)
    assert_close(lagged["P"].values[-4:], Ps[-4:], 1e-9)
    for name in ("e", "S"):
        np.testing.assert_allclose(lagged[name].values, newest[name].values, atol=1e-12)


def test_long_window_is_full_information():
    """A window as long as the recording; while it fills the lag leads to the first sample."""
    u, y = record(12, seed=3, missing=0.2)
    result = Run(MHE(**GAUSSIANS, N=30, lag=30, optimiser=ONCE), model(), DT)(u, y)
    for k in (0, 4, 11):
        xs, Ps = smoother(u[: k + 1], y[: k + 1])
        assert_close(result["x_hat"][k][None], xs[0][None], 1e-9)
        assert_close(result["P"][k][None], Ps[0][None], 1e-9)


@pytest.mark.parametrize("arrival", EXACT, ids=lambda a: type(a).__name__)
def test_singular_covariances(arrival):
    """No process noise in one direction and none at all; a state that is known exactly."""
    u, y = record(40, seed=4, missing=0.2)
    P_known = np.diag([1.0, 0.0, 0.5])
    for Q_singular in (np.zeros((3, 3)), np.diag([1e-3, 0.0, 0.0])):
        given = {"noise": Noise(R=R, Q=Q_singular), "prior": Prior(P0=P_known, x0=X0)}
        result = Run(MHE(**given, N=4, arrival=arrival, optimiser=ONCE), model(), DT)(u, y)
        x, P = kalman_filter(y, u, **SYSTEM, Q=Q_singular, R=R, x0=X0, P0=P_known)
        assert_close(result["x_hat"], x, 1e-9)
        assert_close(result["P"], P, 1e-9)


@pytest.mark.parametrize("arrival", [NoArrival(), ConstantArrival(), SmoothedArrival(naive=True)])
def test_other_arrival_costs_are_not(arrival):
    u, y = record(60, seed=1, missing=0.0)
    result = Run(MHE(**GAUSSIANS, N=5, arrival=arrival, optimiser=ONCE), model(), DT)(u, y)
    x, _ = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"][:6], x[:6], 1e-12)
    assert np.abs(result["x_hat"] - x).max() > 1e-2


def test_no_arrival_is_least_squares_over_the_window():
    """Against the estimate with nothing known before the window, by dense least squares."""
    u, y = record(14, seed=5, missing=0.0)
    estimator = MHE(**GAUSSIANS, N=8, arrival=NoArrival(), optimiser=GaussNewton())
    result = Run(estimator, model(), DT)(u, y)
    x, P = window_least_squares(u[5:], y[5:])
    assert_close(result["x_hat"][13][None], x[None], 1e-7)
    assert_close(result["P"][13][None], P[None], 1e-4)


def window_least_squares(u, y):
    """Unknowns are the first state and the noise in the two directions that have any."""
    root = np.linalg.cholesky(Q[:2, :2])
    n, white = len(u), np.linalg.inv(np.linalg.cholesky(R))
    size = 3 + 2 * (n - 1)
    T, t = np.zeros((3, size)), np.zeros(3)
    T[:, :3] = np.eye(3)
    rows, right = [np.eye(size)[3:]], [np.zeros(size - 3)]
    for k in range(n):
        rows.append(white @ C @ T)
        right.append(white @ (y[k] - C @ t))
        last_T, last_t = T, t
        if k < n - 1:
            T, t = A @ T, A @ t + B @ u[k]
            T[:2, 3 + 2 * k : 5 + 2 * k] += root
    stacked = np.vstack(rows)
    z, *_ = np.linalg.lstsq(stacked, np.concatenate(right), rcond=None)
    return last_T @ z + last_t, last_T @ np.linalg.inv(stacked.T @ stacked) @ last_T.T


def test_constant_parameters_are_one_value_per_window():
    """Without any walk nothing changes; with one it is added when the window moves."""
    u, y = record(40, seed=6, missing=0.1)
    still = Run(MHE(**GAUSSIANS, N=4, constant=("c",), optimiser=ONCE), model(), DT)(u, y)
    plain = Run(MHE(**GAUSSIANS, N=4, optimiser=ONCE), model(), DT)(u, y)
    for name in ("x_hat", "P"):
        assert_close(still[name], plain[name], 1e-12)
    walk = Q + np.diag([0.0, 0.0, 1e-2])
    given = {"noise": Noise(R=R, Q=walk), "prior": GAUSSIANS["prior"]}
    first, last = (
        Run(MHE(**given, N=4, constant=("c",), lag=lag, optimiser=ONCE), model(), DT)(u, y)
        for lag in (4, 0)
    )
    assert_close(first["x_hat"][:, 2:], last["x_hat"][:, 2:], 1e-11)
    filtered, P = kalman_filter(y, u, **SYSTEM, Q=walk, R=R, x0=X0, P0=P0)
    assert np.abs(last["x_hat"] - filtered).max() > 1e-3
    # The value is one, its error is not: the truth walks inside the window, too. No estimate
    # from the same data has a smaller covariance than the Kalman filter's.
    assert np.linalg.eigvalsh(last["P"] - P).min() > -1e-12
    assert (last["P"] - P)[5:, 2, 2].min() > 1e-6


def test_engines_agree_when_steps_are_judged():
    u, y = record(50, seed=7, missing=0.2)
    estimator = MHE(**GAUSSIANS, N=4, lag=2)
    recursion = estimator.compile(model(((-0.5, 0.8), (-1, 1), (-9, 9))), DT)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = native.run(recursion, data, carry=recursion.carry0)
    expected = Run(estimator, model(((-0.5, 0.8), (-1, 1), (-9, 9))), DT)(u, y)
    for channel, values in zip(recursion.channels, outputs, strict=True):
        assert_close(channel.unpack(values), expected[channel.name], 1e-8)


def test_inactive_bounds_change_nothing():
    u, y = record(40, seed=8, missing=0.2)
    free = Run(MHE(**GAUSSIANS, N=5, lag=2), model(), DT)(u, y)
    wide = Run(MHE(**GAUSSIANS, N=5, lag=2), model(((-50.0, 50.0),) * 3), DT)(u, y)
    for name in ("x_hat", "P", "e", "S", "status"):
        np.testing.assert_allclose(wide[name], free[name], rtol=1e-9, atol=1e-12)


def test_nothing_measured_is_prediction_with_growing_bands():
    u, y = record(40, seed=9, missing=0.0)
    y[10:] = np.nan
    result = Run(MHE(**GAUSSIANS, N=5), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-10)
    assert_close(result["P"], P, 1e-10)
    assert not result["status"].any()


@pytest.mark.parametrize("arrival", EXACT, ids=lambda a: type(a).__name__)
def test_many_states(arrival):
    """Seven masses in a row, 14 states: beyond what is unrolled."""
    n = 7
    K = 400.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    row = second_order(
        np.eye(n), 0.002 * K, K, forces={"F": "q1"}, inputs={"F": "N"},
        outputs={"a": ("displacement", "q1"), "b": ("displacement", "q7")},
    )  # fmt: skip
    rng = np.random.default_rng(10)
    u, y = rng.standard_normal((12, 1)), 0.01 * rng.standard_normal((12, 2))
    y[5, 0] = np.nan
    given = (Noise(sigma_y=1e-3, sigma_w=1e-2), Prior(0.1), Integrator("heun", 2))
    filtered = Run(EKF(*given, covariance="discrete"), row, 2e-3)(u, y)
    noise, prior, integrator = given
    window = MHE(noise, prior, N=4, arrival=arrival, integrator=integrator, optimiser=ONCE)
    result = Run(window, row, 2e-3)(u, y)
    for name in ("x_hat", "e"):
        assert_close(result[name], filtered[name], 1e-9)
    for name in ("P", "S"):
        # By the deviations of both: masses that are far apart have correlations of 1e-11.
        std = np.sqrt(np.einsum("kii->ki", filtered[name]))
        apart = np.abs(result[name] - filtered[name]) / (std[:, :, None] * std[:, None, :])
        assert apart.max() < 1e-12
