"""Synthetic results: a Kalman filter on an oscillator, written out in plain NumPy."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import expm

DT = 0.01


def oscillator() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C, Q, R of an oscillator with displacement and acceleration measured."""
    Ac = np.array([[0.0, 1.0], [-40.0, -0.8]])
    Bc = np.array([[0.0], [1.0]])
    both = expm(DT * np.block([[Ac, Bc], [np.zeros((1, 3))]]))
    C = np.array([[1.0, 0.0], [-40.0, -0.8]])
    return both[:2, :2], both[:2, 2:], C, np.diag([1e-8, 1e-4]), np.diag([4e-6, 2.5e-3])


def filtered(
    n: int = 300,
    *,
    seed: int = 1,
    missing: Callable[[np.random.Generator, np.ndarray], np.ndarray] | None = None,
    noise_factor: float = 1.0,
    states: tuple[str, str] = ("q", "v"),
) -> xr.Dataset:
    """A result of the optimal filter; `noise_factor` makes it believe in another noise."""
    rng = np.random.default_rng(seed)
    A, B, C, Q, R = oscillator()
    u = np.sign(rng.standard_normal((n, 1)))
    x = np.empty((n, 2))
    x[0] = rng.normal([0.0, 0.0], [0.02, 0.1])
    for k in range(1, n):
        x[k] = A @ x[k - 1] + B @ u[k - 1] + rng.multivariate_normal([0, 0], Q)
    y = x @ C.T + rng.multivariate_normal([0, 0], R, size=n)
    if missing is not None:
        y = missing(rng, y)

    Q, R = noise_factor * Q, noise_factor * R
    m, P = np.zeros(2), noise_factor * np.diag([0.02**2, 0.1**2])
    rows = []
    for k in range(n):
        e, S = y[k] - C @ m, C @ P @ C.T + R
        seen = np.isfinite(y[k])
        K = P @ C[seen].T @ np.linalg.inv(S[np.ix_(seen, seen)])
        m, P = m + K @ e[seen], P - K @ C[seen] @ P
        rows.append((m, P, C @ m, e, S))
        m, P = A @ m + B @ u[k], A @ P @ A.T + Q
    x_hat, cov, y_hat, e, S = (np.array(v) for v in zip(*rows, strict=True))
    return xr.Dataset(
        {
            "x_hat": (("time", "state"), x_hat),
            "x_std": (("time", "state"), np.sqrt(np.einsum("kii->ki", cov))),
            "P": (("time", "state", "state_"), cov),
            "y_hat": (("time", "output"), y_hat),
            "e": (("time", "output"), e),
            "S": (("time", "output", "output_"), S),
            "status": (("time",), np.zeros(n, int)),
            "u": (("time", "input"), u),
            "y": (("time", "output"), y),
            "x_true": (("time", "state"), x),
        },
        coords={
            "time": DT * np.arange(n),
            "state": list(states),
            "output": ["q_m", "a_m"],
            "input": ["F"],
            "state_unit": ("state", ["m", "m/s"]),
            "output_unit": ("output", ["m", "m/s2"]),
            "input_unit": ("input", ["N/kg"]),
        },
        attrs={"dt": DT, "estimator": "KF", "model": "oscillator", "us_per_sample": 1.5},
    )


def gaps(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    """Acceleration at every third sample, displacement lost at random, and a total outage."""
    y = y.copy()
    y[np.arange(len(y)) % 3 != 0, 1] = np.nan
    y[rng.random(len(y)) < 0.1, 0] = np.nan
    y[len(y) // 2 : len(y) // 2 + 5] = np.nan
    return y


@pytest.fixture(name="filtered", scope="session")
def _filtered() -> Callable[..., xr.Dataset]:
    return filtered


@pytest.fixture(scope="session")
def result() -> xr.Dataset:
    """Everything measured."""
    return filtered()


@pytest.fixture(scope="session")
def gappy() -> xr.Dataset:
    """Several rates and missing samples."""
    return filtered(missing=gaps)
