r"""Many settings at once: a recursion whose free values are a part of its memory.

A lane of the processor's vectors is one setting: the free values lie behind the memory of the
estimator, which nothing changes in a step, and are handed to it as inputs. Standard deviations of
sensors divide the weights of the sample (`sigma_factor`), those of the process noise, parameters of
the model and settings are inputs (`_wide`), the prior is the memory before the first sample, and a
delay of inputs is in the data. So one program serves all passes, whatever the values.

What comes out are innovations that are independent within the sample, in the order of the outputs:
with :math:`S = L D L'` the entries of :math:`r = L^{-1} e` have the variances in :math:`D`.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import casadi as ca
import numpy as np

from backsight.algebra.factor import ldl
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.triangular import forward
from backsight.description import Kept, content
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import ModelError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.estimators.varied_noise import noise_at, scaled_parts
from backsight.models.model import Model
from backsight.run.estimation.carrying import from_first_sample, run_on
from backsight.tune.fitting.runners._delays import shifted
from backsight.tune.fitting.runners._foresight import foresight, last_estimates
from backsight.tune.fitting.runners._wide import Wide, opened_to_inputs
from backsight.tune.fitting.values import Unknown, placed, sensor_factors
from backsight.types import Array

Data = tuple[Array, Array, Array, Array, Array]
"""Inputs, outputs and weights as the estimator sees them; outputs and weights that are judged."""

CHUNK = 100_000
"""Samples of which the innovations of all lanes are kept at a time."""

FEW = 4
"""Lanes that every processor has."""

KEPT = 16
"""Number of programs that are kept from fit to fit."""


@dataclasses.dataclass(frozen=True)
class LaneRunner:
    """An estimator that runs with many settings at once.

    Parameters
    ----------
    recursion : Recursion
        ``(carry, u, y, mask, y_all, mask_all) -> (carry, r, d)``; of an estimator that looks back
        the weights that the estimator saw of the sample that is judged come last.
    estimator, model : AbstractEstimator, Model
        As given, and with values as inputs.
    wide : Wide
    start : callable, optional
        See `Recursion.start`.
    unknowns : tuple of Unknown
    dt : float
    own : int
        Size of the estimator's own memory, which is in front.
    """

    recursion: Recursion
    estimator: AbstractEstimator
    model: Model
    wide: Wide
    start: Callable[[Array, Array], Array] | None
    unknowns: tuple[Unknown, ...]
    dt: float
    own: int

    def innovations(
        self, data: Data, settings: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[Array, Array]]:
        """Innovations and their variances (lanes, n, ny) with every setting, piece by piece."""
        from backsight.engine.lanes import run_many  # brings the compiler along

        # With few values half of a wide vector would be empty.
        lanes = FEW if len(self.unknowns) < FEW else None
        many = [self._start(values) for values in settings]
        rows = [self._rows(data, values) for values in settings]
        for first in range(0, len(data[0]) + self.recursion.lag, CHUNK):
            part = [[a[first : first + CHUNK] for a in lane] for lane in rows]
            outcome = run_many(self.recursion, part, carries=many, lanes=lanes, threads=1)
            many = [carry for carry, _ in outcome]
            late = max(self.recursion.lag - first, 0)
            outputs = [from_first_sample(o, late) for _, o in outcome]
            yield tuple(np.stack([o[i] for o in outputs]) for i in range(2))  # type: ignore[misc]

    def _rows(self, data: Data, values: Mapping[str, float]) -> list[Array]:
        """Data of a setting: inputs without their delays, and those of the sample before.

        Of an estimator that looks back, what is judged is that of the sample that it then puts out.
        """
        u = shifted(data[0], self.model, self.dt, self.unknowns, values)
        if self.wide.remembers:
            u = np.hstack([u, np.vstack([u[:1], u[:-1]])])
        lag = self.recursion.lag
        if not lag:
            return [u, *data[1:]]
        _, y, mask, *judged = data
        late = [np.vstack([np.zeros((lag, a.shape[1])), a]) for a in (*judged, mask)]
        return [*run_on([u, y, mask], lag), *late]

    def _start(self, values: Mapping[str, float]) -> Array:
        """The memory before the first sample."""
        whole = self.recursion.carry0
        before = whole[: self.own]
        of_prior = [u for u in self.unknowns if u.kind in ("sigma_x0", "P0", "x0")]
        if any(values[u.name] != u.start for u in of_prior):
            known, _ = placed(self.estimator, self.model, of_prior, values)
            prior = known.assumed[1]
            if self.start is not None:
                before = self.start(prior.mean(self.model), prior.covariance(self.model))
            else:
                varied = self.wide.varied
                changed = dataclasses.replace(varied, prior=prior)  # type: ignore[call-arg]
                before = changed.compile(self.wide.model, self.dt).carry0
        behind = np.concatenate(
            [self.wide.numbers(values), sensor_factors(self.model, self.unknowns, values)]
        )
        return np.concatenate([before, whole[self.own : len(whole) - len(behind)], behind])


def lanes_of(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    unknowns: Sequence[Unknown],
    *,
    ahead: int = 0,
) -> LaneRunner | None:
    """Make the recursion; None if the estimator cannot take these values as inputs.

    With `ahead` samples it is not innovations that come out but what the model by itself makes of
    every estimate so many samples later, see `foresight`; the variances are then 1. What was made
    is kept: to make it takes as long as to search for the values in a short recording.
    """
    found = tuple(unknowns)
    key = content(estimator, model, dt, found, ahead, type(estimator).build)
    kept = _made.of(key, lambda: _lanes(estimator, model, dt, found, ahead))
    # Those given, whose arrays nobody has changed since.
    return kept and dataclasses.replace(kept, estimator=estimator, model=model)


_made: Kept[LaneRunner | None] = Kept(KEPT)


def _lanes(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    unknowns: tuple[Unknown, ...],
    ahead: int,
) -> LaneRunner | None:
    if not _able(estimator, unknowns):
        return None
    try:
        wide = opened_to_inputs(estimator, model, dt, unknowns)
        inner = wide.varied.compile(wide.model, dt)
    except (TuningError, ModelError):
        return None
    if (inner.lag and ahead) or not {"e", "S", "y_hat"} <= {c.name for c in inner.channels}:
        return None
    recursion = _judging(inner, wide, model, unknowns, ahead)
    own = len(inner.carry0)
    return LaneRunner(recursion, estimator, model, wide, inner.start, unknowns, dt, own)


def _able(estimator: AbstractEstimator, unknowns: Sequence[Unknown]) -> bool:
    """Whether the estimator can take these values as inputs."""
    kinds = {u.kind for u in unknowns}
    if "process" in kinds:
        return False  # it is a part of the model's equations
    bends = "parameter" in kinds or any(u.late_output for u in unknowns)
    if bends and isinstance(estimator, AbstractForceEstimator):
        return False  # a linear model would not be carried on exactly any more
    if estimator.varied(parameters=bends).constant_gain:
        return False
    noise, words = estimator.assumed[0], {u.matrix.word for u in unknowns if u.matrix is not None}
    if "walk" in kinds or words:
        if not estimator.varies_noise or noise.beyond_additive:
            return False
        if "R" in words and "R" not in estimator.varies_noise:
            return False
    if kinds & {"sigma_y", "R"} and not estimator.weighs:
        return False
    settings = [u for u in unknowns if u.kind == "setting"]
    return all(u.entry in able_settings(estimator) and u.start > 0 for u in settings)


def able_settings(estimator: AbstractEstimator) -> set[str]:
    """Paths of the settings that may be inputs."""
    rule = estimator.outliers
    found = {f"noise.outliers.{n}" for n in rule.varied_settings} if rule is not None else set()
    return {*estimator.varied_settings} | found


def _judging(
    inner: Recursion, wide: Wide, model: Model, unknowns: Sequence[Unknown], ahead: int
) -> Recursion:
    """Wrap a recursion: values behind its memory go in, innovations by themselves come out.

    Between its memory and the values are the estimates and inputs of the last `ahead` samples.
    """
    ny, nu = model.ny, model.nu * (2 if wide.remembers else 1)
    start = {u.name: u.start for u in unknowns}
    past, numbers = np.zeros((model.nx + nu) * ahead), wide.numbers(start)
    memory0 = [inner.carry0, past, numbers, sensor_factors(model, unknowns, start)]
    carry = ca.MX.sym("carry", sum(map(len, memory0)))
    names = ("y", "mask", "ya", "ma", *(("used",) if inner.lag else ()))
    data = [ca.MX.sym(n, m) for n, m in (("u", nu), *((k, ny) for k in names))]
    u, y, mask, y_all, mask_all = data[:5]
    ends = np.cumsum([0, *map(len, memory0)]).tolist()
    memory, history, inputs, factor = ca.vertsplit(carry, ends)
    given = ca.vertcat(u, inputs)
    after, *values = inner.step.call([memory, given, y, _weights(ny)(mask, factor)], True, False)
    named = dict(zip([c.name for c in inner.channels], values, strict=True))
    if ahead:
        X, U = last_estimates(history, model.nx, nu, ahead)
        held = ca.vertcat(ca.horzcat(U, u), ca.repmat(inputs, 1, ahead + 1))
        look = foresight(wide.varied, wide.model, inner.dt, ahead)
        judged = [look(X[:, 0], held, y_all, mask_all), ca.MX.ones(ny)]
        moved = [ca.horzcat(X[:, 1:], named["x_hat"]), ca.horzcat(U[:, 1:], u)]
        history = ca.vertcat(*map(ca.vec, moved))
    else:
        R = _sensors(wide, model)(given)
        used = data[-1] if inner.lag else mask
        seen = [named["e"], named["S"], named["y_hat"], y_all, used, mask_all, factor, R]
        judged = list(decorrelated(ny)(*seen))
    next_carry = ca.vertcat(after, history, inputs, factor)
    return Recursion(
        step=ca.Function(f"tuned_{inner.name}", [carry, *data], [next_carry, *judged]),
        carry0=np.concatenate(memory0),
        channels=(Channel("r", ("output",)), Channel("d", ("output",))),
        dt=inner.dt,
        lag=inner.lag,
    )


def _sensors(wide: Wide, model: Model) -> ca.Function:
    """Covariance of the sensors' noise at inputs, as its lower triangle: ``u -> R``."""
    noise = wide.varied.assumed[0]
    one = np.ones(model.nx), np.ones(model.ny)
    parts = [(p.index, p.R) for p in scaled_parts(noise, wide.model, *one) if p.R.any()]
    R, u = noise.measurement(model, singular=True), ca.SX.sym("u", wide.model.nu)
    return ca.Function(
        "sensors", [u], [ca.densify(vech(noise_at(0 * R if parts else R, parts, u)))]
    )


