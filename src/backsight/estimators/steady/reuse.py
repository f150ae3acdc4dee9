"""What follows from a covariance and the mask alone is computed only until it no longer changes."""

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from backsight.engine.dense import near_to
from backsight.engine.loops import iterate
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.memory import Memory
from backsight.estimators.steady.state import SteadyState
from backsight.types import Array

COVARIANCE = "P"
"""The part of the memory that is the covariance of the prediction; it goes on in every filter."""


def kept_parts(step: ca.Function, limit: SteadyState, P0: Array) -> dict[str, ArrayLike]:
    """Parts of a `Memory` for `reused`, with their start values."""
    made = {step.name_out(k): np.zeros(step.size_out(k)) for k in range(1, step.n_out())}
    return {
        COVARIANCE: Covariance(len(P0)).kept(P0),
        **made,
        "limit": Covariance(len(P0)).kept(limit.P),
        "waiting": float(limit.wait + 1),
    }


def reused(
    step: ca.Function, limit: SteadyState, memory: Memory, mask: ca.MX, *others: ca.MX
) -> dict[str, ca.MX]:
    """Parts of the memory after a sample, of which all but the covariance hold for this sample.

    While all channels are measured with their nominal noise and the covariance has come to its
    limit, see `backsight.estimators.steady.state`, they are those of the last sample, and nothing
    is computed. At any other sample the step is taken, and the covariance has to come back.

    Parameters
    ----------
    step : casadi.Function
        ``(P, mask, *others) -> (P_next, *values)``, dense; the results have the names of the
        memory's parts.
    limit : SteadyState
    memory : Memory
        With `kept_parts`.
    mask : MX
        Weights (ny,) of the sample.
    *others : MX
        What else the step takes; the same in all samples but the first.
    """
    names = [COVARIANCE, *(step.name_out(k) for k in range(1, step.n_out()))]
    ny = mask.numel()
    kept = [getattr(memory, name) for name in names]
    go = ca.MX.sym("go")
    symbols = [ca.MX.sym(name, *part.shape) for name, part in zip(names, kept, strict=True)]
    waiting, m = ca.MX.sym("waiting"), ca.MX.sym("mask", ny)
    ends = ca.MX.sym("limit", memory.limit.numel())
    more = [ca.MX.sym("other", *other.shape) for other in others]
    new = step.call([symbols[0], m, *more])
    near = _near(limit)(new[0], ends)
    body = ca.Function(
        f"{step.name()}_anew",
        [go, *symbols, waiting, m, ends, *more],
        [ca.MX(0), *new, waited(ny, limit.wait)(m, near, waiting)],
    )
    start = [_goes(ny)(mask, memory.waiting), *kept, memory.waiting]
    _, *after = iterate(body, 1, carry=start, constants=[mask, memory.limit, *others])
    found = dict(zip([*names, "waiting"], after, strict=True))
    return {**found, "limit": memory.limit}


def _near(limit: SteadyState) -> ca.Function:
    """``(P, limit) -> near``: 1 if a covariance as it is kept is near the limit, else 0."""
    n, kept = len(limit.P), Covariance(len(limit.P))
    if kept.whole:
        P, end = (ca.MX.sym(name, n * n) for name in ("P", "limit"))
        near = near_to(kept.opened(P), kept.opened(end), limit.sigma, limit.near)
        return ca.Function("near", [P, end], [near])
    few, end = (ca.SX.sym(name, kept.size) for name in ("P", "limit"))
    off = (kept.opened(few) - kept.opened(end)) / np.outer(limit.sigma, limit.sigma)
    return ca.Function("near", [few, end], [ca.sumsqr(off) <= limit.near**2])


def kept_or_new(step: ca.Function, memory: Memory, name: str, *given: ca.MX, mask: ca.MX) -> ca.MX:
    """One of the values of a step that a sample with this mask has, before it enters.

    Parameters
    ----------
    step : casadi.Function
        ``(*given, mask) -> value``.
    memory : Memory
        As for `reused`.
    name : str
        Of the value in the memory.
    """
    kept = getattr(memory, name)
    symbols = [ca.MX.sym("i", *value.shape) for value in (kept, *given, mask)]
    go = ca.MX.sym("go")
    body = ca.Function(f"{step.name()}_now", [go, *symbols], [ca.MX(0), step(*symbols[1:])])
    start = [_goes(mask.numel())(mask, memory.waiting), kept]
    return iterate(body, 1, carry=start, constants=[*given, mask])[1]


def _goes(ny: int) -> ca.Function:
    """``(mask, waiting) -> go``: 0 if the gain of the sample before can be taken."""
    mask, waiting = ca.SX.sym("mask", ny), ca.SX.sym("waiting")
    go = ca.if_else(ca.logic_and(_nominal(mask), waiting <= 0), 0, 1)
    return ca.Function("covariance_goes", [mask, waiting], [go])


def waited(ny: int, wait: int) -> ca.Function:
    """``(mask, near, waiting) -> waiting``: samples until the limit holds."""
    mask, near, waiting = ca.SX.sym("mask", ny), ca.SX.sym("near"), ca.SX.sym("waiting")
    goes_on = ca.logic_and(_nominal(mask), near)
    left = ca.if_else(goes_on, ca.fmax(waiting - 1, 0), wait + 1)
    return ca.Function("covariance_waits", [mask, near, waiting], [left])


def _nominal(mask: ca.SX) -> ca.SX:
    """Whether every channel has the weight one."""
    return ca.mmax(ca.fabs(mask - 1)) <= 0
