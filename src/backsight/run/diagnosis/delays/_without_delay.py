"""Whether a recording that asks for a delay is explained by other parameters as well."""

import dataclasses
from collections.abc import Callable

import numpy as np

from backsight.engine.recursion import Recursion
from backsight.errors import BacksightError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.diagnosis._free_forces import constants_and_forces
from backsight.run.diagnosis.parameters.sense import FAR, dividing
from backsight.types import Array

ROUNDS = 8
"""Pairs of runs, without the shift and with it, that begin with the constants of the one before."""

AS_WELL = 0.02
"""Log-likelihood per measured value that a delay must gain over the best parameters without it."""

NARROWER = 0.6
"""Deviations of constants by those of the round before: a wide prior leads astray again."""

LEAST = 1e-3
"""Least value of a positive constant, by where it starts."""

Scored = Callable[[Recursion, int], tuple[float, Array] | None]
"""Mean log-likelihood and last estimate with outputs moved by a shift; None if it diverged."""


def explained_without(
    judge: AbstractEstimator, model: Model, recursion: Recursion, shift: int, scored: Scored
) -> bool:
    """Whether constants that begin elsewhere explain it without the shift, or have no meaning.

    A filter that begins with wrong parameters follows a motion late, and then a delay helps it. So
    either hypothesis may begin again where the other one ended, as far as the prior reaches.
    """
    try:
        noise, prior = judge.assumed
        start, P0 = prior.mean(model), prior.covariance(model)
        constants, _ = constants_and_forces(model, noise)
    except BacksightError:
        return False
    places = sorted(constants)
    if not places or recursion.start is None:
        return False
    std = np.sqrt(np.diag(P0))
    least = [LEAST * x if s.positive else s.lower for s, x in zip(model.states, start, strict=True)]
    low = np.maximum(least, start - FAR * std)
    high = np.minimum([s.upper for s in model.states], start + FAR * std)
    across = [i for i in dividing(model, start, std) if i in constants]
    begun, reached = start.copy(), {0: -np.inf, shift: -np.inf}
    for k in range(ROUNDS):
        narrow = np.ones(model.nx)
        narrow[places] = NARROWER**k
        for by in (0, shift):
            carry = recursion.start(begun, P0 * np.outer(narrow, narrow))
            found = scored(dataclasses.replace(recursion, carry0=carry), by)
            if found is None:
                return False
            reached[by] = max(reached[by], found[0])
            begun[places] = np.clip(found[1], low, high)[places]
            if by == 0 and any(begun[i] * start[i] < 0 for i in across):
                return True
    return bool(reached[0] >= reached[shift] - AS_WELL)
