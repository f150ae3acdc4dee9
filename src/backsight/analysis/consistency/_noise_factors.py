r"""Which of Q and R does not fit, from the autocovariance of the innovations.

A Kalman filter believes in the covariances Q and R; then its innovations are white and have the
covariance S. Let the true ones be :math:`g Q` and :math:`f R`. What Q adds to its errors before a
sample has the covariance

.. math:: P_{k+1} = F_k (I - K_k H_k) P_k (I - K_k H_k)' F_k' + Q

and to the autocovariance of its innovations :math:`C_{k,0} = H_k P_k H_k'` and

.. math:: C_{k,l} = H_{k+l} \bar F_{k+l-1} \cdots \bar F_{k+1} F_k (P_k H_k' - K_k C_{k,0}),
    \qquad \bar F_k = F_k (I - K_k H_k).

All is linear in f and g: the whole autocovariance is :math:`f S \delta_l + (g - f) C_{k,l}`, so
that they follow from the measured one by linear least squares, without bias where both are one. R
that is too small makes successive innovations negatively correlated, Q that is too small
positively; the size of the innovations alone could be due to either. Distances l count samples at
which something was measured.

Sources: Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE
Transactions on Automatic Control 15(2), 1970, https://doi.org/10.1109/TAC.1970.1099422; Bélanger,
"Estimation of noise covariance matrices for a linear time-varying stochastic process", Automatica
10(3), 1974, https://doi.org/10.1016/0005-1098(74)90037-5; for the standard deviations Newey, West,
"A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix", Econometrica 55(3), 1987, https://doi.org/10.2307/1913610.
"""

import dataclasses
import math

import numpy as np

from backsight.description import Printed
from backsight.types import Array

LAGS = 12
"""Largest distance of innovations that are compared."""

MEMORY = 2 * LAGS
"""Distance up to which the products of innovations are taken to follow from each other."""

SETTLE = 10
"""The first one in so many samples has no vote: what Q adds has to build up."""

NEAR_R, NEAR_Q = 1.3, 1.6
"""A factor below this, or above its inverse, does no harm in practice."""

SURE, LIKELY = 3.5, 2.5
"""Deviations by which a factor must be off to raise a doubt, and to be named where there is one."""

APART = 1e-3
"""Share of Q's part in the innovations that must differ from R's, or the two cannot be told."""


@dataclasses.dataclass(frozen=True)
class FilterPath:
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

    def measured(self) -> "FilterPath":
        """The same with only the samples at which something was measured."""
        rows = np.flatnonzero(np.isfinite(self.e).any(axis=1))
        if len(rows) == len(self.e):
            return self
        F, Q = [], []
        for begin, end in zip(rows, [*rows[1:], len(self.e)], strict=True):
            Phi, added = self.F[begin], self.Q[begin]
            for k in range(begin + 1, end):
                Phi, added = self.F[k] @ Phi, self.F[k] @ added @ self.F[k].T + self.Q[k]
            F.append(Phi)
            Q.append(added)
        kept = {name: getattr(self, name)[rows] for name in ("H", "P", "e", "S")}
        return FilterPath(F=np.array(F), Q=np.array(Q), R=self.R, **kept)


@dataclasses.dataclass(frozen=True)
class NoiseFactors(Printed):
    """By how much the variances of the noise should be larger than those that were assumed.

    Parameters
    ----------
    R, Q : float
        Factors f and g; NaN for one that has no part of its own in the innovations.
    R_std, Q_std : float
        Their standard deviations.
    unexplained : float
        Largest correlation of innovations that no factors explain.
    R_far, Q_far : float
        How far a factor is from one, in the standard deviations that it would have if it were one.
    doubted : bool
        Whether they are those of a filter that was run beside, and its innovations have not the
        size, or not the colour, that they should: the noise is wrong for certain then.
    """

    R: float
    R_std: float
    Q: float
    Q_std: float
    unexplained: float
    R_far: float
    Q_far: float
    doubted: bool = False

    def R_wrong(self, deviations: float) -> bool:
        """Whether R does not fit, by so many `deviations` and by so much that it matters."""
        return self.R_far >= deviations and not 1 / NEAR_R < self.R < NEAR_R

    def Q_wrong(self, deviations: float) -> bool:
        """The same of Q."""
        return self.Q_far >= deviations and not 1 / NEAR_Q < self.Q < NEAR_Q


