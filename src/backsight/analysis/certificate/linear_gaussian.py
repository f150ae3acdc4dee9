r"""What is best for a linear model with Gaussian noise, by two routes, in plain NumPy.

.. math:: x_{k+1} = A x_k + B u_k + w_k, \qquad y_k = C x_k + D u_k + v_k

The Kalman filter, and with more states the smoother, go through the samples; least squares over the
whole recording (full information) solves for all samples at once. They must agree; an estimator
that agrees with them loses nothing.

Sources: Kalman, "A new approach to linear filtering and prediction problems", 1960,
https://doi.org/10.1115/1.3662552; Anderson, Moore, "Optimal Filtering", 1979, chapter 7 (smoothing
by a filter with more states).
"""

import dataclasses

import numpy as np
import scipy

from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class LinearGaussian:
    """A linear model from sample to sample, its noise and its prior (of mean zero).

    Parameters
    ----------
    A, B, C, D : (nx, nx), (nx, nu), (ny, nx), (ny, nu) arrays
    Q, R, P0 : (nx, nx), (ny, ny), (nx, nx) arrays
        Q and P0 may be singular.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    Q: Array
    R: Array
    P0: Array


@dataclasses.dataclass(frozen=True)
class Estimates:
    """Means (n, nx) and covariances (n, nx, nx)."""

    x: Array
    P: Array


def draw(system: LinearGaussian, u: Array, *, missing: float, seed: int) -> Array:
    """Outputs (n, ny) of the system with its noise; NaN where not measured, but not at first."""
    rng = np.random.default_rng(seed)
    roots = [square_root(V) for V in (system.P0, system.Q, system.R)]
    x, *noise = (root @ rng.standard_normal((root.shape[1], len(u))) for root in roots)
    x, rows = x[:, 0], []
    for command, w, v in zip(u, noise[0].T, noise[1].T, strict=True):
        rows.append(system.C @ x + system.D @ command + v)
        x = system.A @ x + system.B @ command + w
    y = np.array(rows)
    y[1:][rng.random(y[1:].shape) < missing] = np.nan
    return y


def kalman(system: LinearGaussian, u: Array, y: Array) -> tuple[Estimates, Estimates]:
    """Estimates before and after every sample's measurement, in the form of Joseph."""
    x, P = np.zeros(len(system.A)), system.P0
    before, after = [], []
    for command, measured in zip(u, y, strict=True):
        before.append((x, P))
        seen = np.flatnonzero(np.isfinite(measured))
        C, R = system.C[seen], system.R[np.ix_(seen, seen)]
        K = np.linalg.solve(C @ P @ C.T + R, C @ P).T
        x = x + K @ (measured[seen] - C @ x - system.D[seen] @ command)
        kept = np.eye(len(x)) - K @ C
        P = kept @ P @ kept.T + K @ R @ K.T
        after.append((x, P))
        x, P = system.A @ x + system.B @ command, system.A @ P @ system.A.T + system.Q
    return _stacked(before), _stacked(after)


def lagged(system: LinearGaussian, u: Array, y: Array, lag: int) -> Estimates:
    """Estimates of the state `lag` samples before every sample, given all up to this sample.

    Of the first state while there are not so many. By a Kalman filter whose state holds the last
    ``lag + 1`` states.
    """
    nx = len(system.A)
    shift = np.eye((lag + 1) * nx, k=-nx)
    shift[:nx, :nx] = system.A
    wide = LinearGaussian(
        A=shift,
        B=np.vstack([system.B, np.zeros((lag * nx, system.B.shape[1]))]),
        C=np.hstack([system.C, np.zeros((len(system.C), lag * nx))]),
        D=system.D,
        Q=np.pad(system.Q, (0, lag * nx)),
        R=system.R,
        P0=np.tile(system.P0, (lag + 1, lag + 1)),
    )
    _, after = kalman(wide, u, y)
    return Estimates(after.x[:, lag * nx :], after.P[:, lag * nx :, lag * nx :])


def dense_least_squares(system: LinearGaussian, u: Array, y: Array) -> Estimates:
    """All states given all measurements, by least squares over the whole recording.

    The unknowns are the start and the noise of every sample in units of their deviations, so that
    nothing is inverted; the rows of the measurements are whitened.
    """
    n, nx = len(u), len(system.A)
    start, drive = square_root(system.P0), square_root(system.Q)
    width = start.shape[1] + (n - 1) * drive.shape[1]
    mean, effect = np.zeros(nx), np.zeros((nx, width))
    effect[:, : start.shape[1]] = start
    means, effects, rows, values = [], [], [], []
    at = start.shape[1]
    for command, measured in zip(u, y, strict=True):
        means.append(mean)
        effects.append(effect)
        seen = np.flatnonzero(np.isfinite(measured))
        root = np.linalg.cholesky(system.R[np.ix_(seen, seen)])
        error = measured[seen] - system.C[seen] @ mean - system.D[seen] @ command
        rows.append(np.linalg.solve(root, system.C[seen] @ effect))
        values.append(np.linalg.solve(root, error))
        mean, effect = system.A @ mean + system.B @ command, system.A @ effect
        if len(means) < n:
            effect[:, at : at + drive.shape[1]] += drive
            at += drive.shape[1]
    stack = np.vstack([np.eye(width), *rows])
    goal = np.concatenate([np.zeros(width), *values])
    Qf, Rf = np.linalg.qr(stack)
    z = scipy.linalg.solve_triangular(Rf, Qf.T @ goal)
    spread = np.array(effects).reshape(-1, width).T
    root = scipy.linalg.solve_triangular(Rf, spread, trans="T").T.reshape(n, nx, width)
    return Estimates(np.array(means) + np.array(effects) @ z, root @ root.transpose(0, 2, 1))


def square_root(covariance: Array) -> Array:
    """A matrix L (n, rank) with L L' = covariance, which may be singular."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > 1e-13 * max(float(values.max()), 0.0)
    return scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])


def _stacked(pairs: list[tuple[Array, Array]]) -> Estimates:
    return Estimates(np.array([x for x, _ in pairs]), np.array([P for _, P in pairs]))
