"""The same windows with a square instead of the l1 norm: what sparsity is good for."""

import numpy as np
import xarray as xr

from backsight.types import Array
from backsight_studies.beam.evaluate import window_mse
from backsight_studies.beam.plant import N, forces, sampled
from backsight_studies.beam.tuning import Setting

VARIANCES = np.exp(np.arange(-4.0, 15.0))
"""Of the forces that are looked for [N2]; the best one counts."""


def best_ridge(thickness: float, setting: Setting, recording: xr.Dataset) -> float:
    """Least mean square error of all windows over the variance of the forces [N2]."""
    y, d = recording["y"].values, forces()
    return min(float(window_mse(solutions(thickness, setting, y, q), d).mean()) for q in VARIANCES)


def solutions(thickness: float, setting: Setting, y: Array, variance: float) -> Array:
    """Forces (windows, steps, nodes) that minimise the cost with alpha'alpha / variance.

    Forces looked for and forces in the background are independent: their sum is found, and the
    former are a fixed share of it.
    """
    A, B, C = sampled(thickness)
    nx, nodes = B.shape
    total = variance + setting.eps_Q
    rows, seen = np.eye(nx, nx + N * nodes), []
    for k in range(N + 1):
        seen.append(C @ rows)
        rows = A @ rows
        if k < N:
            rows[:, nx + k * nodes : nx + (k + 1) * nodes] += B
    G = np.vstack(seen)
    ahead = np.hstack([A, B, np.zeros((nx, (N - 1) * nodes))])
    mean, P = np.zeros(nx), setting.eps_Q * B @ B.T
    found = []
    for first in range(len(y) - N):
        window = y[first : first + N + 1].ravel()
        prior = np.diag(np.full(nx + N * nodes, total))
        prior[:nx, :nx] = P
        S = G @ prior @ G.T + setting.eps_R * np.eye(len(G))
        K = np.linalg.solve(S, G @ prior).T
        z = np.concatenate([mean, np.zeros(N * nodes)])
        z = z + K @ (window - G @ z)
        posterior = prior - K @ G @ prior
        mean, P = ahead @ z, ahead @ posterior @ ahead.T
        found.append(variance / total * z[nx:].reshape(N, nodes))
    return np.array(found)
