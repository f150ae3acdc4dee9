r"""All minimisers of an l1 problem at once: they are piecewise linear in its weight.

With the columns H, the target y and relative weights w of the columns,

.. math:: \min_a \|y - H a\|^2 + \lambda \sum_i w_i |a_i|

has on every active set S with the signs s the solution
:math:`a_S = (H_S' H_S)^{-1} (H_S' y - \tfrac{\lambda}{2} w_S s_S)`. From the largest useful weight
downwards, the next kink is where a column reaches :math:`2 |h_i' r| = \lambda w_i` and enters, or a
factor reaches zero and leaves.

Sources: Osborne, Presnell, Turlach, "A new approach to variable selection in least squares
problems", 2000, doi:10.1093/imanum/20.3.389; Efron, Hastie, Johnstone, Tibshirani, "Least angle
regression", 2004, doi:10.1214/009053604000000067.
"""

import dataclasses

import numpy as np

from backsight.sparse.regression import Indices, Regression
from backsight.types import Array

CLOSE = 1e-12
"""Kinks nearer to the last one than this share are rounding errors of it."""

TIE = 1e-9
"""Weights are made different by this share, so that columns reach their limits one by one.

A pulse that is the sum of shorter ones, with signs to match, reaches its limit together with them.
"""


@dataclasses.dataclass(frozen=True)
class L1Path:
    """The minimisers, linear between the kinks.

    Parameters
    ----------
    lam : (kinks,) array
        Falling; nothing is active at the first.
    which : (k,) array
        Numbers of the columns that are active anywhere.
    values : (kinks, k) array
        Their factors.
    kkt : float
        Largest violation of the optimality conditions at the last kink, as a share of its weight.
    complete : bool
        Whether the path reached its end; it stops short after too many kinks.
    """

    lam: Array
    which: Indices
    values: Array
    kkt: float
    complete: bool

    def at(self, lam: float) -> tuple[Indices, Array]:
        """Active columns and their factors at a weight not below the last kink."""
        rising = self.lam[::-1]
        values = np.array([np.interp(lam, rising, v[::-1]) for v in self.values.T])
        active = np.flatnonzero(values)
        return self.which[active], values[active]


def l1_path(
    problem: Regression, least: float, *, weights: Array | None = None, most: int = 2000
) -> L1Path:
    """Follow the minimisers from the largest weight with a solution other than zero down.

    Parameters
    ----------
    problem : Regression
    least : float
        Weight at which the path ends.
    weights : (n,) array, optional
        Relative weights w, positive; one if not given.
    most : int
        Kinks after which it gives up.
    """
    n = problem.columns.shape[1]
    own = problem.correlation
    w = (np.ones(n) if weights is None else weights) * (1 + TIE * _scattered(n))
    here = _segment(problem, w, own, [], np.zeros((n, 0)))
    lam, first = here.largest()
    lams, values = [max(lam, least)], [np.zeros(n)]
    if lam > least:
        here = _turned(here, own, first)
    while lam > least and len(lams) <= most:
        after, change = here.next(lam)
        lam = max(after, least)
        lams.append(lam)
        values.append(here.values(lam))
        if after > least:
            here = _turned(here, own, change)
    stacked = np.array(values)
    which = np.flatnonzero(stacked.any(axis=0))
    kkt = here.violation(values[-1], lams[-1]) / lams[-1]
    return L1Path(np.array(lams), which, stacked[:, which], kkt, lam <= least)


def _scattered(n: int) -> Array:
    """Numbers between 0 and 1 that are all different, and the same every time."""
    golden = (np.sqrt(5) - 1) / 2
    return np.arange(1, n + 1) * golden % 1


Change = tuple[int, float]
"""A column and the sign with which it enters, 0 if it leaves."""


