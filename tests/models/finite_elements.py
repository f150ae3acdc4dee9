"""Small finite-element models: plane Euler-Bernoulli beams with a consistent mass matrix."""

import numpy as np

from backsight.models.lti import state_space


def beam_matrices(n, *, length=1.0, free=False, lumped=False, E=210e9, rho=7850.0, b=0.02, h=0.005):
    """Mass and stiffness of n elements: deflection and slope of every node, clamped at the left."""
    area, inertia, step = b * h, b * h**3 / 12, length / n
    k = np.array(
        [
            [12, 6 * step, -12, 6 * step],
            [6 * step, 4 * step**2, -6 * step, 2 * step**2],
            [-12, -6 * step, 12, -6 * step],
            [6 * step, 2 * step**2, -6 * step, 4 * step**2],
        ]
    )
    m = np.array(
        [
            [156, 22 * step, 54, -13 * step],
            [22 * step, 4 * step**2, 13 * step, -3 * step**2],
            [54, 13 * step, 156, -22 * step],
            [-13 * step, -3 * step**2, -22 * step, 4 * step**2],
        ]
    )
    k, m = k * E * inertia / step**3, m * rho * area * step / 420
    if lumped:
        m = np.diag([rho * area * step / 2, 0.0] * 2)
    M, K = np.zeros((2 * n + 2,) * 2), np.zeros((2 * n + 2,) * 2)
    for e in range(n):
        s = slice(2 * e, 2 * e + 4)
        M[s, s] += m
        K[s, s] += k
    return (M, K) if free else (M[2:, 2:], K[2:, 2:])


CANTILEVER_HZ = (4.177583, 26.180466, 73.306062)
"""Of `beam_matrices` as a continuum, by the roots of cos z cosh z = -1."""

FREE_HZ = (26.583006, 73.277081)


def two(A, B):
    """Block diagonal."""
    made = np.zeros((len(A) + len(B),) * 2)
    made[: len(A), : len(A)], made[len(A) :, len(A) :] = A, B
    return made


def response(M, C, K, s):
    """Flexibility at the complex frequency s [1/s]."""
    return np.linalg.inv(s * s * M + s * C + K)


def at(model, s):
    """Outputs per input at the complex frequency s [1/s]."""
    A, B, C, D = state_space(model)
    return C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D


def frequencies(model):
    """Of real or complex modes [Hz], ascending."""
    values = np.linalg.eigvals(state_space(model)[0])
    return np.sort(np.abs(values[values.imag > 0])) / (2 * np.pi)
