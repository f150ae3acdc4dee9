"""Limits on the states, the process noise and the residuals of a window."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.description import Description, Sound, Unlimited
from backsight.errors import ModelError, TuningError, nearest
from backsight.estimators._sizes import LARGEST, SMALLEST
from backsight.estimators.base import Setting
from backsight.models.canonical.affine import moving_states
from backsight.models.signals import vector
from backsight.types import Array

Summed: TypeAlias = Literal["state", "residual", "noise"]

TOLERANCE = 1e-10
"""Violations below this count as rounding errors, in units of the limited quantity."""


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

    Examples
    --------
    >>> bs.settings.Limit("stop", {"q": 1.0}, lower=-0.01, upper=0.01).upper
    0.01
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
class Limits:
    """All limits of a sample, on scaled variables; every one is of one of three kinds.

    Parameters
    ----------
    state, noise : (n, nx) arrays
        Weights of the state, and of the process noise that led to the sample.
    residual : (n, ny) array
        Weights of y - h(x, u).
    once : (n,) array
        1 for limits of a value that is constant in the window: they hold at its last sample.
    lower, upper : (n,) arrays
    softness : (n,) array
        Variance of the limit, 0 for hard ones.
    slack : (n,) array
        Size of a rounding error.
    unit : (n,) array
        Physical size of 1.
    names : tuple of str
    exact : dict
        Row of a sensor without noise, whose residual is zero, to its output.
    """

    state: Array
    noise: Array
    residual: Array
    once: Array
    lower: Array
    upper: Array
    softness: Array
    slack: Array
    unit: Array
    names: tuple[str, ...]
    exact: Mapping[int, int]


def limits_of(s: Setting, Q: Array, limits: Sequence[Limit], soft: Mapping[str, float]) -> Limits:
    """Bounds of the states in the model, then the limits given, then sensors without noise.

    In scaled variables.

    Parameters
    ----------
    s : Setting
    Q : (nx, nx) array
        Covariance of the process noise inside the window.
    limits : sequence of Limit
    soft : dict
        Name of a limit or of a bounded state to the weight of its violation, physical units.

    Raises
    ------
    TuningError
        If a name is unknown, or noise is limited that inputs multiply.
    """
    model = s.model
    boxes = [
        Limit(x.name, {x.name: 1.0}, x.lower * scale, x.upper * scale)
        for x, scale in zip(model.states, s.sx, strict=True)
        if np.isfinite(x.lower) or np.isfinite(x.upper)
    ]
    every = (*boxes, *limits)
    names = tuple(limit.name for limit in every)
    _check(names, soft)
    if s.parts and any(limit.of == "noise" for limit in limits):
        raise TuningError("noise that inputs multiply does not go with limits of the noise")
    rows = [_row(s, Q, limit, float(soft.get(limit.name, np.inf))) for limit in every]
    of_sensors = {len(every) + k: j for k, j in enumerate(exact_outputs(s.R))}
    rows += [_exact_row(s, j) for j in of_sensors.values()]
    names += tuple(f"{model.outputs[j].name} (without noise)" for j in of_sensors.values())
    constant = ~np.isin(np.arange(model.nx), moving_states(model)) & ~Q.any(axis=0)
    state = _stack([r.state for r in rows], model.nx)
    return Limits(
        state=state,
        noise=_stack([r.noise for r in rows], model.nx),
        residual=_stack([r.residual for r in rows], model.ny),
        once=np.array([bool(r.any()) and not r[~constant].any() for r in state], float),
        lower=np.array([r.lower for r in rows]),
        upper=np.array([r.upper for r in rows]),
        softness=np.array([r.softness for r in rows]),
        slack=np.array([r.slack for r in rows]),
        unit=np.array([r.unit for r in rows]),
        names=names,
        exact=of_sensors,
    )


def exact_outputs(R: Array) -> tuple[int, ...]:
    """Outputs that have no noise of their own, beside that of the outputs before them."""
    if not np.count_nonzero(R - np.diag(np.diag(R))):
        return tuple(np.flatnonzero(np.diag(R) == 0).tolist())
    factor = ca.Function("factor", [], [ca.densify(cholesky_semidefinite(ca.SX(ca.DM(R))))])
    pivots = np.diag(np.array(factor.call([])[0]))
    return tuple(np.flatnonzero(pivots == 0).tolist())


def hard_bounds(s: Setting, soft: Mapping[str, float]) -> Setting:
    """Return the setting without the bounds of states that may be violated at a cost."""
    states = [
        dataclasses.replace(x, lower=-np.inf, upper=np.inf) if x.name in soft else x
        for x in s.model.states
    ]
    return dataclasses.replace(s, model=dataclasses.replace(s.model, states=tuple(states)))


def _check(names: tuple[str, ...], soft: Mapping[str, float]) -> None:
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise TuningError(f"limits need different names, but '{twice[0]}' is used twice")
    for name in soft:
        if name not in names:
            raise TuningError(f"soft: there is no limit '{name}': {nearest(name, names)}")


@dataclasses.dataclass(frozen=True)
class _Row:
    state: Array
    noise: Array
    residual: Array
    lower: float
    upper: float
    softness: float
    slack: float
    unit: float


def _row(s: Setting, Q: Array, limit: Limit, weight: float) -> _Row:
    """One limit in units of its own size, so that rounding errors are about 1e-16."""
    model, residual = s.model, limit.of == "residual"
    of = model.outputs if residual else model.states
    try:
        w = vector(limit.weights, of, what=f"limit '{limit.name}'", default=np.zeros(len(of)))
    except ModelError as error:
        raise TuningError(str(error)) from None
    w = w * (s.sy if residual else s.sx)
    if not w.any():
        raise TuningError(f"limit '{limit.name}' has no weight that is not zero")
    spread = float(np.sqrt(w @ Q @ w)) if limit.of == "noise" else 0.0
    unit = spread or float(np.abs(w).max())
    if not SMALLEST < unit < LARGEST:
        raise TuningError(
            f"limit '{limit.name}' has weights that make it {unit:g} in size, whose square is no "
            "number; choose other weights"
        )
    lower, upper = limit.lower / unit, limit.upper / unit
    nothing = np.zeros(model.nx)
    finite = [abs(v) for v in (lower, upper) if np.isfinite(v)]
    return _Row(
        state=w / unit if limit.of == "state" else nothing,
        noise=w / unit if limit.of == "noise" else nothing,
        residual=w / unit if residual else np.zeros(model.ny),
        lower=lower,
        upper=upper,
        softness=1 / (weight * unit**2),
        slack=TOLERANCE * max([1.0, *finite]),
        unit=unit,
    )


def _exact_row(s: Setting, output: int) -> _Row:
    """The residual of a sensor without noise, in units of what the states are to it."""
    x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
    slope = ca.densify(ca.jacobian(s.model.output(x, u)[output], x))
    at_start = ca.Function("slope", [x, u], [slope])(s.x0, np.zeros(s.model.nu))
    size = float(np.abs(np.array(at_start)).sum())
    unit = size if SMALLEST < size < LARGEST else 1.0
    residual = np.zeros(s.model.ny)
    residual[output] = 1 / unit
    nothing = np.zeros(s.model.nx)
    return _Row(
        state=nothing,
        noise=nothing,
        residual=residual,
        lower=0.0,
        upper=0.0,
        softness=0.0,
        slack=TOLERANCE,
        unit=unit * float(s.sy[output]),
    )


def _stack(rows: Sequence[Array], width: int) -> Array:
    return np.vstack([np.zeros((0, width)), *rows])
