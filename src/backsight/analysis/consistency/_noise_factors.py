r"""Which of Q and R does not fit, from the autocovariance of the innovations.

A filter with gain K believes in the covariances Q and R. Let the true ones be :math:`g Q` and
:math:`f R`. Its errors before a sample have the covariance

.. math:: P_{k+1} = F_k [(I - K_k H_k) P_k (I - K_k H_k)' + f K_k R K_k'] F_k' + g Q

and its innovations the autocovariance :math:`C_{k,0} = H_k P_k H_k' + f R` and

.. math:: C_{k,l} = H_{k+l} \bar F_{k+l-1} \cdots \bar F_{k+1} F_k (P_k H_k' - K_k C_{k,0}),
    \qquad \bar F_k = F_k (I - K_k H_k).

All of this is linear in f and g: they follow from the measured autocovariance by linear least
squares. R that is too small makes successive innovations negatively correlated, Q that is too small
positively; the size of the innovations alone could be due to either.

Sources: Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE
Transactions on Automatic Control 15(2), 1970, https://doi.org/10.1109/TAC.1970.1099422; Bélanger,
"Estimation of noise covariance matrices for a linear time-varying stochastic process", Automatica
10(3), 1974, https://doi.org/10.1016/0005-1098(74)90037-5.
"""

import dataclasses
import itertools
import math

import numpy as np

from backsight.description import Printed
from backsight.types import Array

LAGS = 12
"""Largest distance of innovations that are compared."""

PARTS = 10
"""Parts of the recording whose scatter says how far the factors may be trusted."""


@dataclasses.dataclass(frozen=True)
class Path:
    """A filter along a recording.

    Parameters
    ----------
    F : (n, nx, nx) array
        Derivative of the next state by the state.
    H : (n, ny, nx) array
        Derivative of the outputs by the state.
    P : (n, nx, nx) array
        Covariance after the measurement.
    e, S : (n, ny), (n, ny, ny) arrays
        Innovations, NaN where not measured, and their covariance.
    Q : (n, nx, nx) array
        What the process noise adds to the covariance until the next sample.
    R : (ny, ny) array
        Of the measurement noise.
    """

    F: Array
    H: Array
    P: Array
    e: Array
    S: Array
    Q: Array
    R: Array


@dataclasses.dataclass(frozen=True)
class NoiseFactors(Printed):
    """By how much the variances of the noise should be larger than those that were assumed.

    Parameters
    ----------
    R, Q : float
        Factors f and g; NaN for one that has no part in the innovations.
    R_std, Q_std : float
        Their standard deviations.
    unexplained : float
        Largest correlation of innovations that no factors explain.
    """

    R: float
    R_std: float
    Q: float
    Q_std: float
    unexplained: float


def noise_factors(path: Path) -> NoiseFactors:
    """Find the factors that explain the autocovariance of the innovations best."""
    measured, by_R, by_Q = _moments(path)
    bounds = np.linspace(0, len(measured), PARTS + 1).astype(int)
    whole = _fit(*(v.mean(axis=0) for v in (measured, by_R, by_Q)))
    parts = [
        _fit(*(v[a:b].mean(axis=0) for v in (measured, by_R, by_Q)))[:2]
        for a, b in itertools.pairwise(bounds)
    ]
    spread = np.std(parts, axis=0, ddof=1) / math.sqrt(PARTS)
    f, g, unexplained = whole
    return NoiseFactors(f, float(spread[0]), g, float(spread[1]), unexplained)


