"""The Kalman filter of the textbooks, in NumPy, and least squares over a window by QR."""

import numpy as np


def kalman_filter(y, u, *, A, B, C, Q, R, x0, P0, factor=None) -> tuple[np.ndarray, np.ndarray]:
    """Posterior means (n, nx) and covariances (n, nx, nx); rows of y that are NaN are left out.

    P+ = P - P C' (C P C' + R)^-1 C P with the rows of C and R that were measured. With `factor`,
    like y, R of a sample is that of noise so many times as large.
    """
    x, P = np.array(x0, float), np.array(P0, float)
    factor = np.ones_like(y) if factor is None else factor
    means, covariances = [], []
    for measured, command, times in zip(y, u, factor, strict=True):
        rows = np.flatnonzero(np.isfinite(measured))
        H, V = C[rows], (R * np.outer(times, times))[np.ix_(rows, rows)]
        x = x + P @ H.T @ np.linalg.solve(H @ P @ H.T + V, measured[rows] - H @ x)
        P = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + V, H @ P)
        means.append(x)
        covariances.append(P)
        x, P = A @ x + B @ command, A @ P @ A.T + Q
    return np.array(means), np.array(covariances)


def window_by_qr(y, u, *, A, B, C, R, x_bar, P) -> tuple[np.ndarray, np.ndarray]:
    """Initial state of a window without process noise, and its covariance.

    Least squares over the stacked, whitened rows of prior and measurements, solved by QR.
    """
    nx = len(x_bar)
    rows, values = [np.eye(nx)], [x_bar]
    weights = [np.linalg.cholesky(P)]
    response, transition = np.zeros(nx), np.eye(nx)
    for measured, command in zip(y, u, strict=True):
        seen = np.flatnonzero(np.isfinite(measured))
        rows.append(C[seen] @ transition)
        values.append(measured[seen] - C[seen] @ response)
        weights.append(np.linalg.cholesky(R[np.ix_(seen, seen)]) if len(seen) else np.eye(0))
        response, transition = A @ response + B @ command, A @ transition
    whitened = [
        np.linalg.solve(L, np.column_stack([H, z]))
        for L, H, z in zip(weights, rows, values, strict=True)
    ]
    stack = np.vstack(whitened)
    q, r = np.linalg.qr(stack[:, :nx])
    inverse = np.linalg.inv(r)
    return inverse @ q.T @ stack[:, nx], inverse @ inverse.T
