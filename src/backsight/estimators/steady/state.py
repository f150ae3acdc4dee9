r"""How far a covariance is from its limit, and what a gain of the limit would change.

Let :math:`P = L L'` be the limit of the covariance of a prediction, :math:`\sigma` the roots of its
diagonal, D = diag(:math:`\sigma`), and :math:`\Phi` as in `backsight.discrete.riccati`. Of a filter
that stands :math:`\Delta` away from the limit, :math:`P_k = P + \Delta`, the estimate at any later
sample and that with the gains of the limit differ, since the error of the best estimate is
uncorrelated with every difference of unbiased ones, by a random quantity of the covariance

.. math:: \Phi^i \Delta\, O^{1/2\prime} (I + O^{1/2} \Delta\, O^{1/2\prime})^{-1} O^{1/2} \Delta\,
    \Phi^{i\prime},

where O is what later samples tell of the state, at most :math:`P^{-1}` (a smoothed covariance,
:math:`P - P O P`, is not negative). That is of second order in :math:`\Delta`. k samples later
:math:`\Delta` has become :math:`\Phi^k \Delta (I + O \Delta)^{-1} \Phi^{k\prime}`. So with
:math:`\| D^{-1} \Delta D^{-1} \| \le r`, r at most half the smallest eigenvalue of
:math:`D^{-1} P D^{-1}`, the difference in any direction is at most

.. math:: \varepsilon = 2 \sqrt 2\, r\, \| L^{-1} \Phi^k D \|_F^2

standard deviations (root of the mean square over what the noise may be), then and ever after.
The size of a step from sample to sample would tell nothing: with a slow mode it is small far from
the limit.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy

from backsight.discrete.riccati import Closed, newton_step
from backsight.types import Array

DIFFERENCE = 1e-10
"""Of an estimate with the gain of the limit from that of the exact filter [standard deviations]."""

NEAR = 1e-6
"""A covariance so close to its limit (relative) can be told from it whatever its rounding."""

LEAST = 1e-10
"""Smallest eigenvalue of a limit with a diagonal of ones; below, it is rounding."""

STEPS = 12
"""Of Newton's method; the error of each is the square of that before."""

LONGEST = 10**9
"""Samples to wait that nobody waits for."""


@dataclasses.dataclass(frozen=True)
class SteadyState:
    """A limit, and when a filter may take its gain.

    Parameters
    ----------
    P : (n, n) array
        Covariance of the prediction.
    near : float
        Distance r of the module's documentation.
    wait : int
        Samples k after which a filter that is `near` differs by less than `DIFFERENCE`.
    """

    P: Array
    near: float
    wait: int

    @property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the prediction."""
        return np.sqrt(np.diag(self.P))


def steady_state(start: Array | None, closed: Closed) -> SteadyState | None:
    """The limit of a covariance, by Newton's method from a covariance whose gain holds the errors.

    None if there is none, or it is too close to singular to be told from its neighbours.
    """
    P, powers, change = start, [], np.inf
    for _ in range(STEPS):
        found = None if P is None else newton_step(P, closed)
        if P is None or found is None or not np.diag(found[0]).all():
            return None
        before, (P, powers) = P, found
        sigma = np.sqrt(np.diag(P))
        change = np.linalg.norm((P - before) / np.outer(sigma, sigma))
        if change < NEAR / 10:
            break
    else:
        return None
    near = min(NEAR, float(np.linalg.eigvalsh(P / np.outer(sigma, sigma))[0]) / 2)
    if not (near > LEAST / 2 and change < near / 10):
        return None
    L = np.linalg.cholesky(P)

    def difference(power: Array) -> float:
        left = scipy.linalg.solve_triangular(L, power * sigma, lower=True)
        return float(2 * np.sqrt(2) * near * np.linalg.norm(left) ** 2)

    wait = _first(powers, lambda power: difference(power) <= DIFFERENCE)
    return None if wait is None else SteadyState(P, near, wait)


def _first(powers: list[Array], small: Callable[[Array], bool]) -> int | None:
    """The least k whose power is small, from the powers 1, 2, 4, ... (k is at least 1)."""
    high = next((q for q, power in enumerate(powers) if small(power)), None)
    if high is None or 2**high > LONGEST:
        return None
    if high == 0:
        return 1
    # From the largest power that is not small on, further ones that keep it so.
    k, largest = 2 ** (high - 1), powers[high - 1]
    for q in reversed(range(high - 1)):
        longer = largest @ powers[q]
        if not small(longer):
            k, largest = k + 2**q, longer
    return k + 1