# Innovations of an estimate that diverged may be 1e300 deviations long; its status says so.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def noise_factors(path: FilterPath) -> NoiseFactors:
    """Find the factors that explain the autocovariance of the innovations best.

    All are NaN if the innovations are so long that their products are no numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from backsight.analysis.consistency import FilterPath
    >>> e, one = 2.0 * np.random.default_rng(0).standard_normal((2000, 1)), np.ones((2000, 1, 1))
    >>> path = FilterPath(F=one, H=one, P=0 * one, e=e, S=one, Q=0 * one, R=np.eye(1))
    >>> round(bs.check.noise_factors(path).R)  # innovations twice as large as assumed
    4
    """
    products, by_Q, counted = _moments(path.measured())
    settled = slice(len(products) // SETTLE, None)
    products, by_Q, counted = products[settled], by_Q[settled], counted[settled]
    pairs = np.maximum(counted.mean(axis=0), 1e-12)
    goal, of_Q = products.mean(axis=0) / pairs, by_Q.mean(axis=0) / pairs
    nan, n = math.nan, len(products)
    if not np.isfinite([np.square(products).sum(), np.square(of_Q).sum()]).all():
        return NoiseFactors(nan, nan, nan, nan, nan, nan, nan)
    of_both = np.zeros_like(goal)
    of_both[0] = 1.0
    # The variance of a squared innovation is twice that of a product of two independent ones.
    weight = np.sqrt(counted.mean(axis=0))
    weight[0] *= math.sqrt(0.5)
    of_R = of_both - of_Q
    apart = of_Q - (np.sum(weight**2 * of_Q * of_both) / np.sum(weight[0] ** 2)) * of_both
    if np.linalg.norm(weight * of_Q) < 1e-3 * np.linalg.norm(weight * of_R):
        columns = [of_both]
    elif np.linalg.norm(weight * apart) < APART * np.linalg.norm(weight * of_Q):
        return NoiseFactors(nan, nan, nan, nan, _left(goal, of_both), nan, nan)
    else:
        columns = [of_R, of_Q]
    basis = np.column_stack([(weight * c).ravel() for c in columns])
    solve = np.linalg.pinv(basis)
    factors = solve @ (weight * goal).ravel()
    fitted = np.tensordot(factors, np.array(columns), 1)
    scatter = (products - counted * fitted) / pairs
    std = _deviations((weight * scatter).reshape(len(scatter), -1) @ solve.T)
    if len(columns) == 1:
        f, far = float(factors[0]), _far(factors, 0, columns, weight, n)
        return NoiseFactors(f, float(std[0]), nan, nan, _left(goal, fitted), far, nan)
    f, g = _not_negative(basis, (weight * goal).ravel(), factors)
    R_far, Q_far = (_far(np.array([f, g]), i, columns, weight, n) for i in range(2))
    left = _left(goal, f * of_R + g * of_Q)
    return NoiseFactors(f, float(std[0]), g, float(std[1]), left, R_far, Q_far)


def _far(factors: Array, which: int, columns: list[Array], weight: Array, n: int) -> float:
    """Distance of a factor from one, by the scatter that it would have if it were one.

    By Bartlett's formula for the products of a normal series with the autocovariance c: those at
    the distances i and j have the covariance sum_k (c_k c_{k+j-i} + c_{k+j} c_{k-i}) / n.
    """
    right = np.where(np.arange(len(factors)) == which, 1.0, factors)
    c = np.tensordot(right, np.array(columns), 1)
    solve = np.linalg.pinv(np.column_stack([(weight * v).ravel() for v in columns]))[which]
    variance, reach = 0.0, len(c)
    for channel, by in enumerate(solve.reshape(c.shape).T):
        whole = np.concatenate([c[:0:-1, channel], c[:, channel]])
        whole = np.pad(whole, 2 * reach)
        middle = len(whole) // 2
        k = np.arange(-reach, reach + 1)
        lags = np.arange(reach)
        i, j = lags[:, None, None], lags[None, :, None]
        at = middle + k
        products = whole[at] * whole[at + j - i] + whole[at + j] * whole[at - i]
        seen = by * weight[:, channel]
        # Pairs that were not measured are fewer, by the square of the weight.
        share = np.maximum(weight[:, channel], 1e-6)
        share = share / np.where(lags == 0, math.sqrt(0.5), 1.0)
        variance += float(seen / share @ products.sum(axis=2) @ (seen / share)) / n
    return float(abs(factors[which] - 1.0) / math.sqrt(max(variance, 1e-300)))


def _not_negative(basis: Array, goal: Array, factors: Array) -> tuple[float, float]:
    """Take the factors, or if one is negative the best other one beside zero."""
    f, g = map(float, factors)
    if f >= 0 and g >= 0:
        return f, g
    alone = basis.T @ goal / np.sum(basis**2, axis=0)
    return (0.0, max(float(alone[1]), 0.0)) if f < 0 else (max(float(alone[0]), 0.0), 0.0)


def _left(goal: Array, fitted: Array) -> float:
    """Largest correlation that is not explained."""
    level = np.abs(goal[:1])
    left = np.abs(goal - fitted)[1:] / np.where(level > 0, level, 1.0)
    return float(np.max(left))


def _deviations(influence: Array) -> Array:
    """Standard deviations of the means of columns (n, c) that follow from each other a little."""
    n = len(influence)
    centred = influence - influence.mean(axis=0)
    total = np.sum(centred**2, axis=0)
    for lag in range(1, min(MEMORY, n - 1) + 1):
        taper = 1 - lag / (MEMORY + 1)
        total = total + 2 * taper * np.sum(centred[lag:] * centred[:-lag], axis=0)
    return np.sqrt(np.maximum(total, 0.0)) / n


def _moments(path: FilterPath) -> tuple[Array, Array, Array]:
    """Products of normalised innovations, what Q adds to their means, and 1 where both are known.

    Each (n, lags + 1, ny); zero where one of the two was not measured.
    """
    n, ny = path.e.shape
    deviation = np.sqrt(np.einsum("kii->ki", path.S))
    z, known = np.nan_to_num(path.e) / deviation, np.isfinite(path.e)
    expected = _expected(path) / deviation[:, None, :]
    count = n - LAGS
    products, by_Q, counted = (np.zeros((count, LAGS + 1, ny)) for _ in range(3))
    for lag in range(LAGS + 1):
        later = slice(lag, lag + count)
        pairs = known[:count] & known[later]
        products[:, lag] = np.where(pairs, z[:count] * z[later], 0.0)
        by_Q[:, lag] = np.where(pairs, expected[:count, lag] / deviation[later], 0.0)
        counted[:, lag] = pairs
    return products, by_Q, counted


def _expected(path: FilterPath) -> Array:
    """Part of Q in the autocovariance of each output's innovations.

    (n, lags + 1, ny), with the earlier sample's index first.
    """
    n, ny, nx = path.H.shape
    H, K = path.H, filter_gains(path)
    closed = path.F @ (np.eye(nx) - K @ H)
    P = np.zeros((n, nx, nx))
    for k in range(n - 1):
        P[k + 1] = closed[k] @ P[k] @ closed[k].T + path.Q[k]
    PH = P @ H.transpose(0, 2, 1)
    C = H @ PH
    found = np.zeros((n, LAGS + 1, ny))
    found[:, 0] = np.einsum("kii->ki", C)
    # Of the errors `lag` samples later with the innovation of sample k.
    across = path.F @ (PH - K @ C)
    for lag in range(1, min(LAGS, n - 1) + 1):
        across = across[: n - lag]
        found[: n - lag, lag] = np.einsum("kij,kji->ki", H[lag:], across)
        across = closed[lag:] @ across
    return found


def filter_gains(path: FilterPath) -> Array:
    """Gain of every sample, P H' R^-1 over the measured outputs, (n, nx, ny)."""
    known = np.isfinite(path.e)
    n, ny, nx = path.H.shape
    K = np.zeros((n, nx, ny))
    for pattern in np.unique(known, axis=0):
        rows, seen = np.flatnonzero((known == pattern).all(axis=1)), np.flatnonzero(pattern)
        if len(seen):
            PH = path.P[rows] @ path.H[rows][:, seen].transpose(0, 2, 1)
            K[np.ix_(rows, np.arange(nx), seen)] = np.linalg.solve(
                path.R[np.ix_(seen, seen)], PH.transpose(0, 2, 1)
            ).transpose(0, 2, 1)
    return K