def _fit(measured: Array, by_R: Array, by_Q: Array) -> tuple[float, float, float]:
    """Factors f and g, not negative, and the largest correlation that they leave."""
    # The variance of a squared innovation is twice that of a product of two independent ones.
    weight = np.where(np.arange(len(measured)) == 0, math.sqrt(0.5), 1.0)[:, None]
    goal, columns = (weight * measured).ravel(), [(weight * c).ravel() for c in (by_R, by_Q)]
    size = [float(np.linalg.norm(c)) for c in columns]
    if size[1] < 1e-3 * size[0]:
        f, g = float(columns[0] @ goal) / size[0] ** 2, math.nan
    else:
        f, g = map(float, np.linalg.lstsq(np.column_stack(columns), goal, rcond=None)[0])
        if f < 0:
            f, g = 0.0, float(columns[1] @ goal) / size[1] ** 2
        elif g < 0:
            f, g = float(columns[0] @ goal) / size[0] ** 2, 0.0
    left = measured - f * by_R - (0.0 if math.isnan(g) else g) * by_Q
    level = np.abs(measured[:1])
    return f, g, float(np.max(np.abs(left[1:]) / np.where(level > 0, level, 1.0)))


def _moments(path: Path) -> tuple[Array, Array, Array]:
    """Products of normalised innovations and what R and Q add to their means, (n, lags, ny)."""
    n, ny = path.e.shape
    deviation = np.sqrt(np.einsum("kii->ki", path.S))
    z, known = np.nan_to_num(path.e) / deviation, np.isfinite(path.e)
    expected = _expected(path) / deviation[:, None, None, :]
    count = n - LAGS
    measured, predicted = np.zeros((count, LAGS + 1, ny)), np.zeros((2, count, LAGS + 1, ny))
    for lag in range(LAGS + 1):
        later = slice(lag, lag + count)
        pairs = known[:count] & known[later]
        measured[:, lag] = np.where(pairs, z[:count] * z[later], 0.0)
        for i in range(2):
            values = expected[:count, i, lag] / deviation[later]
            predicted[i, :, lag] = np.where(pairs, values, 0.0)
    return measured, predicted[0], predicted[1]


def _expected(path: Path) -> Array:
    """Autocovariance of each output's innovations for f = 1, g = 0 and for f = 0, g = 1.

    (n, 2, lags + 1, ny), with the earlier sample's index first.
    """
    n, ny, nx = path.H.shape
    K = gains(path)
    noise = np.einsum("kij,jl,kml->kim", K, path.R, K)
    closed = path.F @ (np.eye(nx) - K @ path.H)
    carried = path.F @ noise @ path.F.transpose(0, 2, 1)
    found = np.zeros((n, 2, LAGS + 1, ny))
    # What was uncertain at first goes with R.
    P = np.stack([path.P[0], np.zeros((nx, nx))])
    pending = np.zeros((LAGS + 1, 2, nx, ny))
    for k in range(n):
        H, F = path.H[k], path.F[k]
        PH = P @ H.T
        C = H @ PH
        C[0] += path.R
        found[k, :, 0] = np.einsum("aii->ai", C)
        reach = min(k, LAGS)
        if reach:
            across = np.einsum("ij,lajm->laim", H, pending[:reach])
            lags = np.arange(reach)
            found[k - 1 - lags, :, lags + 1] = np.einsum("laii->lai", across)
        pending[1:] = closed[k] @ pending[:-1]
        pending[0] = F @ (PH - K[k] @ C)
        P = closed[k] @ P @ closed[k].T
        P[0] += carried[k]
        P[1] += path.Q[k]
    return found


def gains(path: Path) -> Array:
    """Gain of every sample, P H' R^-1 over the measured outputs, (n, nx, ny)."""
    known = np.isfinite(path.e)
    n, ny, nx = path.H.shape
    K = np.zeros((n, nx, ny))
    for pattern in np.unique(known, axis=0):
        rows, seen = np.flatnonzero((known == pattern).all(axis=1)), np.flatnonzero(pattern)
        if len(seen):
            PH = path.P[rows] @ path.H[rows][:, seen].transpose(0, 2, 1)
            inverse = np.linalg.inv(path.R[np.ix_(seen, seen)])
            K[np.ix_(rows, np.arange(nx), seen)] = PH @ inverse
    return K
