"""The samples of a window of a linear model on top of each other, and what solves them."""

import dataclasses

import casadi as ca
import numpy as np
import scipy

from backsight.engine.dense import add_product
from backsight.errors import TuningError
from backsight.estimators.parts.linear import Linear, root
from backsight.estimators.scaled import Setting
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Stacked:
    r"""States and outputs of N + 1 samples as functions of what is unknown and of the inputs.

    With :math:`\theta = (x_{k-N}, \omega_{k-N}, \ldots, \omega_{k-1})`, the first state and the
    process noise :math:`w = G \omega` of unit covariance, and U the N + 1 inputs one after the
    other:

    .. math:: X = T \theta + F U, \qquad Y = \Phi \theta + \Gamma U + V .

    Parameters
    ----------
    T, F : arrays
        ``((N + 1) nx, nx + N q)`` and ``((N + 1) nx, (N + 1) nu)``.
    Phi, Gamma : arrays
        The same for the ``(N + 1) ny`` outputs.
    """

    T: Array
    F: Array
    Phi: Array
    Gamma: Array


@dataclasses.dataclass(frozen=True)
class Gains:
    r"""Least-squares estimate of a state, mostly the present one, from a full window.

    .. math:: \hat x_k = M Y + N_u U, \qquad Y = (y_{k-N}, \ldots, y_k), \;
        U = (u_{k-N}, \ldots, u_k)

    Parameters
    ----------
    M : (nx, (N + 1) ny) array
    N_u : (nx, (N + 1) nu) array
        The last block, for the present input, is zero unless the model has a feedthrough or the
        input is interpolated.
    P : (nx, nx) array
        Covariance of the estimate.
    """

    M: Array
    N_u: Array
    P: Array


def stacked(system: Linear, N: int) -> Stacked:
    """Stack N + 1 samples."""
    nx, nu = system.B.shape
    G = root(system.s.Q)
    q = G.shape[1]
    T = np.zeros((N + 1, nx, nx + N * q))
    F = np.zeros((N + 1, nx, (N + 1) * nu))
    T[0, :, :nx] = np.eye(nx)
    for i in range(N):
        T[i + 1], F[i + 1] = system.A @ T[i], system.A @ F[i]
        T[i + 1, :, nx + i * q : nx + (i + 1) * q] += G
        F[i + 1, :, i * nu : (i + 1) * nu] += system.B
        F[i + 1, :, (i + 1) * nu : (i + 2) * nu] += system.B_next
    Phi, Gamma = system.C @ T, system.C @ F
    for i in range(N + 1):
        Gamma[i, :, i * nu : (i + 1) * nu] += system.D
    T, F, Phi, Gamma = (m.reshape(m.shape[0] * m.shape[1], m.shape[2]) for m in (T, F, Phi, Gamma))
    return Stacked(T, F, Phi, Gamma)


def gains(system: Linear, N: int, *, every: int = 1, at: int = -1) -> Gains:
    r"""Gains of the least-squares estimate from a full window, scaled.

    The estimate is that of the window's last sample, or of another one, `at` (0 is the first).

    With ``every = m`` only the samples k, k - m, k - 2 m ... are measured; the columns of M for
    the others are zero.

    Without process noise and with R = I they are those of the textbook,
    :math:`M = A^N (\Phi'\Phi)^{-1} \Phi'` and :math:`N_u = F_N - M \Gamma`. Computed by a QR
    factorisation of the whitened rows; :math:`\Phi' \Phi` is never formed.

    Raises
    ------
    TuningError
        If the outputs of the window do not determine its states.
    """
    ny, nx = system.C.shape
    s = stacked(system, N)
    measured = (N - np.arange(N + 1)) % every == 0
    noise = np.linalg.cholesky(np.asarray(scipy.linalg.block_diag(*[system.s.R] * (N + 1))))
    rows = scipy.linalg.solve_triangular(noise, s.Phi, lower=True) * measured.repeat(ny)[:, None]
    check_rank(rows[:, :nx], N)
    unknown = s.Phi.shape[1]
    q, r = np.linalg.qr(np.vstack([rows, np.eye(unknown)[nx:]]))
    T, F = (block.reshape(N + 1, nx, -1)[at] for block in (s.T, s.F))
    present = scipy.linalg.solve_triangular(r, T.T, trans=1).T
    M = scipy.linalg.solve_triangular(noise, (present @ q[: len(rows)].T).T, lower=True, trans=1).T
    return Gains(M=M, N_u=F - M @ s.Gamma, P=present @ present.T)


