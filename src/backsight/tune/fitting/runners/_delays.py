"""Delays between channels that a fit tries: those of inputs are in the data."""

from collections.abc import Mapping, Sequence

import numpy as np

from backsight.models.model import Model
from backsight.tune.fitting.values import Unknown
from backsight.types import Array


def shifted(
    u: Array, model: Model, dt: float, unknowns: Sequence[Unknown], values: Mapping[str, float]
) -> Array:
    """Inputs (n, nu) at the times at which they act.

    Between two samples the value is that on the line between them. Of an input that is held this
    is its mean over the sampling period after the delay, and so right to the second order. At the
    ends the first and the last value go on.
    """
    late = np.zeros(model.nu)
    for name, d in input_delays(model, unknowns, values).items():
        late[[s.name for s in model.inputs].index(name)] += d / dt
    if not late.any():
        return u
    k = np.arange(len(u), dtype=float)
    return np.column_stack(
        [np.interp(k + d, k, column) for d, column in zip(late, u.T, strict=True)]
    )


def input_delays(
    model: Model, unknowns: Sequence[Unknown], values: Mapping[str, float]
) -> dict[str, float]:
    """By how much the samples of inputs come late [s], those of the only output taken off."""
    found: dict[str, float] = {}
    for unknown in unknowns:
        if unknown.kind != "delay" or unknown.late_output:
            continue
        only, _, name = unknown.entry.partition(".")
        names, sign = ([name], 1.0) if only == "u" else ([s.name for s in model.inputs], -1.0)
        for n in names:
            found[n] = found.get(n, 0.0) + sign * values[unknown.name]
    return found


def delays_of(
    model: Model, unknowns: Sequence[Unknown], values: Mapping[str, float]
) -> dict[str, float]:
    """The same with the delays of outputs of several, for `backsight.data.remove_delays`."""
    late = {u.entry.partition(".")[2]: values[u.name] for u in unknowns if u.late_output}
    return input_delays(model, unknowns, values) | late
