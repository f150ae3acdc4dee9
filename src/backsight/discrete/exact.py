"""Exact discretisation of linear models with a held or an interpolated input."""

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.discrete._falling_apart import independent_parts
from backsight.errors import ModelError
from backsight.types import Array


def zoh(A: ArrayLike, B: ArrayLike, *, dt: float) -> tuple[Array, Array]:
    r"""Discretise :math:`\dot x = A x + B u` with the input held over the sampling period.

    .. math:: x_{k+1} = A_d x_k + B_d u_k

    Parameters
    ----------
    A : (nx, nx) array
        State matrix [1/s].
    B : (nx, nu) array
        Input matrix.
    dt : float
        Sampling period [s].

    Returns
    -------
    Ad : (nx, nx) array
        Transition matrix.
    Bd : (nx, nu) array
        Response to the held input.

    Raises
    ------
    ModelError
        If the sizes do not fit, an entry is not finite, or `dt` is not positive.

    Notes
    -----
    One exponential of a block matrix gives both, also for a singular `A`: Van Loan (1978),
    "Computing integrals involving the matrix exponential", IEEE Transactions on Automatic Control
    23(3), 395-404, doi:10.1109/TAC.1978.1101743.
    """
    a, b = _checked(A, B, dt)
    Ad, Bd = np.zeros_like(a), np.zeros_like(b)
    nu = b.shape[1]
    for part in independent_parts(a):
        nx, at = len(part), np.ix_(part, part)
        block = np.zeros((nx + nu, nx + nu))
        block[:nx] = np.hstack([a[at], b[part]]) * dt
        top = np.asarray(scipy.linalg.expm(block), float)[:nx]
        Ad[at], Bd[part] = top[:, :nx], top[:, nx:]
    return Ad, Bd


def foh(A: ArrayLike, B: ArrayLike, *, dt: float) -> tuple[Array, Array, Array]:
    r"""Discretise :math:`\dot x = A x + B u` with the input interpolated between the samples.

    .. math:: x_{k+1} = A_d x_k + B_0 u_k + B_1 u_{k+1}

    The state keeps its meaning; unlike the usual state-space form of the first-order hold, the
    next input stands in the equation and no state is shifted.

    Parameters
    ----------
    A : (nx, nx) array
        State matrix [1/s].
    B : (nx, nu) array
        Input matrix.
    dt : float
        Sampling period [s].

    Returns
    -------
    Ad : (nx, nx) array
        Transition matrix.
    B0, B1 : (nx, nu) array
        Response to the input at the beginning and at the end of the period.

    Raises
    ------
    ModelError
        If the sizes do not fit, an entry is not finite, or `dt` is not positive.

    Notes
    -----
    The input and its slope are appended to the state, so that one exponential gives the responses
    to both (Van Loan 1978, doi:10.1109/TAC.1978.1101743).
    """
    a, b = _checked(A, B, dt)
    Ad, held, ramp = np.zeros_like(a), np.zeros_like(b), np.zeros_like(b)
    nu = b.shape[1]
    for part in independent_parts(a):
        nx, at = len(part), np.ix_(part, part)
        block = np.zeros((nx + 2 * nu, nx + 2 * nu))
        block[:nx, : nx + nu] = np.hstack([a[at], b[part]]) * dt
        block[nx : nx + nu, nx + nu :] = np.eye(nu)
        top = np.asarray(scipy.linalg.expm(block), float)[:nx]
        Ad[at], held[part], ramp[part] = top[:, :nx], top[:, nx : nx + nu], top[:, nx + nu :]
    return Ad, held - ramp, ramp


def _checked(A: ArrayLike, B: ArrayLike, dt: float) -> tuple[Array, Array]:
    a, b = np.asarray(A, float), np.asarray(B, float)
    if a.ndim != 2 or a.shape[0] != a.shape[1]:
        raise ModelError(f"A has the shape {a.shape}; it must be square")
    if b.ndim != 2 or b.shape[0] != a.shape[0]:
        raise ModelError(f"B has the shape {b.shape}; it must have {a.shape[0]} rows like A")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ModelError("A or B has an entry that is not finite")
    if not (math.isfinite(dt) and dt > 0):
        raise ModelError(f"the sampling period dt is {dt}; it must be positive")
    return a, b
