r"""Few columns by their gain: the l0 problem, searched greedily with swaps.

.. math:: \min_S \|y - H_S a_S\|^2 + \mu |S|

A column that is added, exchanged or removed must lower this sum, so that the search ends; it ends
in a set that no single addition, exchange or removal betters.

Sources: Chen, Billings, Luo, "Orthogonal least squares methods", 1989,
doi:10.1080/00207178908953472; Miller, "Subset Selection in Regression", 2002,
doi:10.1201/9781420035933, section 3.6 (exchanges).
"""

import numpy as np

from backsight.sparse.regression import Fit, Indices, Regression, beside, refit

LESS = 1e-9
"""A step must lower the sum by this share of it."""


def best_subset(
    problem: Regression, penalty: float, *, start: Indices | None = None, most: int | None = None
) -> Fit:
    """Search the set of columns of the lowest penalised cost.

    Parameters
    ----------
    problem : Regression
    penalty : float
        What a column must gain, as sum of squared residuals.
    start : (s,) array, optional
        Set to start from; the empty one if not given.
    most : int, optional
        Columns that the set may hold.
    """
    limit = len(problem.target) - 1 if most is None else most
    best = refit(problem, np.zeros(0, np.intp) if start is None else start)
    while True:
        found = _shrunk(problem, best, penalty)
        if found is None and len(best.which) < limit:
            found = _grown(problem, best.which, best.cost - penalty)
        if found is None:
            found = _swapped(problem, best)
        if found is None:
            return best
        best = found


def _grown(problem: Regression, which: Indices, below: float) -> Fit | None:
    """With the column that gains most, if the cost falls below a bound and the signs allow it."""
    correlation, left = beside(problem, which)
    correlation = np.where(problem.side * correlation < 0, 0.0, correlation)
    gain = correlation**2 / np.where(left > 0, left, np.inf)
    column = int(gain.argmax())
    if not gain[column] > 0:
        return None
    found = refit(problem, np.append(which, column))
    lower = found.cost < below - LESS * abs(below)
    return found if lower and len(found.which) == len(which) + 1 else None


def _shrunk(problem: Regression, best: Fit, penalty: float) -> Fit | None:
    """Without the column that is worth least, if that is less than its penalty."""
    if not len(best.which):
        return None
    worth = best.values**2 / np.diag(best.covariance)
    k = int(worth.argmin())
    if worth[k] >= penalty * (1 - LESS):
        return None
    return refit(problem, np.delete(best.which, k))


def _swapped(problem: Regression, best: Fit) -> Fit | None:
    """With one column exchanged for another, the first exchange that lowers the cost."""
    for k in range(len(best.which)):
        found = _grown(problem, np.delete(best.which, k), best.cost)
        if found is not None:
            return found
    return None
