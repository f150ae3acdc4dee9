r"""Few groups of columns by their gain: the l0 problem whose unknowns come together.

.. math:: \min_G \|y - H_G a_G\|^2 + \mu \operatorname{rank} H_G

over sets G of groups. A group that is added, exchanged or removed must lower this sum; the search
ends in a set that no single addition, exchange or removal betters.

Source: Lozano, Swirszcz, Abe, "Grouped orthogonal matching pursuit for variable selection and
prediction", 2009, Advances in Neural Information Processing Systems 22; exchanges as in
`_best_subset`.
"""

import numpy as np

from backsight.sparse.regression import DEPENDENT, Fit, Indices, Regression, refit
from backsight.types import Array

LESS = 1e-9
"""A step must lower the sum by this share of it."""


def best_groups(problem: Regression, label: Indices, penalty: float) -> Fit:
    """Search the set of groups of the lowest penalised cost.

    Parameters
    ----------
    problem : Regression
    label : (n,) array
        Which group a column belongs to.
    penalty : float
        What each independent column of a group must gain, as sum of squared residuals.
    """
    members = [np.flatnonzero(label == g) for g in np.unique(label)]
    chosen: list[int] = []
    best = refit(problem, np.zeros(0, np.intp))
    while True:
        tried = _smaller(problem, members, chosen, penalty)
        tried += [[*chosen, g] for g in _largest(problem, members, chosen, penalty)]
        for k in range(len(chosen)):
            rest = chosen[:k] + chosen[k + 1 :]
            tried += [[*rest, g] for g in _largest(problem, members, rest, penalty)]
        fits = [(refit(problem, _columns(members, groups)), groups) for groups in tried]
        better = min(fits, key=lambda f: _sum(f[0], penalty), default=None)
        now = _sum(best, penalty)
        if better is None or _sum(better[0], penalty) >= now - LESS * abs(now):
            return best
        best, chosen = better


def _sum(fit: Fit, penalty: float) -> float:
    return fit.cost + penalty * len(fit.which)


def _columns(members: list[Indices], groups: list[int]) -> Indices:
    return np.concatenate([np.zeros(0, np.intp), *(members[g] for g in groups)])


def _smaller(
    problem: Regression, members: list[Indices], chosen: list[int], penalty: float
) -> list[list[int]]:
    """The set without the group that is worth least."""
    sets = [chosen[:k] + chosen[k + 1 :] for k in range(len(chosen))]
    if not sets:
        return []
    return [min(sets, key=lambda s: _sum(refit(problem, _columns(members, s)), penalty))]


def _largest(
    problem: Regression, members: list[Indices], chosen: list[int], penalty: float
) -> list[int]:
    """The group that gains most beside others, if it gains anything."""
    H, y = problem.columns, problem.target
    basis = _basis(H[:, _columns(members, chosen)])
    left = y - basis @ (basis.T @ y)
    gains = np.full(len(members), -np.inf)
    for g, which in enumerate(members):
        if g not in chosen:
            own = _basis(H[:, which] - basis @ (basis.T @ H[:, which]))
            gains[g] = float(((own.T @ left) ** 2).sum()) - penalty * own.shape[1]
    g = int(gains.argmax())
    return [g] if gains[g] > 0 else []


def _basis(columns: Array) -> Array:
    """Orthonormal columns that span the same; what depends on others is left out."""
    if not columns.shape[1]:
        return columns
    own, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return own[:, sizes > np.sqrt(DEPENDENT) * sizes.max()]
