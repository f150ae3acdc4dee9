"""A motion that sensors without noise measure, and its estimates by dense conditioning."""

import numpy as np

import backsight as bs

DT, N = 0.05, 40
A = np.array([[1.0, DT], [-4.0 * DT, 1.0 - 0.4 * DT]])
Q, P0 = np.diag([0.0, 0.02**2]), np.diag([0.04, 1.0])
FILTERS = (bs.KalmanFilter, bs.EKF, bs.IEKF, bs.UKF)

SENSORS = {
    "one": ([[1.0, 0.0]], np.zeros((1, 1))),
    "with a noisy one": ([[1.0, 0.0], [1.0, 0.0]], np.diag([0.0, 1e-4])),
    "noisy one first": ([[0.3, 1.0], [1.0, 0.0]], np.diag([1e-4, 0.0])),
    "both states": (np.eye(2), np.zeros((2, 2))),
    "two of one thing": ([[1.0, 0.0], [2.0, 0.0]], np.zeros((2, 2))),
    "their difference": ([[1.0, 0.1], [1.0, 0.0]], np.full((2, 2), 1e-4)),
    "two with the same noise": ([[1.0, 0.0], [1.0, 0.0]], np.full((2, 2), 1e-4)),
}


def plant(C):
    states, outputs = {"q": "m", "v": "m/s"}, {f"y{i}": "m" for i in range(len(C))}
    return bs.lti(A, np.zeros((2, 0)), C, states=states, inputs={}, outputs=outputs, dt=DT)


def drawn(C, R, seed=0):
    """A motion and what is measured of it, of which the sensors are exact combinations."""
    rng = np.random.default_rng(seed)
    values, axes = np.linalg.eigh(R)
    root, x, y = axes * np.sqrt(np.maximum(values, 0)), np.array([0.1, 0.5]), []
    for _ in range(N):
        y.append(C @ x + root @ rng.standard_normal(len(C)))
        x = A @ x + np.sqrt(np.diag(Q)) * rng.standard_normal(2)
    y = np.array(y)
    y[5:8, 0] = np.nan
    return y


def conditioned(C, R, y, *, smoothed=False):
    """Estimates given all measurements so far: the least deviations that explain them exactly.

    Smoothed, given all measurements.

    The start, the noise of every sample and that of the sensors are L z with z of variance one;
    measurements are M z = y, so that z = M^+ y and what is left of it is I - M^+ M.
    """
    n, ny = len(y), len(C)
    walk, sensor = np.diag(np.sqrt(np.diag(Q))), np.linalg.eigh(R)
    root = sensor.eigenvectors * np.sqrt(np.maximum(sensor.eigenvalues, 0))
    effect = np.zeros((2, 2 * n + ny * n))
    effect[:, :2] = np.diag(np.sqrt(np.diag(P0)))
    rows, goal, means, covariances, every = [], [], [], [], []
    for k in range(n):
        shown = C @ effect
        shown[:, 2 * n + ny * k : 2 * n + ny * (k + 1)] = root
        rows += list(shown[np.isfinite(y[k])])
        goal += list(y[k][np.isfinite(y[k])])
        inverse = np.linalg.pinv(np.array(rows), rcond=1e-12)
        means.append(effect @ inverse @ goal)
        left = effect - effect @ inverse @ np.array(rows)
        covariances.append(left @ left.T)
        every.append(effect)
        effect = A @ effect
        if k + 1 < n:
            effect[:, 2 * (k + 1) : 2 * (k + 2)] = walk
    if smoothed:
        left = [effect - effect @ inverse @ np.array(rows) for effect in every]
        return np.array([effect @ inverse @ goal for effect in every]), np.array(
            [part @ part.T for part in left]
        )
    return np.array(means), np.array(covariances)
