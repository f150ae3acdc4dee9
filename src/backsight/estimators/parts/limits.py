"""Limits on the states, the process noise and the residuals of a window."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np
import scipy

from backsight.description import Description, Sound, Unlimited
from backsight.engine.loops import scan
from backsight.errors import ModelError, TuningError
from backsight.estimators.parts.linear import Linear
from backsight.models.model import Model
from backsight.models.signals import vector
from backsight.types import Array

Summed: TypeAlias = Literal["state", "residual", "noise"]


@dataclasses.dataclass(frozen=True)
class Limit(Description):
    """Bounds on a weighted sum that hold at every sample of the window.

    Parameters
    ----------
    name : str
        For messages.
    weights : dict
        Name of a state (of an output, for residuals) to its weight, in physical units.
    lower, upper : float
        Bounds; infinite ones do not count.
    of : {"state", "residual", "noise"}
        What is summed: states x, residuals v = y - C x - D u of the measured outputs, or the
        process noise w = x_next - A x - B u of the states.
    """

    name: str
    weights: Mapping[str, float]
    lower: Unlimited = -np.inf
    upper: Unlimited = np.inf
    of: Summed = "state"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("name", "lower", "upper") and not self.lower <= self.upper:
            yield f"limit '{self.name}' is contradictory: {self.lower:g} to {self.upper:g}"
        if sound("name", "weights") and not any(self.weights.values()):
            yield f"limit '{self.name}' has no weight that is not zero"


def names_used_twice(limits: Sequence[Limit]) -> Iterator[str]:
    """Say which names are used by two limits."""
    names = [limit.name for limit in limits]
    for name in dict.fromkeys(n for n in names if names.count(n) > 1):
        yield f"limits need different names, but '{name}' is used twice"


@dataclasses.dataclass(frozen=True)
class Rows:
    """All limits of one sample, on scaled variables.

    Parameters
    ----------
    state : (n, nx) array
        Weights of the state; zero for limits on the noise.
    noise : (n, nx) array
        Weights of the process noise that led to the sample.
    residual : (n, ny) array
        Weights of y - D u, for limits on residuals; their `state` is minus that times C.
    lower, upper : (n,) arrays
    names : tuple of str
    """

    state: Array
    noise: Array
    residual: Array
    lower: Array
    upper: Array
    names: tuple[str, ...]


def rows_of(system: Linear, model: Model, limits: Sequence[Limit]) -> Rows:
    """Limits in scaled variables: the bounds of the states in the model, then those given.

    Raises
    ------
    TuningError
        If a limit names an unknown state or output.
    """
    s, nx, ny = system.s, model.nx, model.ny
    boxes = [
        Limit(x.name, {x.name: 1.0}, x.lower, x.upper)
        for x in model.states
        if np.isfinite(x.lower) or np.isfinite(x.upper)
    ]
    state, noise, residual = np.zeros((0, nx)), np.zeros((0, nx)), np.zeros((0, ny))
    every = (*boxes, *limits)
    for limit in every:
        of = model.outputs if limit.of == "residual" else model.states
        try:
            w = vector(limit.weights, of, what=f"limit '{limit.name}'", default=np.zeros(len(of)))
        except ModelError as error:
            raise TuningError(str(error)) from None
        scaled = w * (s.sy if limit.of == "residual" else s.sx)
        on_state, on_noise, on_residual = np.zeros(nx), np.zeros(nx), np.zeros(ny)
        match limit.of:
            case "state":
                on_state = scaled
            case "noise":
                on_noise = scaled
            case _:
                on_state, on_residual = -scaled @ system.C, scaled
        state, noise = np.vstack([state, on_state]), np.vstack([noise, on_noise])
        residual = np.vstack([residual, on_residual])
    return Rows(
        state=state,
        noise=noise,
        residual=residual,
        lower=np.array([limit.lower for limit in every]),
        upper=np.array([limit.upper for limit in every]),
        names=tuple(limit.name for limit in every),
    )


def stacked_rows(rows: Rows, N: int) -> Array:
    """State part of the rows of N + 1 samples, ((N + 1) n, (N + 1) nx)."""
    return np.asarray(scipy.linalg.block_diag(*[rows.state] * (N + 1)))


def bounds(system: Linear, rows: Rows, N: int) -> ca.Function:
    """``(U, Y, M, present) -> (lower, upper)`` of the rows of all samples.

    Rows that need something that was not measured, or that lies before the data, have none.
    """
    ny, nu = system.D.shape
    u, y, mask = ca.SX.sym("u", nu), ca.SX.sym("y", ny), ca.SX.sym("m", ny)
    count, before, here = ca.SX.sym("k"), ca.SX.sym("before"), ca.SX.sym("here")
    known = ca.mtimes(ca.DM(rows.residual), y - ca.mtimes(ca.DM(system.D), u))
    low, high = ca.SX(ca.DM(rows.lower)) - known, ca.SX(ca.DM(rows.upper)) - known
    for i in range(len(rows.names)):
        needed = [mask[int(j)] for j in np.flatnonzero(rows.residual[i])]
        exists = before if rows.noise[i].any() else here
        counts = ca.mmin(ca.vertcat(exists, *needed)) > 0
        low[i] = ca.if_else(counts, low[i], -np.inf)
        high[i] = ca.if_else(counts, high[i], np.inf)
    leaf = ca.Function("bounds", [count, u, y, mask, before, here], [count + 1, low, high])
    U, Y, M = (ca.MX.sym(n, k, N + 1) for n, k in (("U", nu), ("Y", ny), ("M", ny)))
    present = ca.MX.sym("present", 1, N + 1)
    earlier = ca.horzcat(0, present[:, :-1])
    _, limits = scan(leaf, N + 1, carry=[ca.MX(0)], xs=[U, Y, M, earlier, present])
    return ca.Function("window_bounds", [U, Y, M, present], [ca.vec(v) for v in limits])
