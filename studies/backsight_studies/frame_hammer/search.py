"""Search a window for a hit: when, at which height, how hard.

The study's own: moments, sizes and pulses to try are those of its rig. The search for sparse forces
in any linear model, exact and without a list of sizes, is `backsight.run.sparse_forces`. With the
clipped sensors as part of the model (`with_sensors`), `follow_hits` tries hits in the raw readings
as this search does, for any model: see `raw`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backsight.types import Array
from backsight_studies.frame_hammer.rig import HEIGHTS, SUBSTEPS
from backsight_studies.frame_hammer.window import Fit, Pulse, Window

COARSE = 4
"""Sub-steps from one moment that is tried to the next."""

IMPULSES = (0.05, 0.12, 0.25, 0.5, -0.05, -0.12, -0.25, -0.5)
"""Sizes that are tried [N s]."""

LOOK_AHEAD = 20
"""Samples after the last moment that are looked at when moments are compared."""

KEPT = 10
"""Starts at every height that are worked out."""


@dataclasses.dataclass(frozen=True)
class Found:
    """The best hit at one height."""

    pulse: Pulse
    fit: Fit


def search(
    window: Window, y: Array, before: Fit, *, first: int, last: int, widths: Sequence[int]
) -> list[Found]:
    """Best hit at every height, in the order of `HEIGHTS`.

    Parameters
    ----------
    window : Window
    y : (4, samples) array
        Signals.
    before : Fit
        Of the part of the window before the hit.
    first, last : int
        Samples between which the hit is.
    widths : sequence of int
        Numbers of the pulses that it may have; every other one is tried at first.
    """
    moments = range(first * SUBSTEPS, last * SUBSTEPS, COARSE)
    head = y[:, : min(last + LOOK_AHEAD, window.samples)]
    found = []
    for height in range(len(HEIGHTS)):
        pulses = [Pulse(m, height, w) for m in moments for w in widths[::2]]
        starts = _starts(window, head, before, pulses)
        found.append(_best(window, y, before, starts, widths))
    return found


def _starts(
    window: Window, y: Array, before: Fit, pulses: list[Pulse]
) -> list[tuple[Pulse, float]]:
    """Pulses and impulses that explain the signals best while nothing else changes."""
    samples = y.shape[1]
    steps = samples * SUBSTEPS
    swing = np.tensordot(before.modes, window.free[..., :steps], 1)
    rest = y - window.fading(before)[:, :samples]
    tried = []
    for pulse in pulses:
        force = window.force(pulse)[:, :steps]
        for impulse in IMPULSES:
            left = rest - window.sensed(window.clipped(swing + impulse * force))
            left = left - left.mean(axis=1, keepdims=True)
            tried.append((float((left**2).sum()), pulse, impulse))
    kept: list[tuple[Pulse, float]] = []
    for _, pulse, impulse in sorted(tried, key=lambda row: row[0]):
        if not any(_same(pulse, impulse, *other) for other in kept):
            kept.append((pulse, impulse))
        if len(kept) == KEPT:
            break
    return kept


def _same(a: Pulse, impulse_a: float, b: Pulse, impulse_b: float) -> bool:
    return abs(a.middle - b.middle) <= COARSE and a.width == b.width and impulse_a * impulse_b > 0


def _best(
    window: Window,
    y: Array,
    before: Fit,
    starts: list[tuple[Pulse, float]],
    widths: Sequence[int],
) -> Found:
    fits = [
        Found(p, window.fit(y, _with_hit(before, impulse), (p,), iterations=6))
        for p, impulse in starts
    ]
    best = min(fits, key=_cost)
    while True:
        tried = [
            Found(p, window.fit(y, best.fit, (p,), iterations=8))
            for p in _neighbours(best.pulse, widths)
        ]
        better = min(tried, key=_cost)
        if _cost(better) > 0.999 * _cost(best):
            return Found(best.pulse, window.fit(y, best.fit, (best.pulse,), iterations=12))
        best = better


def _neighbours(pulse: Pulse, widths: Sequence[int]) -> list[Pulse]:
    """Pulses a little earlier and later, shorter and longer."""
    middles = [dataclasses.replace(pulse, middle=pulse.middle + d) for d in (-2, -1, 1, 2)]
    others = [pulse.width + d for d in (-1, 1) if pulse.width + d in widths]
    return middles + [dataclasses.replace(pulse, width=w) for w in others]


def _with_hit(before: Fit, impulse: float) -> Fit:
    return dataclasses.replace(before, hits=np.array([impulse, 0.0]))


def _cost(found: Found) -> float:
    return found.fit.cost