def _weights(ny: int) -> ca.Function:
    """Weights of a sample whose sensors have other standard deviations."""
    mask, factor = ca.SX.sym("mask", ny), ca.SX.sym("factor", ny)
    return ca.Function("weights", [mask, factor], [mask / factor])


def decorrelated(ny: int) -> ca.Function:
    """Innovations independent of each other, and their variances: ``-> (r, d)``.

    Of an output that is judged and was hidden from the estimator the innovation is its measurement
    minus what the estimate shows, and the noise of the sample is that of the judged weight.
    """
    e, vS, y_hat, y = (
        ca.SX.sym(k, n) for k, n in (("e", ny), ("S", ny * (ny + 1) // 2), ("y_hat", ny), ("y", ny))
    )
    used, mask, factor = ca.SX.sym("used", ny), ca.SX.sym("mask", ny), ca.SX.sym("factor", ny)
    vR = ca.SX.sym("R", ny * (ny + 1) // 2)
    R = unvech(vR)
    judged = mask > 0
    hidden = ca.logic_and(judged, ca.logic_not(used > 0))
    size = ca.if_else(hidden, factor / ca.if_else(judged, mask, 1), 1)
    H = ca.diag(ca.if_else(hidden, 1, 0))
    own = ca.diag(size) @ R @ ca.diag(size) - R
    S = unvech(vS) + H @ own @ H
    error = ca.if_else(hidden, y - y_hat, e)
    B = ca.diag(ca.if_else(judged, 1, 0))
    L, d = ldl(B @ S @ B + ca.SX.eye(ny) - B)
    r = forward(L, B @ error)
    symbols = [e, vS, y_hat, y, used, mask, factor, vR]
    return ca.Function("decorrelated", symbols, [ca.densify(r), ca.densify(d)])
