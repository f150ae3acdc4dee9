"""Dictionaries of pulses: a force at one place whose course over time is known up to its width."""

import abc
import dataclasses
import math
from collections.abc import Iterator
from typing import Annotated, final

import numpy as np

from backsight.description import Count, Distinct, Sound
from backsight.estimators.force_estimator import AbstractDictionary
from backsight.types import Array

GONE = 6
"""Time constants after which a decaying force is over: 0.25 % are left."""


@dataclasses.dataclass(frozen=True)
class AbstractPulses(AbstractDictionary):
    """Pulses of one course and several widths, at every force.

    The course is a function of s, the time since the beginning by the width.
    """

    @property
    @abc.abstractmethod
    def lengths(self) -> tuple[int, ...]:
        """Widths that are offered [samples]."""

    @property
    def lasts(self) -> int:
        """Widths after which a pulse is over."""
        return 1

    @abc.abstractmethod
    def course(self, s: Array) -> Array:
        """Force at s, from 0 to `lasts`; its largest value is one."""

    @abc.abstractmethod
    def impulse(self, s: Array) -> Array:
        """Integral of the course from 0 to s, which lies from 0 to `lasts`."""

    def shapes(self, forces: int) -> Array:
        """See `AbstractDictionary.shapes`: the force in the middle of every step."""
        steps = self.lasts * max(self.lengths)
        pulses = np.zeros((forces, steps, len(self.lengths), forces))
        for i, width in enumerate(self.lengths):
            course = self.course((np.arange(self.lasts * width) + 0.5) / width)
            pulses[:, : len(course), i, :] = course[:, np.newaxis] * np.eye(forces)[:, np.newaxis]
        return pulses.reshape(forces, steps, -1)

    def means(self, edges: Array, *, start: float, width: float) -> Array:
        """Mean force between each two neighbours of `edges`, of a pulse that begins at `start`."""
        reached = width * self.impulse(np.clip((edges - start) / width, 0.0, self.lasts))
        return np.diff(reached) / np.diff(edges)

    def middle(self, *, start: float, width: float) -> float:
        """Centre of gravity over time of a pulse that begins at `start`."""
        edges = np.linspace(start, start + self.lasts * width, 1001)
        mean = self.means(edges, start=start, width=width)
        return float(mean @ (edges[1:] + edges[:-1]) / 2 / mean.sum())


@dataclasses.dataclass(frozen=True)
class AbstractWidths(AbstractPulses):
    """Pulses whose widths are a field."""

    widths: Annotated[tuple[Count, ...], Distinct()] = (2,)

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("widths") and not self.widths:
            yield "widths is (); give whole numbers of samples from 1 on"

    @property
    def lengths(self) -> tuple[int, ...]:
        """See `AbstractPulses.lengths`."""
        return self.widths


@final
@dataclasses.dataclass(frozen=True)
class HalfSines(AbstractWidths):
    """Half-sine pulses of the height 1, as of a hammer, at every force.

    Parameters
    ----------
    widths : tuple of int
        Durations in sampling periods; pulses of all of them are offered.

    Examples
    --------
    >>> bs.forces.HalfSines(widths=(2, 4)).widths
    (2, 4)
    """

    def course(self, s: Array) -> Array:
        """See `AbstractPulses.course`."""
        return np.sin(np.pi * s)

    def impulse(self, s: Array) -> Array:
        """See `AbstractPulses.impulse`."""
        return (1 - np.cos(np.pi * s)) / np.pi


@final
@dataclasses.dataclass(frozen=True)
class Haversines(AbstractWidths):
    """Pulses of the height 1 that begin and end softly, as of a soft bumper: squared half-sines.

    Parameters
    ----------
    widths : tuple of int
        Durations in sampling periods; pulses of all of them are offered.

    Examples
    --------
    >>> bs.forces.Haversines(widths=(2, 4)).widths
    (2, 4)
    """

    def course(self, s: Array) -> Array:
        """See `AbstractPulses.course`."""
        return np.sin(np.pi * s) ** 2

    def impulse(self, s: Array) -> Array:
        """See `AbstractPulses.impulse`."""
        return s / 2 - np.sin(2 * np.pi * s) / (4 * np.pi)


@final
@dataclasses.dataclass(frozen=True)
class Splines(AbstractWidths):
    r"""Cubic B-splines of the height 1: few of them make a smooth force.

    Parameters
    ----------
    widths : tuple of int
        Lengths of the splines in sampling periods, four times the distance of their knots.

    Examples
    --------
    >>> bs.forces.Splines(widths=(2, 4)).widths
    (2, 4)
    """

    def course(self, s: Array) -> Array:
        """See `AbstractPulses.course`."""
        return 1.5 * _powers(s, 3)

    def impulse(self, s: Array) -> Array:
        """See `AbstractPulses.impulse`."""
        return 1.5 * _powers(s, 4) / 4


def _powers(s: Array, n: int) -> Array:
    """Sum of truncated powers, a B-spline over the knots 0, 1/4 ... 1 or its integral by 4 s."""
    signs = [(-1) ** i * math.comb(4, i) / math.factorial(n) for i in range(5)]
    return np.maximum(4 * s[..., None] - np.arange(5), 0.0) ** n @ np.array(signs)


@final
@dataclasses.dataclass(frozen=True)
class Decays(AbstractWidths):
    """Forces that begin at once with 1 and decay exponentially.

    Parameters
    ----------
    widths : tuple of int
        Time constants in sampling periods; after six of them a force is over.

    Examples
    --------
    >>> bs.forces.Decays(widths=(2, 4)).widths
    (2, 4)
    """

    @property
    def lasts(self) -> int:
        """See `AbstractPulses.lasts`."""
        return GONE

    def course(self, s: Array) -> Array:
        """See `AbstractPulses.course`."""
        return np.exp(-s)

    def impulse(self, s: Array) -> Array:
        """See `AbstractPulses.impulse`."""
        return 1 - np.exp(-s)


@final
@dataclasses.dataclass(frozen=True)
class SteadyLoads(AbstractPulses):
    """Forces that come at once, stay, and go: a load that is put on.

    Parameters
    ----------
    length : int
        For how many samples a force stays. In a whole recording the length of the recording stands
        for a load that never goes; a window must be as long.

    Examples
    --------
    >>> bs.forces.SteadyLoads(length=3).shapes(1).shape  # one force, on for three samples
    (1, 3, 1)
    """

    length: Count

    @property
    def lengths(self) -> tuple[int, ...]:
        """See `AbstractPulses.lengths`."""
        return (self.length,)

    def course(self, s: Array) -> Array:
        """See `AbstractPulses.course`."""
        return np.ones_like(s)

    def impulse(self, s: Array) -> Array:
        """See `AbstractPulses.impulse`."""
        return s


@final
@dataclasses.dataclass(frozen=True)
class Impulses(AbstractPulses):
    """Every force at every step by itself: short hits, the identity as dictionary.

    Examples
    --------
    >>> bs.forces.Impulses()
    Impulses()
    """

    @property
    def lengths(self) -> tuple[int, ...]:
        """See `AbstractPulses.lengths`."""
        return (1,)

    def course(self, s: Array) -> Array:
        """See `AbstractPulses.course`."""
        return np.ones_like(s)

    def impulse(self, s: Array) -> Array:
        """See `AbstractPulses.impulse`."""
        return s
