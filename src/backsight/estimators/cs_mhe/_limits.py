"""Limits of a window (eq. 14): of sums of states, residuals and noise, and of the factors."""

from collections.abc import Iterator, Mapping, Sequence

import casadi as ca
import numpy as np

from backsight.errors import ModelError, TuningError, nearest
from backsight.estimators.cs_mhe.carryover import Carryover
from backsight.estimators.force_estimator import AbstractDictionary
from backsight.estimators.parts.leaf import Results, leaf
from backsight.estimators.parts.limits import Limit, Limits
from backsight.models.model import Model
from backsight.models.signals import Signal, vector
from backsight.types import Array, ByName

NO_LIMIT = 1e30
"""A weight of the l1 norm with which no force is found, and a limit that is none."""


def limited_sample(limits: Limits) -> ca.Function:
    """Ends of the limits of a sample: ``(count, x, e, m, last) -> (count, low, high)``.

    A limit of what was not measured has no ends; that of a constant is that of the last sample.
    """

    def formula(count: ca.SX, x: ca.SX, e: ca.SX, m: ca.SX, last: ca.SX) -> Results:
        residual = e / ca.if_else(m > 0, m, 1)
        value = ca.DM(limits.state) @ x + ca.DM(limits.residual) @ residual
        low, high = ca.SX(limits.lower) - value, ca.SX(limits.upper) - value
        for r, once in enumerate(limits.once):
            needed = [m[int(j)] for j in np.flatnonzero(limits.residual[r])]
            counts = ca.mmin(ca.vertcat(last if once else 1, *needed)) > 0
            low[r] = ca.if_else(counts, ca.fmax(low[r], -NO_LIMIT), -NO_LIMIT)
            high[r] = ca.if_else(counts, ca.fmin(high[r], NO_LIMIT), NO_LIMIT)
        return {"count_next": count + 1, "low": low, "high": high}

    ny, nx = limits.residual.shape[1], limits.state.shape[1]
    return leaf("limited_sample", {"count": 1, "x": nx, "e": ny, "m": ny, "last": 1}, formula)


def caps(
    largest: ByName,
    forces: Sequence[Signal],
    dictionary: AbstractDictionary,
    carryover: Carryover | None,
) -> Array:
    """Largest factors of the atoms, and their largest changes where one is expected, (2, atoms).

    Raises
    ------
    TuningError
        If an atom moves several forces that have different ones.
    """
    sizes = by_force("largest", largest, forces, otherwise=np.inf)
    belongs = dictionary.force_of(len(sizes))
    if min(belongs) < 0 and len(set(sizes)) > 1:
        raise TuningError(
            "largest differs from force to force, but the dictionary has atoms that move several: "
            "give one number"
        )
    change = np.inf if carryover is None else carryover.change
    return np.minimum([[sizes[i] for i in belongs], [change] * len(belongs)], NO_LIMIT)


def by_force(what: str, given: ByName, forces: Sequence[Signal], *, otherwise: float) -> Array:
    """Values by name, or one for all, for every force."""
    try:
        return vector(given, forces, what=what, default=np.full(len(forces), otherwise))
    except ModelError as error:
        raise TuningError(str(error)) from None


def check_unlimited(model: Model, limits: Sequence[Limit], largest: ByName) -> None:
    """Raise `TuningError` if something has limits: only the moving window keeps them."""
    limited = [s.name for s in model.states if np.isfinite(s.lower) or np.isfinite(s.upper)]
    limited += [limit.name for limit in limits]
    sizes = [*largest.values()] if isinstance(largest, Mapping) else [largest]
    if np.isfinite(np.concatenate([np.ravel(k) for k in sizes])).any():
        limited.append("largest")
    if limited:
        raise TuningError(
            f"limits of {', '.join(limited)} are kept by the moving window only, not by what takes "
            "a whole recording at once: leave them out"
        )


def sides(
    forces: Sequence[str],
    nonnegative: Sequence[str],
    nonpositive: Sequence[str],
    dictionary: AbstractDictionary,
) -> Array:
    """Sign of every atom: 1, -1, or 0 if it is free.

    Raises
    ------
    TuningError
        If an atom of several forces is to have a sign.
    """
    side = np.zeros(len(forces))
    for names, sign in ((nonnegative, 1.0), (nonpositive, -1.0)):
        for name in names:
            side[forces.index(name)] += sign
    belongs = dictionary.force_of(len(side))
    if side.any() and min(belongs) < 0:
        raise TuningError("forces of a known sign need a dictionary whose atoms are of one force")
    return side[belongs]


def sign_faults(
    forces: Sequence[str], nonnegative: Sequence[str], nonpositive: Sequence[str]
) -> Iterator[str]:
    """Say which names of forces, and of those with a sign, cannot be."""
    if not forces:
        yield "forces: no unknown force is named"
    for name in dict.fromkeys((*nonnegative, *nonpositive)):
        if name not in forces:
            yield f"'{name}' is none of the forces: {nearest(name, forces)}"
        elif name in nonnegative and name in nonpositive:
            yield f"the force '{name}' is nonnegative and nonpositive: it is zero"