def newest_gain(system: Linear, N: int, *, every: int = 1) -> Array:
    r"""What the newest sample of a full window does to its estimate, (nx, ny), as of `gains`.

    :math:`P C' R^{-1}` with the covariance P of the estimate. Sample by sample, as if the first
    state were known, beside what the innovations tell of it (see `_window_filter`): the work grows
    with the length of the window, not with its cube.

    Raises
    ------
    TuningError
        If the outputs of the window do not determine its states.
    """
    A, C, R, Q = system.A, system.C, system.s.R, system.s.Q
    nx = len(A)
    P, X, told = np.zeros((nx, nx)), np.eye(nx), np.zeros((0, nx))
    free, seen = np.eye(nx), np.zeros((0, nx))  # without noise: what the window determines
    noise = np.linalg.cholesky(R)
    for k in range(N + 1):
        if (N - k) % every == 0:
            CX, G = C @ X, C @ P
            L = np.linalg.cholesky(G @ C.T + R)
            white = scipy.linalg.solve_triangular(L, np.hstack([CX, G]), lower=True)
            told = _compressed(told, white[:, :nx])
            K = scipy.linalg.solve_triangular(L, white[:, nx:], lower=True, trans=1).T
            P, X = P - white[:, nx:].T @ white[:, nx:], X - K @ CX
            rows = scipy.linalg.solve_triangular(noise, C @ free, lower=True)
            seen = _compressed(seen, rows)
        if k < N:
            P, X, free = A @ P @ A.T + Q, A @ X, A @ free
    check_rank(seen, N)
    spread = scipy.linalg.solve_triangular(told, X.T, trans=1).T
    gain = np.linalg.solve(R, C @ (P + spread @ spread.T)).T
    return np.asarray(gain, float)


def newest_exact_gain(system: Linear, N: int, *, every: int = 1) -> Array:
    r"""`newest_gain` where sensors have no noise: the least variance among unbiased estimates.

    With the first state x unknown and all noises :math:`\varepsilon \sim N(0, I)` the readings are
    :math:`Y = X x + K \varepsilon`. Rows W with W X = 0 have no x: they fix the noises,
    :math:`\hat\varepsilon = (W K)^+ W Y`, and the others say what x is,
    :math:`\hat x = X^+ (Y - K \hat\varepsilon)`. Source: Paige, "Computer solution and perturbation
    analysis of generalized linear least squares problems", Mathematics of Computation 33 (1979),
    doi:10.1090/S0025-5718-1979-0514820-3.

    Raises
    ------
    TuningError
        If the window does not determine its states, or readings follow from each other exactly.
    """
    (ny, nx), s = system.C.shape, stacked(system, N)
    measured = ((N - np.arange(N + 1)) % every == 0).repeat(ny)
    X, drive = s.Phi[measured, :nx], s.Phi[measured, nx:]
    check_rank(X, N)
    noise = scipy.linalg.block_diag(*[root(system.s.R)] * (N + 1))[measured]
    K = np.hstack([drive, noise])
    W = scipy.linalg.null_space(X.T).T
    singular = np.linalg.svd(W @ K, compute_uv=False)
    if len(singular) < len(W) or not (singular > TOLERANCE * singular.max(initial=0.0)).all():
        raise TuningError(
            f"in a window of N = {N} readings without noise follow from each other, whatever the "
            "process noise does, so that they would contradict each other: shorten the window, "
            "give more states process noise, or the sensors a small sigma_y"
        )
    told = np.linalg.pinv(W @ K) @ W
    first = np.linalg.pinv(X) @ (np.eye(len(X)) - K @ told)
    T = s.T[-nx:]
    M = T[:, :nx] @ first + T[:, nx:] @ told[: drive.shape[1]]
    return np.asarray(M[:, -ny:], float)


def _compressed(triangle: Array, rows: Array) -> Array:
    """Triangular factor of equations and those that are added."""
    return np.asarray(np.linalg.qr(np.vstack([triangle, rows]), mode="r"), float)


def in_units(scaled: Gains, s: Setting) -> Gains:
    """Gains in physical units."""
    samples = scaled.M.shape[1] // s.model.ny
    return Gains(
        M=scaled.M * s.sx[:, None] / np.tile(s.sy, samples),
        N_u=scaled.N_u * s.sx[:, None] / np.tile(s.su, samples),
        P=scaled.P * np.outer(s.sx, s.sx),
    )


def product(matrix: Array, vector: ca.MX) -> ca.MX:
    """Constant matrix times vector, as a loop."""
    rows = len(matrix)
    return ca.vec(add_product(ca.MX.zeros(1, rows), vector.T, ca.MX(ca.DM(matrix))))


TOLERANCE = 1e-10
"""Smallest ratio of singular values that counts: far above rounding, far below any real sensor."""


def check_rank(rows: Array, N: int) -> None:
    """Raise `TuningError` unless the rows (..., nx) of a window determine nx numbers."""
    if len(rows) > rows.shape[-1]:
        rows = np.asarray(np.linalg.qr(rows, mode="r"), float)
    size = np.linalg.norm(rows, axis=0)
    values = np.linalg.svd(rows / np.where(size > 0, size, 1.0), compute_uv=False)
    found = int((values > TOLERANCE * values[0]).sum())
    if found < rows.shape[1]:
        raise TuningError(
            f"a window of N = {N} determines only {found} of {rows.shape[1]} states (singular "
            f"values below {TOLERANCE:g} of the largest); lengthen it or add a sensor: "
            "`bs.check.check_observability(model)` says which states cannot be seen"
        )
