"""Random linear systems of every small size: the filters are the Kalman filter."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from backsight.estimators import EKF, MHO, Noise, Prior
from backsight.models.lti import lti
from backsight.models.signals import Signal
from oracles.kalman import kalman_filter
from relations.linear import Run


def covariance(n: int, rank: int, rng: np.random.Generator) -> np.ndarray:
    F = rng.standard_normal((n, rank))
    return F @ F.T


@settings(max_examples=25)
@given(
    nx=st.integers(1, 4),
    nu=st.integers(0, 2),
    ny=st.integers(1, 3),
    rank=st.integers(0, 4),
    bounded=st.integers(0, 4),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_size(nx, nu, ny, rank, bounded, seed):
    """Sizes from one on, no inputs, singular process noise, missing samples, idle bounds."""
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((nx, nx)) / (1 + nx), rng.standard_normal((nx, nu))
    C, x0 = rng.standard_normal((ny, nx)), rng.standard_normal(nx)
    Q, P0 = covariance(nx, rank, rng), covariance(nx, nx, rng) + 0.1 * np.eye(nx)
    R = covariance(ny, ny, rng) + 0.1 * np.eye(ny)
    model = lti(
        A, B, C,
        states={f"x{i}": Signal(lower=-1e6 if i < bounded else -np.inf) for i in range(nx)},
        inputs={f"u{i}": "" for i in range(nu)},
        outputs={f"y{i}": "" for i in range(ny)},
        dt=1.0,
    )  # fmt: skip
    u, y = rng.standard_normal((12, nu)), rng.standard_normal((12, ny))
    y[rng.random(y.shape) < 0.3] = np.nan
    x, P = kalman_filter(y, u, A=A, B=B, C=C, Q=Q, R=R, x0=x0, P0=P0)
    gaussians = {"noise": Noise(R=R, Q=Q), "prior": Prior(P0=P0, x0=x0)}
    for estimator in (EKF(**gaussians), MHO(**gaussians, N=3, alpha=0.0)):
        result = Run(estimator, model, 1.0)(u, y)
        np.testing.assert_allclose(result["x_hat"], x, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(result["P"], P, rtol=1e-7, atol=1e-8)
    weighted = Run(MHO(**gaussians, N=3, alpha=1.0), model, 1.0)(u, y)
    assert np.all(np.isfinite(weighted["x_hat"]))
    assert not weighted["status"].any()
