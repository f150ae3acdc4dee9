"""From the spectral density of continuous noise to its covariance over a sampling period."""

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.discrete._falling_apart import independent_parts
from backsight.errors import ModelError, TuningError
from backsight.types import Array

_TERMS = 20  # with |A| h <= 1/2 the series has then converged to the last digit


def discretise_noise(A: ArrayLike, Qc: ArrayLike, *, dt: float) -> tuple[Array, Array]:
    r"""Transition matrix and noise covariance of :math:`\dot x = A x + w` over one period.

    .. math::
        \Phi = e^{A\,dt}, \qquad
        Q = \int_0^{dt} e^{A s}\, Q_c\, e^{A^T s}\, ds

    Parameters
    ----------
    A : (nx, nx) array
        State matrix [1/s]. Rows of zeros are random walks.
    Qc : (nx, nx) array
        Spectral density of w, symmetric and positive semidefinite [unit of x squared per second].
    dt : float
        Sampling period [s].

    Returns
    -------
    Phi : (nx, nx) array
        Transition matrix.
    Q : (nx, nx) array
        Covariance of what the noise adds in one period; symmetric, positive semidefinite.

    Raises
    ------
    ModelError
        If `A` is not a square matrix of finite numbers, or `dt` is not positive.
    TuningError
        If `Qc` has another size, is not symmetric, or has a negative eigenvalue.

    Notes
    -----
    The integral is that of Van Loan (1978), "Computing integrals involving the matrix
    exponential", IEEE Transactions on Automatic Control 23(3), 395-404,
    doi:10.1109/TAC.1978.1101743. His single exponential of ``[[-A, Qc], [0, A']]`` overflows for
    strongly damped modes and loses the smallest entries of integrator chains. Here a series gives
    the integral over a fraction h of the period, and doublings,

    .. math:: Q(2h) = Q(h) + \Phi(h)\, Q(h)\, \Phi(h)^T,

    give the rest; they only add positive semidefinite matrices.
    """
    a, q = _checked(A, Qc, dt)
    return integrated_noise(a, q, dt=dt)


def integrated_noise(a: Array, q: Array, *, dt: float) -> tuple[Array, Array]:
    """See `discretise_noise`; a part of a density, which need not be positive, is taken, too."""
    phi, total = np.zeros_like(a), np.zeros_like(q)
    for part in independent_parts(a, q):
        at = np.ix_(part, part)
        phi[at], total[at] = _integrated(a[at], q[at], dt)
    return phi, total


def _integrated(a: Array, q: Array, dt: float) -> tuple[Array, Array]:
    with np.errstate(invalid="ignore"):  # SciPy makes indices of large scales, too, and drops them
        _, (scale, _) = scipy.linalg.matrix_balance(a, permute=False, separate=True)
    a, q = a * scale / scale[:, None], q / np.outer(scale, scale)
    doublings = _doublings(float(np.linalg.norm(a, 1)) * dt)
    h = dt / 2**doublings
    phi, term = np.asarray(scipy.linalg.expm(a * h), float), q * h
    total = term
    for k in range(2, _TERMS):
        moved = a @ term
        term = h / k * (moved + moved.T)  # a density is symmetric
        total = total + term
    for _ in range(doublings):
        total = total + phi @ total @ phi.T
        phi = phi @ phi
    total = (total + total.T) / 2
    return phi * scale[:, None] / scale, total * np.outer(scale, scale)


def random_walk(sigma: ArrayLike, *, dt: float) -> Array:
    r"""Spectral density of random walks that move by `sigma` in one sampling period.

    .. math:: Q_c = \mathrm{diag}(\sigma^2) / dt

    Over any other period the standard deviation grows with the square root of time.

    Parameters
    ----------
    sigma : (n,) array
        Standard deviation of the increment over `dt`, one per state [unit of the state].
    dt : float
        Sampling period [s].

    Returns
    -------
    (n, n) array
        Spectral density [unit squared per second].

    Raises
    ------
    TuningError
        If a standard deviation is negative or not finite.
    ModelError
        If `dt` is not positive.

    Notes
    -----
    Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), eq. 14 and 41, "Moving horizon observer
    for vibration dynamics with plant uncertainties in nanopositioning system estimation",
    ACC 2012.
    """
    values = np.atleast_1d(np.asarray(sigma, float))
    if values.ndim != 1 or not (np.isfinite(values).all() and (values >= 0).all()):
        raise TuningError(f"sigma is {sigma}; it must be one number >= 0 per state")
    return np.diag(values**2) / _period(dt)


def _doublings(norm: float) -> int:
    return max(0, math.ceil(math.log2(2 * norm))) if norm > 0 else 0


def _checked(A: ArrayLike, Qc: ArrayLike, dt: float) -> tuple[Array, Array]:
    _period(dt)
    a, q = np.asarray(A, float), np.asarray(Qc, float)
    if a.ndim != 2 or a.shape[0] != a.shape[1] or not np.isfinite(a).all():
        raise ModelError(f"A must be a square matrix of finite numbers; its shape is {a.shape}")
    if q.shape != a.shape or not np.isfinite(q).all():
        raise TuningError(f"Qc must be finite and of the shape {a.shape}; its shape is {q.shape}")
    deviations = np.sqrt(np.abs(q.diagonal()))
    size = np.outer(deviations, deviations)
    if (np.abs(q - q.T) > 1e-9 * size).any():
        raise TuningError("Qc is not symmetric")
    # Judged on the correlations, so that the verdict does not depend on the units of the states.
    if np.linalg.eigvalsh(q / np.where(size > 0, size, 1.0))[0] < -1e-9:
        smallest = np.linalg.eigvalsh(q)[0]
        raise TuningError(
            f"Qc is not positive semidefinite: its smallest eigenvalue is {smallest:.3g}"
        )
    return a, q


def _period(dt: float) -> float:
    if not (math.isfinite(dt) and dt > 0):
        raise ModelError(f"the sampling period dt is {dt}; it must be positive")
    return dt
