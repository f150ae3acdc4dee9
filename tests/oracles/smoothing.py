"""All states and forces of a recording given all of it, by one Gaussian conditioning in NumPy."""

import dataclasses

import numpy as np
import scipy


@dataclasses.dataclass(frozen=True)
class Plant:
    """x+ = A x + B u + B1 u+ + E d + w, y = C x + D u + F d + v; numbers of one system."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    x0: np.ndarray
    P0: np.ndarray
    E: np.ndarray | None = None
    F: np.ndarray | None = None
    B1: np.ndarray | None = None


def conditioned(p: Plant, u, y, *, factor=None, told=None, sigma_force=1.0):
    """Means and covariances of all states (n, nx), and of all forces (n, m); NaN is not measured.

    Forces are flat: nothing is known of them, but where `told` is False; there they have a prior.
    """
    n, nx, ny = len(y), len(p.A), len(p.C)
    E = np.zeros((nx, 0)) if p.E is None else p.E
    F = np.zeros((ny, 0)) if p.F is None else p.F
    m = E.shape[1]
    # Every state as a linear function of the start, the noise and the forces, and of what is known.
    at_w, at_d = nx, n * nx
    X = np.zeros((n, nx, n * nx + n * m))
    known = np.zeros((n, nx))
    X[0, :, :nx], known[0] = np.eye(nx), p.x0
    for k in range(n - 1):
        X[k + 1] = p.A @ X[k]
        X[k + 1, :, at_w + k * nx : at_w + (k + 1) * nx] += np.eye(nx)
        X[k + 1, :, at_d + k * m : at_d + (k + 1) * m] += E
        known[k + 1] = p.A @ known[k] + p.B @ u[k]
        if p.B1 is not None:
            known[k + 1] += p.B1 @ u[k + 1]
    d_of = np.zeros((n * m, X.shape[2]))
    d_of[:, at_d:] = np.eye(n * m)
    Y = np.einsum("ij,kjl->kil", p.C, X)
    Y += np.einsum("ij,kjl->kil", F, d_of.reshape(n, m, X.shape[2]))
    kept = np.isfinite(y)
    expected = known @ p.C.T + u @ p.D.T
    sizes = np.ones_like(y) if factor is None else factor
    noise = scipy.linalg.block_diag(*(p.R * np.outer(s, s) for s in sizes))
    told = np.ones(n, bool) if told is None else told
    flat = np.concatenate([np.zeros(n * nx, bool), np.repeat(told, m)])
    spread = np.full(m, sigma_force**2)
    priors = [p.P0, *[p.Q] * (n - 1), *(np.diag(0 * spread if t else spread) for t in told)]
    S = scipy.linalg.block_diag(*[block for block in priors if block.size])

    rows, residual = Y[kept], (y - expected)[kept]
    V = rows @ S @ rows.T + noise[np.ix_(kept.ravel(), kept.ravel())]
    G = rows[:, flat]
    P_d = np.linalg.inv(G.T @ np.linalg.solve(V, G))
    d = P_d @ G.T @ np.linalg.solve(V, residual)

    def given_all(T, mean, size):
        K = np.linalg.solve(V, rows @ S @ T.T).T
        left = T[:, flat] - K @ G
        value = mean + T[:, flat] @ d + K @ (residual - G @ d)
        P = T @ S @ T.T - K @ V @ K.T + left @ P_d @ left.T
        blocks = [P[k : k + size, k : k + size] for k in range(0, len(P), size)] if size else []
        return value.reshape(n, size), np.array(blocks)

    states = given_all(X.reshape(n * nx, -1), known.ravel(), nx)
    return (*states, *given_all(d_of, np.zeros(n * m), m))
