"""What a fit could not find, and why."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.rounding import significant
from backsight.tune.fitting._descent import Optimum
from backsight.tune.fitting._objective import Coordinate, Objective
from backsight.tune.fitting.tuned import HeldOut
from backsight.types import Array

POINTS = (-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 3.0)
"""Places of a profile, in standard deviations."""

WIDEST = 2.5
"""Largest distance on the scale at which a profile is looked at, a factor of 12 per deviation."""

FLAT = 1.92
"""Rise of minus the log-likelihood at the end of a 95 % interval."""

UNSURE = 0.5
"""Share of the prior's standard deviation from which on a recording says hardly anything."""

INSEPARABLE = 0.98
"""Correlation from which on two values cannot be told apart."""

DIFFERENT = 10.0
"""By how much the second half may be predicted worse than by its own values, beyond chance."""


def profiles_of(objective: Objective, best: Optimum, covariance: Array) -> xr.Dataset:
    """Rise of the criterion if a value is moved and the others follow (to first order)."""
    names = [c.name for c in objective.coordinates]
    values, rises = [], []
    for i, c in enumerate(objective.coordinates):
        size = min(float(np.sqrt(covariance[i, i])), WIDEST)
        along = covariance[:, i] / covariance[i, i]
        places = [best.place, *(best.place + k * size * along for k in POINTS)]
        costs = objective.cost_at(places)
        rises.append([cost - costs[0] for cost in costs[1:]])
        values.append([c.unknown.scale.value(float(place[i])) for place in places[1:]])
    return xr.Dataset(
        {
            "value": (("name", "point"), np.array(values)),
            "rise": (("name", "point"), np.array(rises)),
        },
        coords={"name": names, "point": list(POINTS)},
    )


def doubts_of(
    objective: Objective,
    best: Optimum,
    covariance: Array,
    ratio: Array,
    profiles: xr.Dataset | None,
) -> list[str]:
    """Sentences on values that the recordings do not tell."""
    found = []
    for i, c in enumerate(objective.coordinates):
        scale, place = c.unknown.scale, float(best.place[i])
        value = significant(scale.value(place), 3)
        if scale.at_bound(place):
            found.append(f"{c.name} is at its bound, {value}: the optimum may lie beyond")
        elif why := _unsure(c, float(np.sqrt(covariance[i, i])), profiles):
            found.append(f"{c.name} is hardly known: {why}")
    size = np.sqrt(np.diag(covariance))
    rho = covariance / np.outer(size, size)
    for i, a in enumerate(objective.coordinates):
        for j, b in enumerate(objective.coordinates[:i]):
            if abs(rho[i, j]) > INSEPARABLE:
                found.append(
                    f"{b.name} and {a.name} cannot be told apart (correlation {rho[i, j]:+.3f}): "
                    "fix one of them"
                )
    if objective.criterion.independent and (ratio > 2).any():
        worst = objective.coordinates[int(np.argmax(ratio))].name
        found.append(
            f"the innovations are not what the model says, even with these values: ± is up to "
            f"{ratio.max():.1f} times what it would be ({worst}); see check_consistency"
        )
    return found


def _unsure(c: Coordinate, size: float, profiles: xr.Dataset | None) -> str:
    """Why a value is hardly known; empty if it is."""
    if profiles is not None:
        profile = profiles.sel(name=c.name).sortby("value")
        rise, value = profile["rise"].values, profile["value"].values
        contradicted = np.flatnonzero(rise >= FLAT)
        ends = f"{significant(float(value[0]), 2)} to {significant(float(value[-1]), 2)}"
        if not len(contradicted):
            return f"the criterion is flat from {ends}"
        if rise[0] < FLAT:
            limit = significant(float(value[contradicted[0]]), 2)
            return f"anything below {limit} explains the recording as well"
        if rise[-1] < FLAT:
            limit = significant(float(value[contradicted[-1]]), 2)
            return f"anything above {limit} explains the recording as well"
    if size > UNSURE * c.unknown.spread:
        return "the recording says little more than the prior"
    return ""


def doubts_of_search(best: Optimum, worse: Sequence[float], passes: float) -> list[str]:
    """Sentences on the search itself."""
    found = []
    if not best.converged:
        found.append(
            f"the search has not ended after {passes:.0f} passes: start nearer, or give more"
        )
    other = [w for w in worse if FLAT < w < np.inf]
    if other:
        found.append(
            f"{len(other)} of {len(worse)} searches ended elsewhere, with a criterion that is "
            f"{significant(min(other), 3)} worse: there are several optima"
        )
    return found


def doubts_of_halves(held_out: HeldOut, count: int, *, inflated: float = 1.0) -> list[str]:
    """Sentences on how the values of one half do in the other.

    Of errors that follow from each other, chance is `inflated` by as much as variances are.
    """
    loss = held_out.first_half - held_out.everything
    if loss > (DIFFERENT + 3 * count) * inflated:
        return [
            "the two halves of the recording want different values: those of the first predict "
            f"the second {significant(loss, 3)} worse than those of both"
        ]
    return []
