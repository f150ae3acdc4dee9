"""What was learned from a reading that cannot be.

Without a rule for outliers every reading is believed. One that is a thousand deviations off, a bit
that flips, a connector that opens, moves a parameter that has no process noise by hundreds of its
own deviations, and nothing that is measured later brings it back: what was learned counts as
certain. Such a sample is told by what a right filter does with no probability: its innovation is
beyond all deviations, and there or soon after, while the states still feel it, a constant leaves
its own band or learns. From there on the status says *misled*; whoever starts anew
(`Recursion.restarting`) does so there.

States that noise moves forget such a reading, unless it was so large that they would take longer
than the recording: beyond `ABSURD` the same is said until innovations are near again.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Protocol

import casadi as ca
import numpy as np

from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.around.robust import innovation_alone
from backsight.estimators.outliers import AbstractOutlierRule
from backsight.estimators.uncertainty import Noise, Prior
from backsight.estimators.varied_noise import VariedNoise
from backsight.models.canonical.affine import moving_states
from backsight.models.model import Model
from backsight.schema import Status
from backsight.types import Array

FAR = 100.0
"""Deviations of an innovation that no noise has, and hardly a model that is wrong."""

WARY = 20.0
"""The same for `SOON` samples after a new start: what made it necessary may go on."""

MOVED = 3.0
"""Deviations of its own by which a constant moves with no probability."""

LEARNED = 0.5
"""Share of the variance of a constant that is left when it has learned."""

SOON = 20
"""Samples after such a reading, and after it has left the window, in which states feel it."""

ABSURD = 1e12
"""Deviations of an innovation of which an estimate keeps no digits."""


MOST_STATES = 100
"""Equations of more states take seconds to look through."""


class Believing(Protocol):
    """What is asked of an estimator."""

    @property
    def outliers(self) -> AbstractOutlierRule | None:
        """Rule for outliers."""
        ...

    @property
    def forgets(self) -> bool:
        """Whether no sample counts for ever."""
        ...

    @property
    def horizon(self) -> int:
        """Sampling periods of its window."""
        ...

    @property
    def assumed(self) -> tuple[Noise, Prior]:
        """Noise and prior."""
        ...


def watched(plain: Recursion, estimator: Believing, model: Model) -> Recursion:
    """The compiled recursion of an estimator, whose status says when it was misled.

    The same if it has a rule for outliers.
    """
    if estimator.outliers is not None:
        return plain
    try:
        noise, prior = estimator.assumed
    except TuningError:
        return plain
    forgets = estimator.forgets or isinstance(noise, VariedNoise)
    still = [] if forgets else _constants(model, noise)
    variances = np.diag(prior.covariance(model))
    noisy = _noisy(model, noise)
    soon = estimator.horizon + SOON
    return _Watch(still, prior.mean(model)[still], variances[still], soon, noisy).over(plain)


def _constants(model: Model, noise: Noise) -> list[int]:
    """Places of states that nothing moves, neither equations nor noise; none of many states."""
    if model.nx > MOST_STATES:
        return []
    walks = np.diag(noise.process(model) + noise.density(model)) > 0
    return sorted(set(range(model.nx)) - set(moving_states(model)) - set(np.flatnonzero(walks)))


def _noisy(model: Model, noise: Noise) -> list[bool]:
    """Outputs whose sensors have noise, whatever the inputs are."""
    if isinstance(noise, VariedNoise):
        return [False] * model.ny
    return (np.diag(noise.measurement(model, singular=True)) > 0).tolist()


@dataclasses.dataclass(frozen=True)
class _Watch:
    """What is watched.

    Parameters
    ----------
    still : list of int
        Places of constants.
    mean, variance : arrays
        Of their prior.
    soon : int
        Samples in which a reading is felt.
    noisy : list of bool
        Outputs whose sensors have noise: the variance of their innovation is never 0.
    """

    still: list[int]
    mean: Array
    variance: Array
    soon: int
    noisy: list[bool]

    def over(self, plain: Recursion) -> Recursion:
        """With the flag behind the memory, and what it takes.

        If there are constants: they and their variances before the last such reading, the samples
        for which it is still felt, and those that are watched more closely (below 0: none).
        """
        sizes = (len(plain.carry0), *plain.input_sizes)
        data = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes[1:])]
        begun, again = self._memory(0.0), self._memory(SOON)
        carry = ca.MX.sym("carry", sizes[0] + len(begun))
        inside, kept = ca.vertsplit(carry, [0, sizes[0], carry.numel()])
        after, *values = plain.step.call([inside, *data], True, False)
        named = dict(zip([c.name for c in plain.channels], values, strict=True))
        # The newest innovation, also where the results are about an earlier sample.
        e, S = named["e"], named["S"]
        if plain.lag:
            newest = plain.innovation or innovation_alone(plain)
            e, S = newest.call([inside, *data], True, False)
        channel = next(c for c in plain.channels if c.name == "P")
        diagonal = np.diag(channel.entries(named["P"].numel()))[self.still].tolist()
        x, P = (named["x_hat"], named["P"]) if self.still else (ca.MX(0, 1), ca.MX(0, 1))
        judge = self._judge(x.numel(), P.numel(), diagonal)
        kept_next, named["status"] = judge(e, S, kept, x, P, named["status"])
        innovation = plain.innovation
        if innovation is not None:
            before = innovation.call([inside, *data], True, False)
            innovation = ca.Function("innovation", [carry, *data], before)
        results = [ca.vertcat(after, kept_next), *named.values()]
        # What an innovation of its own has in common with the step; it takes long to look for.
        results = ca.cse(results) if plain.lag else results
        return dataclasses.replace(
            plain,
            step=ca.Function(plain.name, [carry, *data], results),
            carry0=np.concatenate([plain.carry0, begun]),
            fresh=np.concatenate([plain.carry0, again]),
            innovation=innovation,
            start=None,
        )

    def _memory(self, wary: float) -> Array:
        if not self.still:
            return np.zeros(1)
        return np.concatenate([self.mean, self.variance, [0.0, wary, 0.0]])

    def _judge(self, nx: int, entries: int, diagonal: list[int]) -> ca.Function:
        """``(e, S, kept, x, P, status) -> (kept, status)``.

        What is not a number is neither far nor moved; another bit tells of it. It runs at every
        sample on a controller, so there are few comparisons, and no maximum, which is a call there.
        """
        n, ny = len(self.still), len(self.noisy)
        e, triangle = ca.SX.sym("e", ny), ca.SX.sym("S", ny * (ny + 1) // 2)
        kept, status = ca.SX.sym("kept", self._kept), ca.SX.sym("status")
        x, P = ca.SX.sym("x", nx), ca.SX.sym("P", entries)
        given = [e, triangle, kept, x, P, status]
        # Squares that overflow are larger than any variance, too. Where nothing was measured, they
        # are 0; without noise a variance of 0 is no measure.
        variances, squares = triangle[np.cumsum([0, *range(ny, 1, -1)]).tolist()], e**2

        def beyond(size: ca.SX | float) -> ca.SX:
            pairs = zip(*map(ca.vertsplit, (squares, size**2 * variances)), strict=True)
            far = [square > most for square, most in pairs]
            guards = zip(far, ca.vertsplit(variances), self.noisy, strict=True)
            return _any([f if noisy else ca.logic_and(v > 0, f) for f, v, noisy in guards])

        def told(kept_next: ca.SX, flag: ca.SX) -> ca.Function:
            raised = status + int(Status.MISLED) * flag
            return ca.Function("misled", given, [kept_next, raised])

        if not n:
            flag = beyond(ca.if_else(kept, FAR, ABSURD))
            return told(flag, flag)
        mean, spread, *numbers = ca.vertsplit(kept, [0, n, *range(2 * n, 2 * n + 4)])
        felt, wary, before = numbers
        now, spread_now = x[self.still], P[diagonal]
        felt_now = ca.if_else(beyond(ca.if_else(wary > 0, WARY, FAR)), self.soon, felt - 1)
        moved = ca.logic_and(spread > 0, (now - mean) ** 2 > MOVED**2 * spread)
        learned = spread_now < LEARNED * spread
        worse = ca.logic_and(felt_now > 0, _any(ca.vertsplit(ca.logic_or(moved, learned))))
        flag = ca.logic_or(before, ca.logic_or(beyond(ABSURD), worse))
        here = ca.if_else(felt_now > 0, kept[: 2 * n], ca.vertcat(now, spread_now))
        return told(ca.vertcat(here, felt_now, wary - 1, flag), flag)

    @property
    def _kept(self) -> int:
        return len(self._memory(0.0))


def _any(told: Sequence[ca.SX]) -> ca.SX:
    """Whether one of them holds."""
    return functools.reduce(ca.logic_or, told)
