"""The Kalman filter with 64 digits of binary mantissa: what rounding does to the others."""

import numpy as np

from backsight.estimators.parts.linear import Linear, linear
from backsight.types import Array
from benchmarks.long.plants import Plant


def system_of(plant: Plant) -> Linear:
    """The matrices that the estimators have, rounded to double precision as theirs."""
    return linear(plant.model, plant.dt, noise=plant.noise, prior=plant.prior, hold="zoh")


def filtered(plant: Plant, u: Array, y: Array, mask: Array) -> Array:
    """Estimates (n, nx) of the textbook's filter in extended precision, physical."""
    system = system_of(plant)
    s = system.s
    A, B, C, D, Q, R, P = (
        np.asarray(k, np.longdouble)
        for k in (system.A, system.B, system.C, system.D, s.Q, s.R, s.P0)
    )
    x = np.asarray(s.x0, np.longdouble)
    U, Y = np.asarray(u / s.su, np.longdouble), np.asarray(y / s.sy, np.longdouble)
    one, found = np.eye(len(A), dtype=np.longdouble), np.empty((len(y), len(A)))
    for k in range(len(y)):
        for i in np.flatnonzero(mask[k]):  # independent sensors, one after the other
            row = C[i]
            v = P @ row
            K = v / (row @ v + R[i, i])
            x = x + K * (Y[k, i] - row @ x - D[i] @ U[k])
            left = one - np.outer(K, row)
            P = left @ P @ left.T + np.outer(K, K) * R[i, i]
        found[k] = np.asarray(x * s.sx, float)
        x = A @ x + B @ U[k]
        P = A @ P @ A.T + Q
    return found
