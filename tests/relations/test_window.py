"""On a linear system every window of the observer is a linear least-squares problem."""

import numpy as np
import pytest

from backsight.estimators import MHO
from closeness import assert_close
from oracles.kalman import kalman_filter, window_by_qr
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, A, B, Q, R, Run, model, record

N = 5


@pytest.mark.parametrize("alpha", [1.0, 0.03])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_every_window_is_least_squares(missing, alpha):
    """The whole chain of pre-filter, window and post-filter, with QR and textbook filters."""
    u, y = record(30, seed=1, missing=missing)
    observer = MHO(**GAUSSIANS, N=N, alpha=alpha, bands="filters")
    result = Run(observer, model(), DT)(u, y)
    x, P = X0, P0
    for t in range(N, len(u)):
        window = slice(t - N, t + 1)
        means, covariances = kalman_filter(
            y[window][:1], u[window][:1], **SYSTEM, Q=Q, R=R, x0=x, P0=P
        )
        x_start, P_start = window_by_qr(
            y[window], u[window], **SYSTEM, R=R / alpha, x_bar=means[0], P=covariances[0]
        )
        np.testing.assert_allclose(result["x_start"][t], x_start, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result["P_start"][t], P_start, rtol=1e-9, atol=1e-11)
        x, P = A @ x_start + B @ u[t - N], A @ covariances[0] @ A.T + Q
        after = slice(t - N + 1, t + 1)
        means, covariances = kalman_filter(y[after], u[after], **SYSTEM, Q=Q, R=R, x0=x, P0=P)
        np.testing.assert_allclose(result["x_hat"][t], means[-1], rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result["P"][t], covariances[-1], rtol=1e-9, atol=1e-11)
    assert result["iterations"][N:].max() <= 2


def test_before_the_window_is_full_it_is_the_filter():
    u, y = record(N, seed=2, missing=0.0)
    result = Run(MHO(**GAUSSIANS, N=N), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-12)
    assert_close(result["P"], P, 1e-12)
    assert not result["iterations"].any()


def test_window_begins_at_the_first_measurement():
    """Samples before any measurement shift the window; the prior drifts with the model."""
    u, y = record(20, seed=3, missing=0.0)
    y[:4] = np.nan
    result = Run(MHO(**GAUSSIANS, N=N), model(), DT)(u, y)
    x, P = X0, P0
    for k in range(4):
        x, P = A @ x + B @ u[k], A @ P @ A.T + Q
    assert not result["iterations"][: 4 + N].any()
    means, covariances = kalman_filter(y[4:5], u[4:5], **SYSTEM, Q=Q, R=R, x0=x, P0=P)
    x_start, P_start = window_by_qr(
        y[4 : 5 + N], u[4 : 5 + N], **SYSTEM, R=R, x_bar=means[0], P=covariances[0]
    )
    np.testing.assert_allclose(result["x_start"][4 + N], x_start, rtol=1e-10)
    np.testing.assert_allclose(result["P_start"][4 + N], P_start, rtol=1e-9)
