"""Loads that move along a line of places."""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Annotated, final

import numpy as np
import scipy

from backsight.description import Description, Distinct, Sound
from backsight.errors import TuningError
from backsight.estimators.force_estimator import AbstractDictionary
from backsight.types import Array

PARTS = 16
"""Moments of a step over which the place of a moving load is averaged."""


@final
@dataclasses.dataclass(frozen=True)
class ForceLine(Description):
    r"""Places of forces along a line, so that a force may act between them.

    A force at x acts as forces at the places with the weights :math:`N_i(x)` of the cubic spline
    through them: the deflections of every mode are interpolated.

    Parameters
    ----------
    places : tuple of float
        Position of every force [m], in the order of the estimator's `forces`.
    supports : tuple of float
        Positions at which the structure does not move, such as the ends of a bridge.

    Examples
    --------
    >>> line = bs.forces.ForceLine((0.25, 0.5, 0.75), supports=(0.0, 1.0))
    >>> line.places
    (0.25, 0.5, 0.75)

    References
    ----------
    Kirchner, Croes, Cosco, Desmet, "Exploiting input sparsity for joint state/input moving horizon
    estimation", 2018, section 4.1, doi:10.1016/j.ymssp.2017.08.024.
    """

    places: Annotated[tuple[float, ...], Distinct()]
    supports: Annotated[tuple[float, ...], Distinct()] = ()

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if not sound("places", "supports"):
            return
        both = {*self.places} & {*self.supports}
        if both:
            yield f"a force at {min(both):g} m, which is a support, moves nothing"
        if len(self.places) + len(self.supports) < 2 or not self.places:
            yield f"places is {self.places}; a line has two places or more"

    @property
    def ends(self) -> tuple[float, float]:
        """First and last position, supports included [m]."""
        all_ = (*self.places, *self.supports)
        return min(all_), max(all_)

    def weights(self, positions: Array) -> Array:
        """Forces at the places that act as one at the positions, (n, places); 0 off the line."""
        first, last = self.ends
        on = (positions >= first) & (positions <= last)
        return np.where(on[:, None], self._spline(positions), 0.0)

    @functools.cached_property
    def _spline(self) -> "scipy.interpolate.CubicSpline":
        """Weights of the places; at the supports all of them are zero."""
        nodes = np.array([*self.places, *self.supports])
        order = np.argsort(nodes)
        return scipy.interpolate.CubicSpline(
            nodes[order], np.eye(len(nodes))[order][:, : len(self.places)]
        )

    def check(self, forces: int) -> None:
        """Raise `TuningError` unless there is a place for every force."""
        if len(self.places) != forces:
            raise TuningError(f"the line has {len(self.places)} places; there are {forces} forces")


@final
@dataclasses.dataclass(frozen=True)
class MovingLoads(AbstractDictionary):
    """Loads of the size 1 that move along a line at constant speed, such as an axle on a bridge.

    Parameters
    ----------
    line : ForceLine
    crossings : tuple of int
        Sampling periods from the first position of the line to its last, supports included;
        negative from the last to the first. Loads of all these speeds are offered.

    Examples
    --------
    >>> line = bs.forces.ForceLine((0.25, 0.5, 0.75), supports=(0.0, 1.0))
    >>> bs.forces.MovingLoads(line, crossings=(20, -20)).crossings
    (20, -20)
    """

    line: ForceLine
    crossings: Annotated[tuple[int, ...], Distinct()]

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("crossings") and (not self.crossings or 0 in self.crossings):
            yield f"crossings is {self.crossings}; give whole numbers of samples other than 0"

    def shapes(self, forces: int) -> Array:
        """See `AbstractDictionary.shapes`."""
        self.line.check(forces)
        steps = max(map(abs, self.crossings))
        found = np.zeros((forces, steps, len(self.crossings)))
        edges = np.linspace(0.0, steps, PARTS * steps + 1)
        for i, crossing in enumerate(self.crossings):
            fine = self.moved(edges, start=0.0, crossing=crossing)
            found[:, :, i] = fine.reshape(steps, PARTS, forces).mean(axis=1).T
        return found

    def moved(self, edges: Array, *, start: float, crossing: float) -> Array:
        """Mean forces at the places between each two neighbours of `edges`, (n, places).

        Parameters
        ----------
        edges : (n + 1,) array
            Moments, in sampling periods.
        start : float
            Moment at which the load comes on the line.
        crossing : float
            As `crossings`, any number.
        """
        first, last = self.line.ends if crossing > 0 else self.line.ends[::-1]
        end = start + abs(crossing)
        low, high = np.maximum(edges[:-1], start), np.minimum(edges[1:], end)
        share = np.maximum(high - low, 0.0) / np.diff(edges)
        on = share > 0
        gone = ((low + high)[on] / 2 - start) / abs(crossing)
        found = np.zeros((len(share), len(self.line.places)))
        found[on] = share[on, None] * self.line.weights(first + gone * (last - first))
        return found
