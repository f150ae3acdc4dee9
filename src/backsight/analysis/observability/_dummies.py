"""Which dummy measurements would show what sensors leave open."""

from collections.abc import Mapping

import casadi as ca
import numpy as np
import scipy

from backsight.analysis.observability._observability import LINEAR_TOLERANCE, lasting_modes, unseen
from backsight.errors import ModelError
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.types import Array

MOST_DUMMIES = 6
"""Of more nobody knows how large they are."""


def dummies_that_would_do(model: Model) -> tuple[str, ...]:
    """Fewest displacements that, if they were measured, would leave nothing lasting unseen.

    Virtual outputs come first, since they have a place; else they are states that move. One after
    the other, the one that shows most is taken. Empty if the model is not linear, nothing is
    missing, or nothing would do.
    """
    try:
        A, _, C, _ = state_space(model)
    except ModelError:
        return ()
    _, (size, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    balanced = A * size / size[:, None]
    rows = {name: row * size for name, row in _candidates(model, A).items()}
    seen, chosen = C * size, []
    hidden = unseen(balanced, seen, LINEAR_TOLERANCE)[0]
    while lasting_modes(balanced, hidden, size, model):
        left = {
            name: unseen(balanced, np.vstack([seen, row]), LINEAR_TOLERANCE)[0]
            for name, row in rows.items()
            if name not in chosen
        }
        best = min(left, key=lambda name: left[name].shape[1], default=None)
        if best is None or left[best].shape[1] >= hidden.shape[1] or len(chosen) >= MOST_DUMMIES:
            return ()
        chosen.append(best)
        seen, hidden = np.vstack([seen, rows[best]]), left[best]
    return tuple(chosen)


def _candidates(model: Model, A: Array) -> Mapping[str, Array]:
    """Name to row (nx,) of what could be measured."""
    found = {}
    if model.virtual is not None:
        x, u, w = (ca.SX.sym(n, k) for n, k in (("x", model.nx), ("u", model.nu), ("w", model.nx)))
        z = model.virtual.g.call([x, u, ca.SX(model.theta), w])[0]
        for i, s in enumerate(model.virtual.signals):
            plain = ca.jacobian(z[i], ca.vertcat(u, w)).nnz() == 0
            slope = ca.jacobian(z[i], x)
            if plain and not ca.depends_on(slope, x):
                row = ca.Function("row", [x], [ca.densify(slope)])(np.zeros(model.nx))
                found[s.name] = np.asarray(row).ravel()
    moves = np.abs(A).max(axis=1) > 0
    found |= {s.name: np.eye(model.nx)[i] for i, s in enumerate(model.states) if moves[i]}
    return found
