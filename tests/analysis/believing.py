"""Recordings of an oscillator with some noise, filtered by one that may believe in another."""

import numpy as np
import xarray as xr

from backsight.estimators import KalmanFilter, Noise, Prior
from backsight.models.lti import lti
from backsight.run.diagnosis._factors_of_results import factors_of, with_factors

DT = 0.01
A = np.array([[0.998, 0.00996], [-0.3984, 0.990]])
B = np.array([[5e-5], [0.00996]])
Q, R, P0 = np.diag([1e-8, 1e-4]), np.array([[4e-6]]), np.diag([4e-4, 1e-2])
NAMES = {"states": {"q": "m", "v": "m/s"}, "inputs": {"F": "N/kg"}, "outputs": {"y": "m"}}
MODEL = lti(A, B, [[1.0, 0.0]], dt=DT, **NAMES)
FILTER = KalmanFilter(Noise(R=R, Q=Q), Prior(P0=P0))


def results(
    seeds: int,
    *,
    n: int = 2400,
    R_true: float = 1.0,
    Q_true: float = 1.0,
    gain: float = 1.0,
    missing: float = 0.0,
    force: float = 0.0,
) -> list[xr.Dataset]:
    """One result per seed, with what its noise factors are found to be.

    `R_true` and `Q_true` are the true variances relative to those that the filter believes in,
    `gain` is that of the true actuator, `missing` the share of samples that are not measured, and
    `force` the size of a vibration of the true machine that the filter does not know of.
    """
    rng = np.random.default_rng(7)
    u = np.repeat(np.sign(rng.standard_normal((n // 5 + 1, seeds))), 5, axis=0)[:n]
    x = rng.standard_normal((seeds, 2)) * np.sqrt(np.diag(P0))
    hum = force * np.sin(2 * np.pi * 9.0 * DT * np.arange(n))
    truth, y = np.empty((n, seeds, 2)), np.empty((n, seeds))
    for k in range(n):
        truth[k] = x
        y[k] = x[:, 0] + np.sqrt(R_true * R[0, 0]) * rng.standard_normal(seeds)
        noise = np.sqrt(Q_true * np.diag(Q)) * rng.standard_normal((seeds, 2))
        x = x @ A.T + (gain * u[k] + hum[k])[:, None] * B[:, 0] + noise
    y[rng.random(n) < missing] = np.nan
    return _filtered(u, y, truth)


def _filtered(u: np.ndarray, y: np.ndarray, truth: np.ndarray) -> list[xr.Dataset]:
    """Results for all columns; what is not measured is so in all of them."""
    m, P, rows = np.zeros((u.shape[1], 2)), P0, []
    for command, measured in zip(u, y, strict=True):
        e, S = measured - m[:, 0], P[0, 0] + R[0, 0]
        if np.isfinite(measured).all():
            K = P[:, 0] / S
            m, P = m + np.outer(e, K), P - np.outer(K, P[0])
        rows.append((m, P, e, S))
        m, P = m @ A.T + np.outer(command, B[:, 0]), A @ P @ A.T + Q
    x, cov, e, S = (np.array(v) for v in zip(*rows, strict=True))
    return [
        _result(u[:, s], y[:, s], truth[:, s], x=x[:, s], P=cov, e=e[:, s], S=S)
        for s in range(u.shape[1])
    ]


def _result(
    u: np.ndarray,
    y: np.ndarray,
    truth: np.ndarray,
    *,
    x: np.ndarray,
    P: np.ndarray,
    e: np.ndarray,
    S: np.ndarray,
) -> xr.Dataset:
    result = xr.Dataset(
        {
            "x_hat": (("time", "state"), x),
            "x_std": (("time", "state"), np.sqrt(np.einsum("kii->ki", P))),
            "P": (("time", "state", "state_"), P),
            "y_hat": (("time", "output"), x[:, :1]),
            "e": (("time", "output"), e[:, None]),
            "S": (("time", "output", "output_"), S[:, None, None]),
            "status": ("time", np.zeros(len(u), int)),
            "u": (("time", "input"), u[:, None]),
            "y": (("time", "output"), y[:, None]),
            "x_true": (("time", "state"), truth),
        },
        coords={"time": DT * np.arange(len(u)), **{k[:-1]: list(v) for k, v in NAMES.items()}},
        attrs={"dt": DT, "estimator": "kf"},
    )
    return with_factors(result, factors_of(result, FILTER, MODEL))
