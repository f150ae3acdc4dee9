"""Search of a window for a hit: at which force, when, how long and how hard."""

import dataclasses
import itertools

import numpy as np

from backsight.sparse.nonlinear._window import HitPulse, HitWindow, WindowFit
from backsight.types import Array

PER_WIDTH = 3
"""Beginnings that are tried within the shortest pulse."""

AHEAD = 8.0
"""Longest pulses after the last beginning by which what is tried is judged at first."""

KEPT = 3
"""Starts at every force that are worked out."""

COARSE, FINE = 8, 20
"""Evaluations of a fit from every start, and of the best one."""


@dataclasses.dataclass(frozen=True)
class Offered:
    """What is tried.

    Parameters
    ----------
    forces : tuple of int
        Where a hit may be.
    sizes : (s,) array
        Heights of the pulse, positive.
    signs : dict
        Number of a force to 1 or -1, if its sign is known.
    first, last : float
        Between which samples of the window a pulse begins.
    """

    forces: tuple[int, ...]
    sizes: Array
    signs: dict[int, float]
    first: float
    last: float


def found_hits(window: HitWindow, before: Array, offered: Offered) -> list[WindowFit]:
    """The best hit at every force, the best of all first.

    Sensors at their limits, or a stop, make many valleys, and a linearisation leads from a start
    to the next one only. So hits of many sizes are tried by the equations themselves, and the best
    few at every force are worked out.

    Parameters
    ----------
    window : HitWindow
    before : (nx,) array
        First state as the part before the hit has it.
    offered : Offered
    """
    tried = _pulses(window, offered)
    order = np.argsort(_costs(window, before, tried, offered))
    best = []
    for force in offered.forces:
        sign = offered.signs.get(force, 0.0)
        starts = _apart([tried[i] for i in order if tried[i].force == force], window)
        fits = [window.fit(before, start, tries=COARSE, sign=sign) for start in starts]
        near = min(fits, key=lambda fit: fit.cost)
        best.append(window.fit(near.x0, near.hit, tries=FINE, sign=sign))
    return sorted(best, key=lambda fit: fit.cost)


def _pulses(window: HitWindow, offered: Offered) -> list[HitPulse]:
    lengths, alone = window.course.lengths, (0.0,) * len(window.beside)
    starts = np.arange(offered.first, offered.last + 1e-9, min(lengths) / PER_WIDTH)
    found = []
    for force, start, width in itertools.product(offered.forces, starts, lengths):
        sign = offered.signs.get(force, 0.0)
        for s in (1.0, -1.0):
            if s * sign >= 0:
                found += [
                    HitPulse(force, float(start), float(width), (float(s * a), *alone))
                    for a in offered.sizes
                ]
    return found


def _costs(window: HitWindow, x0: Array, tried: list[HitPulse], offered: Offered) -> Array:
    """What each leaves of the first measurements after it, all else as before, side by side."""
    motion, data = window.motion, window.data
    nu, nf = motion.forced.nu, len(motion.forced.names)
    first = max(int(offered.first), 0)
    longest = window.course.lasts * max(window.course.lengths)
    last = min(window.samples, int(offered.last + AHEAD * longest) + 1)
    v = motion.inputs(data.u, np.zeros((window.samples, nf)))
    x = np.tile(motion.states(x0, v[:first])[-1] if first else x0, (len(tried), 1))
    courses = {(p.start, p.width): window.pulse(p.start, p.width) for p in tried}
    acting = np.array([courses[p.start, p.width] * p.sizes[0] for p in tried]).T
    rows = nu + np.array([p.force for p in tried])
    unit = motion.forced.system.s.su[rows]
    counts, cost = data.counts, np.zeros(len(tried))
    for k in range(first, last):
        given = np.tile(v[k], (len(tried), 1))
        given[np.arange(len(tried)), rows] += acting[k] / unit
        if counts[k]:
            left = (data.y[k] - motion.outputs(x, given)) @ data.root[k].T
            cost += np.einsum("ij,ij->i", left, left)
        x = motion.next(x, given)
    return np.where(np.isfinite(cost), cost, np.inf)


def _apart(pulses: list[HitPulse], window: HitWindow) -> list[HitPulse]:
    """The first few that do not lie beside a better one."""
    near, kept = min(window.course.lengths) / PER_WIDTH + 1e-9, []
    for p in pulses:
        beside = (
            q.width == p.width and abs(q.start - p.start) <= near and q.sizes[0] * p.sizes[0] > 0
            for q in kept
        )
        if not any(beside):
            kept.append(p)
        if len(kept) == KEPT:
            break
    return kept
