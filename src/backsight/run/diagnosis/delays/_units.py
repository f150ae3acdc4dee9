"""Sizes and signs of outputs beside the model's response, while parameters are not yet known."""

import dataclasses

import numpy as np

from backsight.analysis.alignment import Ratio, ratio
from backsight.engine.execute import prepare, run_recursion
from backsight.engine.recursion import Recursion
from backsight.errors import BacksightError
from backsight.estimators import Prior
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.diagnosis._free_forces import constants_and_forces
from backsight.types import Array

EXPECTED = 3.0
"""Standard deviations of the prior within which an estimate explains an odd size or sign."""

FITTED = 1.5
"""Ratio of sizes, or its inverse, that estimated parameters leave if the units are right."""


def response_ratios(
    recursion: Recursion, u: Array, y: Array, mask: Array, *, engine: str, names: list[str]
) -> tuple[Ratio, ...]:
    """Compare every output (n, ny) with the model's own response to the input, from the prior."""
    # A filter that measures nothing simulates.
    (response,) = outputs_of_run(
        recursion, [u, np.zeros_like(y), np.zeros_like(mask)], engine, ("y_hat",)
    )
    measured = np.where(mask > 0, y, np.nan)
    return tuple(ratio(n, measured[:, i], response[:, i]) for i, n in enumerate(names))


def reconsidered(
    ratios: tuple[Ratio, ...],
    judge: AbstractEstimator,
    model: Model,
    *,
    dt: float,
    data: tuple[Array, Array, Array],
    engine: str,
) -> tuple[Ratio, ...]:
    """Compare once more, with the parameters as they come out at the end of the recording.

    A resonance at another place makes a response many times larger or smaller. Where the final
    estimate explains an odd size and lies where the prior expects it, there is no reason to suspect
    a unit; a wrong unit takes some parameter further away than that, or remains.

    Parameters
    ----------
    ratios : tuple of Ratio
        With the parameters of the prior.
    judge : AbstractEstimator
        Kalman filter.
    model, dt, engine
    data : tuple
        Inputs, outputs and mask.
    """
    u, y, mask = data
    noise, prior = judge.assumed
    constants, walks = constants_and_forces(model, noise)
    places = sorted({*constants, *walks})
    if not places:
        return ratios
    try:
        recursion = judge.compile(model, dt)
        (x,) = outputs_of_run(recursion, list(data), engine, ("x_hat",))
        start, P0 = prior.mean(model), prior.covariance(model)
        off = np.abs(x[-1] - start)[places]
        if not (off <= EXPECTED * np.sqrt(np.diag(P0))[places]).all():
            return ratios
        start[places] = x[-1][places]
        known = dataclasses.replace(judge, prior=Prior(P0=P0, x0=start)).compile(model, dt)
        prepare(known, engine)
        names = [r.output for r in ratios]
        again = response_ratios(known, u, y, mask, engine=engine, names=names)
    except BacksightError:
        return ratios
    return tuple(
        new if new.known and new.factor == 1.0 and 1 / FITTED < new.size < FITTED else old
        for old, new in zip(ratios, again, strict=True)
    )


def outputs_of_run(
    recursion: Recursion, data: list[Array], engine: str, wanted: tuple[str, ...]
) -> list[Array]:
    """Run a recursion over inputs, outputs and mask; the named outputs."""
    outputs = run_recursion(recursion, data, engine=engine)
    named = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    return [named[name] for name in wanted]