@dataclasses.dataclass(frozen=True)
class _Segment:
    """Between two kinks.

    Parameters
    ----------
    problem : Regression
    weights : (n,) array
    active : list of (int, float)
        Columns and the signs of their factors.
    gram : (n, s) array
        Products of all columns with the active ones.
    offset, slope : (s,) arrays
        The active factors are offset - lam * slope.
    p, q : (n,) arrays
        Twice the correlations of all columns with the residual are p + lam * q.
    last : (int, float), optional
        Column that has entered or left at the kink above, and its sign while active. It is on its
        limit there, and not again before the next kink, whatever rounding says.
    """

    problem: Regression
    weights: Array
    active: list[Change]
    gram: Array
    offset: Array
    slope: Array
    p: Array
    q: Array
    last: Change | None

    @property
    def columns(self) -> list[int]:
        """Active columns."""
        return [column for column, _ in self.active]

    def values(self, lam: float) -> Array:
        """Factors of all columns."""
        a = np.zeros(len(self.weights))
        a[self.columns] = self.offset - lam * self.slope
        return a

    def largest(self) -> tuple[float, Change]:
        """Weight from which on nothing is active, and what enters there."""
        reach = self._allowed(self.p / self.weights)
        row, column = np.unravel_index(int(reach.argmax()), reach.shape)
        return max(float(reach[row, column]), 0.0), (int(column), 1.0 - 2.0 * row)

    def next(self, lam: float) -> tuple[float, Change]:
        """Weight of the next kink below lam, 0 if there is none, and what changes."""
        with np.errstate(divide="ignore", invalid="ignore"):
            enter = np.vstack([self.p / (self.weights - self.q), -self.p / (self.weights + self.q)])
            leave = self.offset / self.slope
        enter[0, self.problem.side < 0] = enter[1, self.problem.side > 0] = 0.0
        enter[:, self.columns] = 0.0
        if self.last is not None:
            column, sign = self.last
            enter[0 if sign > 0 else 1, column] = 0.0
            leave[np.array(self.columns) == column] = 0.0
        below = lam * (1 - CLOSE)
        enter = np.where((enter > 0) & (enter < below), enter, 0.0)
        leave = np.where((leave > 0) & (leave < below), leave, 0.0)
        row, column = np.unravel_index(int(enter.argmax()), enter.shape)
        if leave.size and leave.max() > enter[row, column]:
            k = int(leave.argmax())
            return float(leave[k]), (self.columns[k], 0.0)
        return float(enter[row, column]), (int(column), 1.0 - 2.0 * row)

    def violation(self, values: Array, lam: float) -> float:
        """Largest violation of the optimality conditions."""
        residual = self.problem.target - self.problem.columns @ values
        slope = 2 * self.problem.onto(residual)
        beyond = self._allowed(slope).max(axis=0) - lam * self.weights
        bent = np.abs(slope - lam * self.weights * np.sign(values))
        return float(np.where(values != 0, bent, np.maximum(beyond, 0)).max(initial=0.0))

    def _allowed(self, values: Array) -> Array:
        """Values upwards and downwards, (2, n); -inf where the sign is not allowed."""
        side = self.problem.side
        up, down = np.where(side >= 0, values, -np.inf), np.where(side <= 0, -values, -np.inf)
        return np.vstack([up, down])


def _turned(here: _Segment, own: Array, change: Change) -> _Segment:
    """Return the segment behind a kink; `own` is the correlation with the target."""
    column, sign = change
    if sign == 0.0:
        k = here.columns.index(column)
        rest = here.active[:k] + here.active[k + 1 :]
        gram = np.delete(here.gram, k, axis=1)
        return _segment(here.problem, here.weights, own, rest, gram, last=here.active[k])
    gram = np.column_stack([here.gram, here.problem.products(column)])
    return _segment(here.problem, here.weights, own, [*here.active, change], gram, last=change)


def _segment(
    problem: Regression,
    weights: Array,
    own: Array,
    active: list[Change],
    gram: Array,
    *,
    last: Change | None = None,
) -> _Segment:
    columns, signs = [c for c, _ in active], np.array([s for _, s in active])
    right = np.column_stack([own[columns], weights[columns] * signs / 2])
    if active:
        right = np.linalg.solve(gram[columns], right)
    offset, slope = right.T
    told, change = np.einsum("ns,sk->kn", gram, np.column_stack([offset, slope]))
    p, q = 2 * (own - told), 2 * change
    return _Segment(problem, weights, active, gram, offset, slope, p, q, last)
