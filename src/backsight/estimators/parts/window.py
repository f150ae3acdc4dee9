"""The window of the last samples in the memory of an estimator."""

from collections.abc import Iterator, Sequence
from typing import Literal

import casadi as ca
import numpy as np

from backsight.engine.loops import all_finite, iterate
from backsight.estimators.scaled import Setting
from backsight.types import Array


def no_window(s: Setting, samples: int) -> dict[str, Array]:
    """Inputs, outputs and masks of a window before the first sample; nothing is measured."""
    sizes = {"U": s.model.nu, "Y": s.model.ny, "M": s.model.ny}
    return {name: np.zeros((size, samples)) for name, size in sizes.items()}


def moved_on(window: Sequence[ca.MX], sample: Sequence[ca.MX | int]) -> Iterator[ca.MX]:
    """The window one sample later: the oldest column leaves, the new one enters."""
    return (ca.horzcat(w[:, 1:], new) for w, new in zip(window, sample, strict=True))


def lag_faults(lag: int | Literal["N"], N: int) -> Iterator[str]:
    """Say if a lag looks back further than a window of `N` sampling periods."""
    if lag != "N" and lag > N:
        yield f"the lag is {lag}; it must be a whole number from 0 to N = {N}, or 'N'"


def queued(late: ca.MX, new: Sequence[ca.MX], lag: int) -> tuple[list[ca.MX], ca.MX]:
    """The values of `lag` samples ago, and those that still wait.

    Parameters
    ----------
    late : MX
        What waits, flat; empty if there is no lag.
    new : sequence of MX
        Columns of the newest sample.
    lag : int
    """
    if not lag:
        return list(new), late
    queue = ca.horzcat(ca.reshape(late, -1, lag), ca.vertcat(*new))
    ends = np.cumsum([0, *(v.numel() for v in new)])
    return ca.vertsplit(queue[:, 0], [int(k) for k in ends]), ca.vec(queue[:, 1:])


def empty_queue(s: Setting, lag: int) -> Array:
    """Innovations and covariances that wait before the first sample."""
    ny = s.model.ny
    return np.zeros(lag * (ny + ny * (ny + 1) // 2))


def unless_broken(critical: list[ca.MX], carry: ca.MX, carry0: Array) -> ca.MX:
    """The memory, or the one from before the first sample if a critical part is not finite."""
    finite = [ca.SX.sym(f"finite{k}") for k in range(len(critical))]
    broken = ca.Function("broken", finite, [1 - ca.mmin(ca.vertcat(*finite))])(
        *map(all_finite, critical)
    )
    symbols = [ca.MX.sym("go"), ca.MX.sym("carry", len(carry0)), ca.MX.sym("fresh", len(carry0))]
    body = ca.Function("start_anew", symbols, [ca.MX(0), symbols[2]])
    return iterate(body, 1, carry=[broken, carry], constants=[ca.MX(carry0)])[1]
