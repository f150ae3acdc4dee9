r"""Covariances in the steady state: equations of Riccati and Lyapunov, by doubling.

With :math:`\Phi = A (I - K C)` the errors of a Kalman filter go from sample to sample, and the
covariance of its prediction ends where

.. math:: P = A P A' - A P C' (C P C' + R)^{-1} C P A' + Q .

A pass of the doubling algorithm goes from the covariance after k samples to that after 2 k, and
costs a few products of matrices. Slow modes, for which thousands of samples are nothing, take a
dozen passes; the QZ algorithm takes tens of times as long for hundreds of states.

Source: Anderson, "Second-order convergent algorithms for the steady-state Riccati equation", 1978,
International Journal of Control 28(2), doi:10.1080/00207177808922455.
"""

from collections.abc import Callable

import numpy as np

from backsight.types import Array

PASSES = 40
"""Of a doubling: 1e12 samples."""

SETTLED = 1e-15
"""Relative change of the variances in the last pass of a doubling."""

Closed = Callable[[Array], tuple[Array, Array]]
"""Covariance P of a prediction to Phi and V of the filter with the gain for this P: with this gain
kept, the next covariance is Phi P Phi' + V."""


def riccati_limit(A: Array, C: Array, Q: Array, R: Array) -> Array | None:
    """Covariance (n, n) of the prediction of a Kalman filter in the steady state, see the module.

    To the rounding of matrices that are inverted, which `newton_step` takes away.

    Parameters
    ----------
    A, C, Q, R : (n, n), (m, n), (n, n), (m, m) arrays
        R is positive definite; there may be no outputs.

    Returns
    -------
    array or None
        None if the covariance does not settle, as that of a drift that no output shows.
    """
    n = len(A)
    try:
        G = C.T @ np.linalg.solve(R, C)
    except np.linalg.LinAlgError:
        return None
    P, F, one = Q, A.T, np.eye(n)
    with np.errstate(all="ignore"):
        for _ in range(PASSES):
            # P is the covariance 2^k samples after a state that was known, G what they tell of it.
            try:
                left = np.linalg.solve(one + G @ P, np.hstack([F, G]))
            except np.linalg.LinAlgError:
                return None
            more = F.T @ P @ left[:, :n]
            G = _symmetric(G + F @ left[:, n:] @ F.T)
            F, P = F @ left[:, :n], _symmetric(P + more)
            if not np.isfinite(P).all():
                return None
            if (np.abs(np.diag(more)) <= SETTLED * np.diag(P)).all():
                return P
    return None


def newton_step(P: Array, closed: Closed) -> tuple[Array, list[Array]] | None:
    """Covariance in the steady state with the gain for P, and the powers 1, 2, 4, ... of Phi.

    That is Newton's step on the Riccati equation (Hewer, 1971, doi:10.1109/TAC.1971.1099755), as a
    sum of positive parts: its error is the square of that of P.

    Returns
    -------
    tuple or None
        None if errors grow with this gain.
    """
    F, X = closed(P)
    powers = [F]
    with np.errstate(all="ignore"):
        for _ in range(PASSES):
            more = F @ X @ F.T
            X = _symmetric(X + more)
            F = F @ F
            powers.append(F)
            if not np.isfinite(X).all():
                return None
            if (np.abs(np.diag(more)) <= SETTLED * np.diag(X)).all():
                return X, powers
    return None


def _symmetric(P: Array) -> Array:
    return (P + P.T) / 2
