"""The search for the best place: scoring steps in a trust region, from several starts."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy

from backsight.tune.fitting._objective import Evaluation, Objective
from backsight.types import Array

NEAR, ROUGHLY = 1e-3, 3e-2
"""A place is the best one if the next step is shorter, in standard deviations of the estimate; and
one from which the search goes on, or that a run of its own for every derivative has found."""

EXCERPT = 10_000
"""Samples from which the first places are found; the whole recordings only refine them."""

AGAIN = 25
"""Evaluations after which a search from a random place is given up: with values far from right a
nonlinear filter may lose its way, and then creeps."""

FAR = 1.6
"""Size of the random moves from which the search starts again, a factor of five."""


@dataclasses.dataclass
class Search:
    """Evaluations so far; the share of a pass that excerpts take counts.

    Parameters
    ----------
    most : float
        Passes at most, but for the one that a search begins with.
    progress : callable
        Told the passes done.
    samples : int
        Of a pass.
    """

    most: float
    progress: Callable[[float], None]
    samples: int
    passes: float = 0.0
    history: list[tuple[float, float, Array]] = dataclasses.field(default_factory=list)
    # An objective is kept with what was found, so that its identity stays its own.
    known: dict[tuple[int, bytes], tuple[Objective, Evaluation]] = dataclasses.field(
        default_factory=dict
    )

    @property
    def exhausted(self) -> bool:
        """Whether no pass is left."""
        return self.passes >= self.most

    def has(self, objective: Objective, place: Array) -> bool:
        """Whether a place was evaluated before."""
        return (id(objective), place.tobytes()) in self.known

    def evaluate(self, objective: Objective, place: Array) -> Evaluation:
        """One pass, or a part of one, if the place is new."""
        key = id(objective), place.tobytes()
        if key not in self.known:
            found = objective.at(place)
            self.known[key] = objective, found
            self.passes += objective.samples / self.samples
            self.history.append((self.passes, found.cost, place.copy()))
            self.progress(self.passes)
        return self.known[key][1]


@dataclasses.dataclass(frozen=True)
class Optimum:
    """Where a search ended.

    Parameters
    ----------
    place : array
    evaluation : Evaluation
    converged : bool
    """

    place: Array
    evaluation: Evaluation
    converged: bool


class _FoundError(Exception):
    """The step is short enough: scipy has no criterion in standard deviations."""


def descend(
    objective: Objective, start: Array, search: Search, *, near: float, most: float = math.inf
) -> Optimum:
    """Fisher scoring from one start, in a trust region (Moré and Sorensen, `scipy`).

    It ends when the next step is shorter than `near`, or one as short has brought nothing: of a
    delay the criterion has an edge at every whole sample. Or the passes are used up, or so many
    evaluations.
    """
    begun = len(search.history)
    best: list[tuple[float, Array, Evaluation]] = []
    converged = False

    def at(given: Array) -> Evaluation:
        nonlocal converged
        place = np.array(given, float)
        new = not search.has(objective, place)
        used_up = search.exhausted or len(search.history) - begun >= most
        if best and used_up and new:
            raise _FoundError
        found = search.evaluate(objective, place)
        if not best or found.cost < best[0][0]:
            best[:] = [(found.cost, place, found)]
        elif new:
            step = place - best[0][1]
            if float(step @ best[0][2].curvature @ step) < near**2:
                converged = True
                raise _FoundError
        return found

    def judged(place: Array) -> None:
        nonlocal converged
        here = at(place)
        step = np.linalg.solve(here.curvature, here.gradient)
        if float(here.gradient @ step) < near**2:
            converged = True
            raise _FoundError

    try:
        judged(start)
        scipy.optimize.minimize(
            lambda x: at(x).cost if np.isfinite(at(x).cost) else 1e300,
            start,
            jac=lambda x: at(x).gradient,
            hess=lambda x: at(x).curvature,
            method="trust-exact",
            callback=judged,
            options={
                "initial_trust_radius": 1.0,
                "max_trust_radius": 3.0,
                "gtol": 0.0,
                "maxiter": 200,
            },
        )
    except _FoundError:
        pass
    _, place, evaluation = best[0]
    return Optimum(place, evaluation, converged)


def search_all(
    objective: Objective, search: Search, *, restarts: int, seed: int, near: float
) -> tuple[Optimum, list[float]]:
    """Search from the start and from random places, first in an excerpt, then in everything.

    Returns the best, and by how much ends of the search in the excerpt are worse than the best.
    """
    p, rng = len(objective.coordinates), np.random.default_rng(seed)
    short = objective.samples > 2 * EXCERPT
    excerpt = objective
    if short:
        share = EXCERPT / objective.samples
        excerpt = objective.cut(lambda n: slice(0, max(int(n * share), min(n, 200))))
    first = descend(excerpt, np.zeros(p), search, near=ROUGHLY)
    ends: list[Optimum] = [first]
    size = np.minimum([c.unknown.spread for c in objective.coordinates], FAR)
    for _ in range(restarts):
        if search.exhausted:
            break
        start = first.place + size * rng.choice([-1.0, 1.0], p)
        ends.append(descend(excerpt, start, search, near=ROUGHLY, most=AGAIN))
    ends.sort(key=lambda end: end.evaluation.cost)
    found = [end.evaluation.cost for end in ends if end.converged]
    worse = [cost - min(found) for cost in found]
    return descend(objective, ends[0].place, search, near=near), worse


def spread_of(found: Evaluation) -> tuple[Array, Array]:
    """Covariance of the error, and the share of it that the data have not reduced, per coordinate.

    The inverse of the curvature holds if the innovations are white and Gaussian; the sandwich with
    the scores of parts of the recording also if not (White, 1982, doi:10.2307/1912526). The larger
    of the two is taken.
    """
    inverse = np.linalg.inv(found.curvature)
    inverse = (inverse + inverse.T) / 2
    scores = found.data.scores
    p = len(inverse)
    if len(scores) < 4 * p:
        return inverse, np.ones(p)
    centred = scores - scores.mean(axis=0)
    J = centred.T @ centred * len(scores) / (len(scores) - 1)
    sandwich = inverse @ (J + found.curvature - found.data.curvature) @ inverse
    ratio = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), 1.0))
    return inverse * np.outer(ratio, ratio), ratio
