"""The Kalman filter against the textbook's, and its steady state."""

import numpy as np
import pytest
from scipy.linalg import expm

from backsight.errors import ModelError, TuningError
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.builtin import duffing
from backsight.models.lti import lti
from closeness import assert_close
from oracles.kalman import kalman_filter
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, A, C, Q, R, Run, model, record
from relations.test_kalman import exact_inputs

F, G, H = np.array([[0.0, 1.0], [-30.0, -0.8]]), np.array([[0.0], [2.0]]), np.array([[1.0, 0.0]])
QC, V = np.diag([0.02, 0.5]), np.array([[1e-3]])


def oscillator():
    return lti(F, G, H, states={"q": "m", "v": "m/s"}, inputs={"f": ""}, outputs={"y": "m"})


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_discrete_model(missing):
    u, y = record(80, seed=1, missing=missing)
    result = Run(KalmanFilter(**GAUSSIANS), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-11)
    assert_close(result["P"], P, 1e-11)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_continuous_model_is_exact(hold):
    """Matrix exponential for the state and Van Loan's for the noise, with one step per sample."""
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((50, 1)), rng.standard_normal((50, 1))
    filter_ = KalmanFilter(Noise(R=V, Qc=QC), Prior(P0=np.diag([0.3, 2.0])), hold=hold)
    result = Run(filter_, oscillator(), DT)(u, y)
    van_loan = expm(DT * np.block([[-F, QC], [np.zeros((2, 2)), F.T]]))
    Phi = van_loan[2:, 2:].T
    held, ramp = exact_inputs(F, G)
    u_next = np.vstack([u[1:], u[-1:]]) if hold == "foh" else u
    x, P = kalman_filter(
        y, np.hstack([u, u_next - u]), A=Phi, B=np.hstack([held, ramp]), C=H,
        Q=Phi @ van_loan[:2, 2:], R=V, x0=np.zeros(2), P0=np.diag([0.3, 2.0]),
    )  # fmt: skip
    assert_close(result["x_hat"], x, 1e-11)
    assert_close(result["P"], P, 1e-11)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("steady", [False, True])
def test_many_states(hold, steady):
    """Seven oscillators in one model are seven filters, for the loops over matrices."""
    n = 7
    blocks = [np.array([[0.0, 1.0], [-(i + 1.0), -0.1]]) for i in range(n)]
    big = np.zeros((2 * n, 2 * n))
    for i, block in enumerate(blocks):
        big[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
    names = {f"x{i}": "" for i in range(2 * n)}
    outputs = {f"y{i}": "" for i in range(n)}
    many = lti(big, np.ones((2 * n, 1)), np.kron(np.eye(n), H), states=names, inputs={"u": ""},
               outputs=outputs)  # fmt: skip
    rng = np.random.default_rng(8)
    u, y = rng.standard_normal((30, 1)), rng.standard_normal((30, n))
    y[4, 2] = y[9, 3] = np.nan
    settings = {"hold": hold, "steady_state": steady}
    together = Run(KalmanFilter(Noise(0.1, 0.02), Prior(1.0), **settings), many, DT)(u, y)
    for i, block in enumerate(blocks):
        one = lti(block, np.ones((2, 1)), H, states={"q": "", "v": ""}, inputs={"u": ""},
                  outputs={"y": ""})  # fmt: skip
        alone = Run(KalmanFilter(Noise(0.1, 0.02), Prior(1.0), **settings), one, DT)(
            u, y[:, i : i + 1]
        )
        part = slice(2 * i, 2 * i + 2)
        assert_close(together["x_hat"][:, part], alone["x_hat"], 1e-10)
        assert_close(together["P"][:, part, part], alone["P"], 1e-10)


def steady_model():
    decaying = A.copy()
    decaying[2, 2] = 0.95
    return lti(decaying, SYSTEM["B"], C, states=dict.fromkeys("abc", ""), inputs={"f": "", "g": ""},
               outputs={"y": "", "z": ""}, dt=DT), decaying  # fmt: skip


def test_steady_gain_is_where_the_filter_ends():
    plant, decaying = steady_model()
    filter_ = KalmanFilter(Noise(R=R, Q=Q), Prior(1.0), steady_state=True)
    K, P = filter_.steady(plant, DT)
    _, covariances = kalman_filter(
        np.zeros((900, 2)), np.zeros((900, 2)), A=decaying, B=SYSTEM["B"], C=C, Q=Q, R=R,
        x0=X0, P0=P0,
    )  # fmt: skip
    prior = decaying @ covariances[-1] @ decaying.T + Q
    np.testing.assert_allclose(P, prior, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(K, covariances[-1] @ C.T @ np.linalg.inv(R), rtol=1e-9, atol=1e-12)


def test_steady_filter_reports_the_covariance_of_its_own_gain():
    """Riccati with the constant gain in Joseph's form, rows that were not measured left out."""
    plant, decaying = steady_model()
    u, y = record(60, seed=5, missing=0.3)
    filter_ = KalmanFilter(Noise(R=R, Q=Q), Prior(P0=P0, x0=X0), steady_state=True)
    result = Run(filter_, plant, DT)(u, y)
    K, _ = filter_.steady(plant, DT)
    x, P = X0, P0
    for k in range(60):
        seen = np.isfinite(y[k])
        gain = K * seen
        x = x + gain @ np.nan_to_num(y[k] - C @ x)
        P = (np.eye(3) - gain @ C) @ P @ (np.eye(3) - gain @ C).T + gain @ R @ gain.T
        np.testing.assert_allclose(result["x_hat"][k], x, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result["P"][k], P, rtol=1e-9, atol=1e-12)
        x, P = decaying @ x + SYSTEM["B"] @ u[k], decaying @ P @ decaying.T + Q


def test_scales_are_internal():
    """A prior in other sizes changes the scaling, not the steady gain."""
    plant, _ = steady_model()
    gains = [
        KalmanFilter(Noise(R=R, Q=Q), Prior(sigma)).steady(plant, DT)[0]
        for sigma in (1.0, [1e-3, 10.0, 1e4])
    ]
    np.testing.assert_allclose(gains[0], gains[1], rtol=1e-9, atol=1e-12)


def test_wrong_descriptions():
    noise, prior = Noise(0.1, 0.01), Prior(1.0)
    with pytest.raises(TuningError, match="unknown hold 'cubic'"):
        KalmanFilter(noise, prior, hold="cubic").compile(oscillator(), DT)
    with pytest.raises(TuningError, match=r"foh.*continuous"):
        KalmanFilter(Noise(R=R, Q=Q), Prior(1.0), hold="foh").compile(model(), DT)
    with pytest.raises(ModelError, match=r"'v' is nonlinear.*EKF"):
        KalmanFilter(noise, prior).compile(duffing(k1=1.0, d=0.1, k3=3.0), DT)
    with pytest.raises(TuningError, match="no steady state"):
        KalmanFilter(Noise(R=R, Q=Q), Prior(1.0), steady_state=True).compile(model(), DT)
