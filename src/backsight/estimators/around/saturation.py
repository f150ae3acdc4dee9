"""Sensors at the end of their range: such readings do not count, for every method.

A clipped reading says only that the true value lies beyond. Taken as measured it is wrong by what
was cut off, and many standard deviations where the noise is small; so it counts as a gap.
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.engine.recursion import Recursion
from backsight.models.model import Model
from backsight.types import Array

MARGIN = 1e-9
"""Readings as near to an end as this share of the range are at it: units are rounded."""


def ends(model: Model) -> tuple[Array, Array]:
    """Between which values readings of every output count, (ny,) each; infinite without an end."""
    both = np.array([s.saturation or (-np.inf, np.inf) for s in model.outputs]).reshape(-1, 2)
    low, high = both.T
    size = np.where(np.isfinite(both), np.abs(both), 0.0).max(axis=1)
    margin = MARGIN * np.where(np.isfinite(high - low), high - low, size)
    return low + margin, high - margin


def within_range(plain: Recursion, model: Model) -> Recursion:
    """Leave out readings at the end of the range of their sensor."""
    low, high = ends(model)
    if not (np.isfinite(low) | np.isfinite(high)).any():
        return plain
    sizes = (len(plain.carry0), *plain.input_sizes)
    given = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes)]
    carry, u, y, mask = given
    counted = [carry, u, y, mask * _inside(low, high)(y)]

    def changed(function: ca.Function, name: str) -> ca.Function:
        return ca.Function(name, given, function.call(counted, True, False))

    before = plain.innovation
    return dataclasses.replace(
        plain,
        step=changed(plain.step, plain.name),
        innovation=None if before is None else changed(before, "innovation_within_range"),
    )


def _inside(low: Array, high: Array) -> ca.Function:
    """``y -> (ny,)``: 1 where a reading counts."""
    y = ca.SX.sym("y", len(low))
    inside = ca.SX.ones(len(low))
    for i in range(len(low)):
        if np.isfinite(low[i]):
            inside[i] = ca.logic_and(inside[i], y[i] > low[i])
        if np.isfinite(high[i]):
            inside[i] = ca.logic_and(inside[i], y[i] < high[i])
    return ca.Function("inside", [y], [inside])
