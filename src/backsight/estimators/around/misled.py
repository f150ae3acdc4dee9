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
from typing import Protocol

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech
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
    watch = _Watch(still, prior.mean(model)[still], variances[still], estimator.horizon + SOON)
    return watch.over(plain)


def _constants(model: Model, noise: Noise) -> list[int]:
    """Places of states that nothing moves, neither equations nor noise."""
    walks = np.diag(noise.process(model) + noise.density(model)) > 0
    return sorted(set(range(model.nx)) - set(moving_states(model)) - set(np.flatnonzero(walks)))


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
    """

    still: list[int]
    mean: Array
    variance: Array
    soon: int

    def over(self, plain: Recursion) -> Recursion:
        """With constants and their variances before the last such reading behind the memory.

        Then the samples for which it is still felt, and those that are watched more closely, and
        the flag.
        """
        sizes, n = (len(plain.carry0), *plain.input_sizes), len(self.still)
        data = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes[1:])]
        carry = ca.MX.sym("carry", sizes[0] + 2 * n + 3)
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
        now = ca.vertcat(named["x_hat"][self.still], named["P"][diagonal])
        kept_next, flag = self._judge(data[1].numel())(e, S, data[2], kept, now)
        named["status"] = named["status"] + int(Status.MISLED) * flag
        innovation = plain.innovation
        if innovation is not None:
            again = innovation.call([inside, *data], True, False)
            innovation = ca.Function("innovation", [carry, *data], again)
        moved = ca.vertcat(after, kept_next)
        return dataclasses.replace(
            plain,
            step=ca.Function(plain.name, [carry, *data], ca.cse([moved, *named.values()])),
            carry0=np.concatenate([plain.carry0, self.mean, self.variance, [0.0, 0.0, 0.0]]),
            fresh=np.concatenate([plain.carry0, self.mean, self.variance, [0.0, SOON, 0.0]]),
            innovation=innovation,
            start=None,
        )

    def _judge(self, ny: int) -> ca.Function:
        """``(e, S, mask, kept, now) -> (kept, told)``.

        What is not a number is neither far nor moved; another bit tells of it.
        """
        n = len(self.still)
        e, mask = ca.SX.sym("e", ny), ca.SX.sym("mask", ny)
        triangle = ca.SX.sym("S", ny * (ny + 1) // 2)
        kept, now = ca.SX.sym("kept", 2 * n + 3), ca.SX.sym("now", 2 * n)
        x, variance, *numbers = ca.vertsplit(kept, [0, n, *range(2 * n, 2 * n + 4)])
        felt, wary, told = numbers
        x_now, variance_now = ca.vertsplit(now, [0, n, 2 * n])
        # Squares that overflow are larger than any variance, too.
        variances, squares = ca.diag(unvech(triangle)), e**2
        seen = ca.logic_and(mask > 0, variances > 0)
        far, absurd = (
            ca.mmax(ca.logic_and(seen, squares > size**2 * variances))
            for size in (ca.if_else(wary > 0, WARY, FAR), ABSURD)
        )
        wary_next = ca.fmax(wary - 1, 0)
        felt_now = ca.if_else(far, self.soon, ca.fmax(felt - 1, 0))
        if not n:
            flag = ca.logic_or(absurd, ca.logic_and(told, far))
            return ca.Function("misled", [e, triangle, mask, kept, now],
                               [ca.vertcat(felt_now, wary_next, flag), flag])  # fmt: skip
        moved = ca.logic_and(variance > 0, (x_now - x) ** 2 > MOVED**2 * variance)
        learned = variance_now < LEARNED * variance
        worse = ca.logic_and(felt_now > 0, ca.mmax(ca.logic_or(moved, learned)))
        flag = ca.fmax(told, ca.logic_or(absurd, worse))
        before = ca.if_else(felt_now > 0, kept[: 2 * n], now)
        return ca.Function("misled", [e, triangle, mask, kept, now],
                           [ca.vertcat(before, felt_now, wary_next, flag), flag])  # fmt: skip
