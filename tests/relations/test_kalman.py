"""On a linear Gaussian system the extended filter is the Kalman filter."""

import numpy as np
import pytest
from scipy.linalg import expm

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF, Noise, Prior
from backsight.models.lti import lti
from closeness import assert_close
from oracles.kalman import kalman_filter
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, A, C, Q, R, Run, model, record


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_discrete_model(missing):
    u, y = record(80, seed=1, missing=missing)
    result = Run(EKF(**GAUSSIANS), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-11)
    assert_close(result["P"], P, 1e-11)
    assert_close(result["y_hat"], x @ C.T, 1e-11)


def test_innovation_and_its_covariance():
    """Prediction and S of the first two samples written out, with correlated noise."""
    u, y = record(2, seed=2, missing=0.0)
    result = Run(EKF(**GAUSSIANS), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    x_prior = A @ x[0] + SYSTEM["B"] @ u[0]
    assert_close(result["e"], np.array([y[0] - C @ X0, y[1] - C @ x_prior]), 1e-12)
    ahead = A @ P[0] @ A.T + Q
    assert_close(result["S"], np.array([C @ P0 @ C.T + R, C @ ahead @ C.T + R]), 1e-12)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize(
    ("covariance", "substeps", "tolerance"),
    [("transition", 128, 2e-5), ("transition", 256, 5e-6), ("ode", 64, 3e-9)],
)
def test_continuous_model_with_small_steps(covariance, substeps, tolerance, hold):
    """Against exact matrices: matrix exponential for the state, Van Loan's for the noise."""
    F = np.array([[0.0, 1.0], [-30.0, -0.8]])
    G, H = np.array([[0.0], [2.0]]), np.array([[1.0, 0.0]])
    Qc, V, P_start = np.diag([0.02, 0.5]), np.array([[1e-3]]), np.diag([0.3, 2.0])
    plant = lti(F, G, H, states={"q": "", "v": ""}, inputs={"f": ""}, outputs={"y": ""})
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((50, 1)), rng.standard_normal((50, 1))
    filter_ = EKF(
        Noise(R=V, Qc=Qc), Prior(P0=P_start), Integrator("rk4", substeps, hold), covariance
    )
    result = Run(filter_, plant, DT)(u, y)

    van_loan = expm(DT * np.block([[-F, Qc], [np.zeros((2, 2)), F.T]]))
    Phi = van_loan[2:, 2:].T
    held, ramp = exact_inputs(F, G)
    u_next = np.vstack([u[1:], u[-1:]])
    steps = np.hstack([u, u_next - u]) if hold == "foh" else np.hstack([u, 0 * u])
    x, P = kalman_filter(
        y, steps, A=Phi, B=np.hstack([held, ramp]), C=H, Q=Phi @ van_loan[:2, 2:], R=V,
        x0=np.zeros(2), P0=P_start,
    )  # fmt: skip
    assert_close(result["x_hat"], x, tolerance)
    assert_close(result["P"], P, tolerance)


def test_covariance_per_sample_is_exact():
    """``discrete`` adds Q once per sample and is exact in the state for exact steps."""
    F, G, H = np.array([[0.0, 1.0], [-30.0, -0.8]]), np.zeros((2, 0)), np.array([[1.0, 0.0]])
    Q_sample, V = np.array([[1e-3, 2e-4], [2e-4, 4e-3]]), np.array([[1e-3]])
    plant = lti(F, G, H, states={"q": "", "v": ""}, inputs={}, outputs={"y": ""})
    y, u = np.random.default_rng(4).standard_normal((40, 1)), np.zeros((40, 0))
    filter_ = EKF(Noise(R=V, Q=Q_sample), Prior(1.0), Integrator("dopri5", 20), "discrete")
    result = Run(filter_, plant, DT)(u, y)
    x, P = kalman_filter(
        y, u, A=expm(F * DT), B=G, C=H, Q=Q_sample, R=V, x0=np.zeros(2), P0=np.eye(2)
    )
    assert_close(result["x_hat"], x, 1e-9)
    assert_close(result["P"], P, 1e-9)


def exact_inputs(F: np.ndarray, G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What an input held at 1, and one that rises from 0 to 1, add in one period."""
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:3], block[2, 3] = F, G, 1.0 / DT
    power = expm(block * DT)
    return power[:2, 2:3], power[:2, 3:4]
