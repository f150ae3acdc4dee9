r"""Many settings at once: a recursion whose free values are a part of its memory.

A lane of the processor's vectors is one setting: the free values lie behind the memory of the
estimator, which nothing changes in a step, and are handed to it as inputs. Standard deviations of
sensors divide the weights of the sample (`sigma_factor`), those of the process noise are inputs
that multiply it (`VariedNoise`), parameters of the model are inputs, and the prior is the memory
before the first sample. So one program serves all passes, whatever the values.

What comes out are innovations that are independent within the sample, in the order of the outputs:
with :math:`S = L D L'` the entries of :math:`r = L^{-1} e` have the variances in :math:`D`.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from backsight.algebra.factor import ldl
from backsight.algebra.symmetric import unvech
from backsight.algebra.triangular import forward
from backsight.discrete.steps import explicit
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import ModelError, TuningError
from backsight.estimators import Compilable
from backsight.estimators.base import AbstractEstimator, Setting, setting
from backsight.estimators.uncertainty import Noise
from backsight.estimators.varied_noise import NoisePart, VariedNoise
from backsight.models.augment import with_idle_inputs
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.tune.fitting.values import Unknown, placed, sensor_factors, walk_factor, walk_parts
from backsight.types import Array

Data = tuple[Array, Array, Array, Array, Array]
"""Inputs, outputs and weights as the estimator sees them; outputs and weights that are judged."""

CHUNK = 100_000
"""Samples of which the innovations of all lanes are kept at a time."""


@dataclasses.dataclass(frozen=True)
class LaneRunner:
    """An estimator that runs with many settings at once.

    Parameters
    ----------
    recursion : Recursion
        ``(carry, u, y, mask, y_all, mask_all) -> (carry, r, d)``.
    estimator, model : AbstractEstimator, Model
        As given, and with values as inputs.
    varied : AbstractEstimator
    wide : Model
    start : callable, optional
        See `Recursion.start`.
    unknowns : tuple of Unknown
    dt : float
    """

    recursion: Recursion
    estimator: AbstractEstimator
    model: Model
    varied: Compilable
    wide: Model
    start: Callable[[Array, Array], Array] | None
    unknowns: tuple[Unknown, ...]
    dt: float

    def innovations(
        self, data: Data, settings: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[Array, Array]]:
        """Innovations and their variances (lanes, n, ny) with every setting, piece by piece."""
        from backsight.engine.lanes import run_many  # brings the compiler along

        carries = [self._start(values) for values in settings]
        # Programs of one lane and of many are two: a lone setting runs beside itself.
        many = carries if len(carries) > 1 else carries * 2
        for first in range(0, len(data[0]), CHUNK):
            rows = [a[first : first + CHUNK] for a in data]
            outcome = run_many(self.recursion, [rows] * len(many), carries=many, threads=1)
            many = [carry for carry, _ in outcome]
            outputs = [o for _, o in outcome[: len(settings)]]
            yield tuple(np.stack([o[i] for o in outputs]) for i in range(2))  # type: ignore[misc]

    def _start(self, values: Mapping[str, float]) -> Array:
        """The memory before the first sample."""
        before = self.recursion.carry0[: -_count(self.model, self.unknowns)]
        of_prior = [u for u in self.unknowns if u.kind in ("sigma_x0", "P0", "x0")]
        if any(values[u.name] != u.start for u in of_prior):
            known, _ = placed(self.estimator, self.model, of_prior, values)
            prior = known.assumed[1]
            if self.start is not None:
                before = self.start(prior.mean(self.model), prior.covariance(self.model))
            else:
                changed = dataclasses.replace(self.varied, prior=prior)  # type: ignore[call-arg]
                before = changed.compile(self.wide, self.dt).carry0
        return np.concatenate([before, _numbers(self.model, self.unknowns, values)])


def lanes_of(
    estimator: AbstractEstimator, model: Model, dt: float, unknowns: Sequence[Unknown]
) -> LaneRunner | None:
    """Make the recursion; None if the estimator cannot take these values as inputs."""
    kinds = {u.kind for u in unknowns}
    parameters = [u.entry for u in unknowns if u.kind == "parameter"]
    if "setting" in kinds or estimator.varied(parameters=bool(parameters)).constant_gain:
        return None
    noise = estimator.assumed[0]
    if "walk" in kinds and (not estimator.varies_noise or noise.beyond_additive):
        return None
    if kinds & {"sigma_y", "R"} and not estimator.weighs:
        return None
    wide = _scaled(estimator, model, dt)
    wide = forces_as_inputs(wide, parameters) if parameters else wide
    walks = [u for u in unknowns if u.kind == "walk"]
    wide = with_idle_inputs(wide, [_input(u) for u in walks])
    varied = _varied(estimator, model, dt, walks, parameters=bool(parameters))
    try:
        inner = varied.compile(wide, dt)
    except (TuningError, ModelError):
        return None
    if inner.lag or not {"e", "S", "y_hat"} <= {c.name for c in inner.channels}:
        return None
    found = tuple(unknowns)
    recursion = _judging(inner, model, found, noise.measurement(model))
    return LaneRunner(recursion, estimator, model, varied, wide, inner.start, found, dt)


def _input(unknown: Unknown) -> str:
    return "factor_of_" + unknown.entry.replace(".", "_")


def _scaled(estimator: AbstractEstimator, model: Model, dt: float) -> Model:
    """The model with the scales that the estimator would choose, fixed."""
    noise, prior = estimator.assumed
    s: Setting = setting(model, dt, noise=noise, prior=prior)

    def sized(group: Sequence[Signal], scales: Array) -> tuple[Signal, ...]:
        pairs = zip(group, scales, strict=True)
        return tuple(dataclasses.replace(x, scale=float(k)) for x, k in pairs)

    return dataclasses.replace(
        model, states=sized(model.states, s.sx), outputs=sized(model.outputs, s.sy)
    )


def _varied(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    walks: Sequence[Unknown],
    *,
    parameters: bool,
) -> Compilable:
    """The estimator with process noise that inputs multiply, and its integrator settled.

    With parameters as inputs a linear model is not linear any more: instead of the matrix
    exponential there is a Runge-Kutta method then.
    """
    changes: dict[str, Any] = {}
    if walks:
        changes["noise"] = _varied_noise(estimator.assumed[0], model, walks)
    stand_in = estimator.varied(parameters=parameters)
    chosen = stand_in.chosen(model, dt)
    if chosen is not None:
        if parameters and chosen.scheme == "exact":
            given = dataclasses.replace(chosen, scheme="auto", substeps="auto")
            chosen = explicit(given, lambda: stand_in.modes(model), dt=dt)
        changes["integrator"] = chosen
    return dataclasses.replace(stand_in, **changes)


def _varied_noise(noise: Noise, model: Model, walks: Sequence[Unknown]) -> VariedNoise:
    """Noise of which inputs multiply the process noise that is free."""
    parts, rest = [], {"Q": noise.process(model), "Qc": noise.density(model)}
    for u in walks:
        word, part = walk_parts(noise, model, u)
        rest[word] = rest[word] - part
        parts.append(NoisePart(_input(u), **{word: part}))
    fields = {f.name: getattr(noise, f.name) for f in dataclasses.fields(noise)}
    fields |= {"sigma_w": None, "Q": None, "Qc": None}
    fields |= {word: left for word, left in rest.items() if left.any()}
    return VariedNoise(**fields, parts=tuple(parts))


def _count(model: Model, unknowns: Sequence[Unknown]) -> int:
    return sum(u.kind in ("parameter", "walk") for u in unknowns) + model.ny


def _numbers(model: Model, unknowns: Sequence[Unknown], values: Mapping[str, float]) -> Array:
    """Values that lie behind the memory: parameters, factors of process noise, of sensors."""
    parameters = [values[u.name] for u in unknowns if u.kind == "parameter"]
    walks = [walk_factor(u, values[u.name]) for u in unknowns if u.kind == "walk"]
    return np.concatenate([parameters, walks, sensor_factors(model, unknowns, values)])


def _judging(inner: Recursion, model: Model, unknowns: Sequence[Unknown], R: Array) -> Recursion:
    """Wrap a recursion: values behind its memory go in, innovations by themselves come out."""
    ny, nu, size = model.ny, model.nu, _count(model, unknowns)
    carry = ca.MX.sym("carry", len(inner.carry0) + size)
    data = [ca.MX.sym(n, m) for n, m in (("u", nu), *((k, ny) for k in ("y", "mask", "ya", "ma")))]
    u, y, mask, y_all, mask_all = data
    ends = [0, len(inner.carry0), carry.numel() - ny, carry.numel()]
    memory, inputs, factor = ca.vertsplit(carry, ends)
    weigh = _weights(ny)
    seen = [memory, ca.vertcat(u, inputs), y, weigh(mask, factor)]
    after, *values = inner.step.call(seen, True, False)
    named = dict(zip([c.name for c in inner.channels], values, strict=True))
    e, S, y_hat = named["e"], named["S"], named["y_hat"]
    judged = decorrelated(R)(e, S, y_hat, y_all, mask, mask_all, factor)
    return Recursion(
        step=ca.Function(
            f"tuned_{inner.name}", [carry, *data], [ca.vertcat(after, inputs, factor), *judged]
        ),
        carry0=np.concatenate(
            [inner.carry0, _numbers(model, unknowns, {u.name: u.start for u in unknowns})]
        ),
        channels=(Channel("r", ("output",)), Channel("d", ("output",))),
        dt=inner.dt,
    )


def _weights(ny: int) -> ca.Function:
    """Weights of a sample whose sensors have other standard deviations."""
    mask, factor = ca.SX.sym("mask", ny), ca.SX.sym("factor", ny)
    return ca.Function("weights", [mask, factor], [mask / factor])


def decorrelated(R: Array) -> ca.Function:
    """Innovations independent of each other, and their variances: ``-> (r, d)``.

    Of an output that is judged and was hidden from the estimator the innovation is its measurement
    minus what the estimate shows, and the noise of the sample is that of the judged weight.
    """
    ny = len(R)
    e, vS, y_hat, y = (
        ca.SX.sym(k, n) for k, n in (("e", ny), ("S", ny * (ny + 1) // 2), ("y_hat", ny), ("y", ny))
    )
    used, mask, factor = ca.SX.sym("used", ny), ca.SX.sym("mask", ny), ca.SX.sym("factor", ny)
    judged = mask > 0
    hidden = ca.logic_and(judged, ca.logic_not(used > 0))
    size = ca.if_else(hidden, factor / ca.if_else(judged, mask, 1), 1)
    H = ca.diag(ca.if_else(hidden, 1, 0))
    own = ca.diag(size) @ ca.SX(R) @ ca.diag(size) - ca.SX(R)
    S = unvech(vS) + H @ own @ H
    error = ca.if_else(hidden, y - y_hat, e)
    B = ca.diag(ca.if_else(judged, 1, 0))
    L, d = ldl(B @ S @ B + ca.SX.eye(ny) - B)
    r = forward(L, B @ error)
    return ca.Function(
        "decorrelated", [e, vS, y_hat, y, used, mask, factor], [ca.densify(r), ca.densify(d)]
    )
