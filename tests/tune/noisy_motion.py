"""Recordings of linear machines in NumPy, with steps of process noise, and their likelihood."""

import numpy as np
import scipy

import backsight as bs

DT = 0.01
SIGMA_Y, SIGMA_W = 1e-3, {"q": 2e-4, "v": 1e-2}


def discrete(k=100.0, b=0.5):
    """A and B of an oscillator with held input."""
    joint = np.zeros((3, 3))
    joint[:2] = [[0, 1, 0], [-k, -b, 1]]
    whole = scipy.linalg.expm(joint * DT)
    return whole[:2, :2], whole[:2, 2:]


def oscillation(n, *, seed, k=100.0, b=0.5, sigma_y=SIGMA_Y, sigma_w=SIGMA_W):
    """A recording under a random force."""
    rng = np.random.default_rng(seed)
    A, B = discrete(k, b)
    u = rng.standard_normal((n, 1))
    steps = rng.standard_normal((n, 2)) * [sigma_w["q"], sigma_w["v"]]
    x, y = np.zeros(2), []
    for force, w in zip(u, steps, strict=True):
        y.append(x[:1])
        x = A @ x + B @ force + w
    y = np.array(y) + sigma_y * rng.standard_normal((n, 1))
    return bs.from_arrays(dt=DT, u=u, y=y, inputs={"u": "N"}, outputs={"y": "m"})


def minus_log_likelihood(recording, *, sigma_y, sigma_q, sigma_v, sigma_x0, k=100.0, b=0.5):
    """By the textbook's filter, sample by sample."""
    A, B = discrete(k, b)
    Q, R = np.diag([sigma_q**2, sigma_v**2]), sigma_y**2
    x, P, cost = np.zeros(2), sigma_x0**2 * np.eye(2), 0.0
    for y, u in zip(recording["y"].values[:, 0], recording["u"].values, strict=True):
        if np.isfinite(y):
            S = P[0, 0] + R
            e = y - x[0]
            cost += 0.5 * (e**2 / S + np.log(2 * np.pi * S))
            gain = P[:, 0] / S
            x, P = x + gain * e, P - np.outer(gain, P[0])
        x, P = A @ x + B @ u, A @ P @ A.T + Q
    return float(cost)
