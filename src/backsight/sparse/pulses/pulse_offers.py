"""Pulses from which a fit may begin, around what was selected on the grid of places and samples."""

import dataclasses

import numpy as np
import scipy

from backsight.estimators.dictionaries import AbstractPulses, MovingLoads
from backsight.sparse.pulses.pulse_fit import Pulse, PulseDrawing, Reach, grid, pulse_gains
from backsight.sparse.regression import Indices
from backsight.types import Array

AROUND = 1.5
"""How far a pulse may begin from where it was selected [samples]."""

FINE = 4
"""Beginnings that are tried per sample, and places per distance of two places."""

SPEEDS = 6
"""Speeds from which the fit of a load is tried."""

FINEST = 24
"""Speeds that are looked at in one direction, at most."""


@dataclasses.dataclass(frozen=True)
class PulseOffer:
    """Pulses from which the fit of a hit may begin, and how far it may go.

    Parameters
    ----------
    pulses : list of Pulse
    columns : (n ny, pulses) array
        What they explain.
    reach : Reach
    tries : int
        Of how many, of different widths, the fit is tried: the best of the grid may lie in another
        valley than the best of all.
    """

    pulses: list[Pulse]
    columns: Array
    reach: Reach
    tries: int = 1

    def promising(self, drawn: PulseDrawing, target: Array, beside: list[Pulse]) -> list[Pulse]:
        """Pulses that explain most of what others leave, the best first."""
        gain = self.gains(drawn, target, beside)
        chosen: dict[float, Pulse] = {}
        for i in map(int, np.argsort(-gain)):
            chosen.setdefault(self.pulses[i].width if self.tries > 1 else 0.0, self.pulses[i])
        return list(chosen.values())[: self.tries]

    def gains(self, drawn: PulseDrawing, target: Array, beside: list[Pulse]) -> Array:
        """How much of the squared target every pulse explains that others leave."""
        return pulse_gains(self.columns, target, drawn.columns(beside), sign=drawn.sign)


def pulse_offers(drawn: PulseDrawing, d: Array) -> list[PulseOffer]:
    """What may stand for the selected forces, the largest first."""
    if isinstance(drawn.course, MovingLoads):
        return [_loads(drawn, drawn.course, np.flatnonzero(d.any(axis=1)))]
    order = np.argsort(drawn.line.places)
    number, count = scipy.ndimage.label(d[:, order] != 0, structure=np.ones((3, 3)))
    hits = [np.nonzero(number == i + 1) for i in range(count)]
    hits.sort(key=lambda cells: -np.abs(d[:, order][cells]).max())
    return [_hit(drawn, drawn.course, steps, order[along]) for steps, along in hits]


def _loads(drawn: PulseDrawing, course: MovingLoads, steps: Indices) -> PulseOffer:
    """Loads that move; they come on the line before or while there are forces."""
    place, crossings = drawn.line.ends[0], np.array(course.crossings, float)
    longest = np.abs(crossings).max()
    starts = np.arange(max(steps.min() - longest // 4, -longest), steps.max() + 1, 2)
    finer = [_between(crossings[np.sign(crossings) == way]) for way in (-1, 1)]
    pulses = grid((np.array([place]), starts, np.concatenate(finer)))
    wide = np.array([crossings.min(), crossings.max()]) + np.array([-0.1, 0.1]) * longest
    reach = Reach(
        np.array([place, starts[0] - AROUND, wide[0]]), np.array([place, starts[-1], wide[1]])
    )
    return PulseOffer(pulses, drawn.columns(pulses), reach, SPEEDS)


def _between(crossings: Array) -> Array:
    """Crossings of one direction, from the shortest to the longest and a little beyond."""
    if not crossings.size:
        return crossings
    low, high = crossings.min(), crossings.max()
    return np.linspace(low, high, min(FINEST, 1 + int(np.ceil((high - low) / 3))))


def _hit(
    drawn: PulseDrawing, course: AbstractPulses, steps: Indices, forces: Indices
) -> PulseOffer:
    """Hits around some cells of the grid, of steps and forces that touch each other."""
    positions = np.array(drawn.line.places)
    apart = float(np.diff(np.sort(positions)).max(initial=0.0)) or float(np.ptp(drawn.line.ends))
    low = max(positions[forces].min() - apart, drawn.line.ends[0])
    high = min(positions[forces].max() + apart, drawn.line.ends[1])
    places = np.linspace(low, high, max(2, round((high - low) / apart * FINE) + 1))
    first, last = steps.min() - AROUND, steps.max() + AROUND
    starts = np.arange(first, min(last, first + 2 * AROUND) + 1e-9, 1 / FINE)
    widths = np.array(course.lengths, float)
    pulses = grid((places, starts, widths))
    # What was selected may be far from the place: atoms that nearly cancel act like one elsewhere.
    begin, end = drawn.line.ends
    reach = Reach(
        np.array([begin, first - AROUND, widths.min()]),
        np.array([end, last + AROUND, widths.max()]),
    )
    return PulseOffer(pulses, drawn.columns(pulses), reach)
