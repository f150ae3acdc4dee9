"""Constants that have learned from a reading that cannot be.

Without a rule for outliers every reading is believed. One that is a thousand deviations off, a bit
that flips, a connector that opens, moves a parameter that has no process noise by hundreds of its
own deviations, and nothing that is measured later brings it back: what was learned counts as
certain. Such a sample is told by two things that a right filter does with no probability: its
innovation is beyond all deviations, and a constant leaves its own band in one step. From there on
the status says *misled*; whoever starts anew (`Recursion.restarting`) does so there.
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

MOVED = 3.0
"""Deviations of its own by which a constant moves in one step with no probability."""


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
    def assumed(self) -> tuple[Noise, Prior]:
        """Noise and prior."""
        ...


def watched(plain: Recursion, estimator: Believing, model: Model) -> Recursion:
    """The compiled recursion of an estimator, whose status says when its constants were misled.

    The same if it has a rule for outliers, forgets, or the model has no constants.
    """
    if estimator.outliers is not None or estimator.forgets:
        return plain
    try:
        noise, prior = estimator.assumed
    except TuningError:
        return plain
    still = _constants(model, noise)
    if not still or isinstance(noise, VariedNoise):
        return plain
    variances = np.diag(prior.covariance(model))
    return _watching(plain, still, prior.mean(model)[still], variances[still])


def _constants(model: Model, noise: Noise) -> list[int]:
    """Places of states that nothing moves, neither equations nor noise."""
    walks = np.diag(noise.process(model) + noise.density(model)) > 0
    return sorted(set(range(model.nx)) - set(moving_states(model)) - set(np.flatnonzero(walks)))


def _watching(plain: Recursion, still: list[int], mean: Array, variance: Array) -> Recursion:
    """With the constants of the last sample, their variances and the flag behind the memory."""
    sizes, n = (len(plain.carry0), *plain.input_sizes), len(still)
    data = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes[1:])]
    carry = ca.MX.sym("carry", sizes[0] + 2 * n + 1)
    inside, x, spread, told = ca.vertsplit(carry, np.cumsum([0, sizes[0], n, n, 1]).tolist())
    after, *values = plain.step.call([inside, *data], True, False)
    named = dict(zip([c.name for c in plain.channels], values, strict=True))
    # The newest innovation, also where the results are about an earlier sample.
    e, S = named["e"], named["S"]
    if plain.lag:
        newest = plain.innovation or innovation_alone(plain)
        e, S = newest.call([inside, *data], True, False)
    channel = next(c for c in plain.channels if c.name == "P")
    diagonal = np.diag(channel.entries(named["P"].numel()))[still].tolist()
    now, spread_now = named["x_hat"][still], named["P"][diagonal]
    judge = _judge(data[1].numel(), n)
    flag = judge(e, S, data[2], x, spread, now, told)
    named["status"] = named["status"] + int(Status.MISLED) * flag
    moved = ca.vertcat(after, now, spread_now, flag)
    innovation = plain.innovation
    if innovation is not None:
        again = innovation.call([inside, *data], True, False)
        innovation = ca.Function("innovation", [carry, *data], again)
    return dataclasses.replace(
        plain,
        step=ca.Function(plain.name, [carry, *data], ca.cse([moved, *named.values()])),
        carry0=np.concatenate([plain.carry0, mean, variance, [0.0]]),
        innovation=innovation,
        start=None,
    )


def _judge(ny: int, n: int) -> ca.Function:
    """``(e, S, mask, x, variance, x_next, told) -> told``."""
    e, triangle, mask = (
        ca.SX.sym(k, size) for k, size in (("e", ny), ("S", ny * (ny + 1) // 2), ("mask", ny))
    )
    x, variance, x_next = (ca.SX.sym(k, n) for k in ("x", "variance", "x_next"))
    told = ca.SX.sym("told")
    spread = ca.sqrt(ca.diag(unvech(triangle)))
    # What is not a number is neither far nor moved; another bit tells of it.
    far = ca.logic_and(mask > 0, ca.logic_and(spread > 0, ca.fabs(e) > FAR * spread))
    moved = ca.logic_and(variance > 0, ca.fabs(x_next - x) > MOVED * ca.sqrt(variance))
    flag = ca.fmax(told, ca.logic_and(ca.mmax(far), ca.mmax(moved)))
    return ca.Function("misled", [e, triangle, mask, x, variance, x_next, told], [flag])
