"""Values that stay changeable in exported code: they are inputs of the step, with defaults.

Standard deviations of sensors divide the weights of the sample, as `sigma_factor` of a recording
does; parameters of the model, and factors of the random walks, are inputs of it. Everything else is
what it was.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from backsight.engine import vm
from backsight.engine.c99 import SettingsField
from backsight.engine.recursion import Recursion
from backsight.errors import BacksightError, EngineError, nearest
from backsight.estimators.around.misled import watched
from backsight.estimators.base import AbstractEstimator, setting
from backsight.estimators.uncertainty import Noise
from backsight.estimators.varied_noise import NoisePart, VariedNoise
from backsight.export._opened import PARAMETERS, SIGMA, WALK, opened_step
from backsight.models.augment import with_idle_inputs
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures import forces_as_inputs
from backsight.types import Array

DEVIATION = 1e-9
"""Largest deviation of an output that making values changeable may bring, of its largest value."""

FACTOR = "factor_of_"
"""Begin of the names of inputs that multiply random walks."""


@dataclasses.dataclass(frozen=True)
class Tunable:
    """A recursion, ``(carry, *settings, u, y, mask) -> (carry, *outputs)``, with its settings.

    Parameters
    ----------
    plain : Recursion
        As the estimator makes it, ``(carry, u, y, mask) -> (carry, *outputs)``.
    recursion : Recursion
        With the settings. The memory of a window holds parameters that are inputs, too.
    fields : tuple of SettingsField
    signals : dict of tuple of Signal
        Name, unit and default of what a field holds.
    """

    plain: Recursion
    recursion: Recursion
    fields: tuple[SettingsField, ...]
    signals: dict[str, tuple[Signal, ...]]

    def run(self, data: Sequence[Array]) -> list[Array]:
        """Outputs of the changeable step over data, with the defaults."""
        rows = [np.tile(np.array(f.values), (len(data[0]), 1)) for f in self.fields]
        return vm.run(self.recursion, [*rows, *data], carry=self.recursion.carry0)[1]


def weighs(estimator: AbstractEstimator) -> bool:
    """Whether the noise of its sensors may be changed while it runs.

    Of one that looks back the covariance of the innovation is that of an earlier sample, whose
    noise nobody keeps.
    """
    return estimator.weighs and not estimator.constant_gain and not estimator.delay


def varies(estimator: AbstractEstimator) -> bool:
    """Whether the random walks of its states may be changed while it runs."""
    try:
        noise = estimator.assumed[0]
    except BacksightError:
        return False
    able = bool(estimator.varies_noise) and not estimator.constant_gain
    return able and noise.sigma_w is not None and not noise.beyond_additive


def tunable(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    *,
    names: Sequence[str] | None,
    data: Sequence[Array],
    restart: bool = False,
) -> Tunable:
    """Make the recursion with what shall be changeable.

    Parameters
    ----------
    estimator, model, dt
    names : sequence of str, optional
        ``"sigma_y"``, ``"sigma_w"`` and parameters of the model; by default the first, where the
        estimator can.
    data : sequence of array
        u, y and mask of samples on which the results must stay what they are.
    restart : bool
        See `Recursion.restarting`.

    Raises
    ------
    EngineError
        If a name is unknown, or the estimator would find something else with it changeable.
    """
    plain = watched(estimator.compile(model, dt), estimator, model)
    wanted = [SIGMA] * weighs(estimator) if names is None else list(dict.fromkeys(names))
    _check(wanted, estimator, model)
    parameters = [n for n in wanted if n not in (SIGMA, WALK)]
    walks = _walks(estimator, model) if WALK in wanted else ()
    inner = _with_inputs(estimator, model, dt, parameters, walks) if parameters or walks else plain
    if restart:
        plain, inner = plain.restarting(), inner.restarting()
    signals = {}
    if SIGMA in wanted:
        signals[SIGMA] = _sensors(estimator, model)
    if walks:
        signals[WALK] = walks
    if parameters:
        known = {s.name: s for s in model.parameters}
        signals[PARAMETERS] = tuple(known[n] for n in parameters)
    fields = tuple(
        SettingsField(name, tuple(s.value for s in group), tuple(_label(s) for s in group))
        for name, group in signals.items()
    )
    R = estimator.assumed[0].measurement(model) if SIGMA in wanted else np.zeros((0, 0))
    opened = dataclasses.replace(inner, step=opened_step(inner, model, signals, R))
    found = Tunable(plain, opened, fields, signals)
    if parameters or walks:
        _compare(found, data, [*parameters, *([WALK] if walks else [])])
    return found


def _check(wanted: Sequence[str], estimator: AbstractEstimator, model: Model) -> None:
    known = [SIGMA] * weighs(estimator) + [WALK] * varies(estimator)
    known += [s.name for s in model.parameters]
    for name in wanted:
        if name == SIGMA and not weighs(estimator):
            raise EngineError(
                f"{estimator.title} has no noise of its sensors that could be changed while it runs"
            )
        if name == WALK and not varies(estimator):
            raise EngineError(
                f"{estimator.title} has no sigma_w that could be changed while it runs; filters "
                "whose noise is given as sigma_w have, but not with a constant gain"
            )
        if name not in known:
            raise EngineError(f"'{name}' cannot be made changeable: {nearest(name, known)}")


def _sensors(estimator: AbstractEstimator, model: Model) -> tuple[Signal, ...]:
    sigma = np.sqrt(np.diag(estimator.assumed[0].measurement(model)))
    pairs = zip(model.outputs, sigma, strict=True)
    return tuple(Signal(s.unit, value=float(v), name=s.name) for s, v in pairs)


def _label(signal: Signal) -> str:
    return f"{signal.name} [{signal.unit}]" if signal.unit else signal.name


def _walks(estimator: AbstractEstimator, model: Model) -> tuple[Signal, ...]:
    sigma = np.sqrt(np.diag(estimator.assumed[0].process(model)))
    pairs = zip(model.states, sigma, strict=True)
    return tuple(Signal(s.unit, value=float(v), name=s.name) for s, v in pairs if v > 0)


def _with_inputs(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    names: Sequence[str],
    walks: Sequence[Signal],
) -> Recursion:
    """The recursion whose last inputs are parameters, and factors of the random walks."""
    chosen = estimator.chosen(model, dt)
    if names and chosen is not None and chosen.scheme == "exact":
        raise EngineError(
            f"{', '.join(names)} cannot be made changeable: the model is carried by its matrix "
            "exponential, which is computed here; give the estimator integrator = 'rk4'"
        )
    wide = _with_scales(estimator, model, dt)
    wide = forces_as_inputs(wide, names) if names else wide
    changes: dict[str, Any] = {} if chosen is None else {"integrator": chosen}
    if walks:
        wide = with_idle_inputs(wide, [FACTOR + s.name for s in walks])
        changes["noise"] = _varied(estimator.assumed[0], model, walks)
    try:
        changed = dataclasses.replace(estimator, **changes)
        return watched(changed.compile(wide, dt), estimator, wide)
    except BacksightError as error:
        what = ", ".join([*names, *([WALK] if walks else [])])
        raise EngineError(f"{what} cannot be made changeable: {error}") from error


def _varied(noise: Noise, model: Model, walks: Sequence[Signal]) -> VariedNoise:
    """The noise with random walks that inputs multiply, see `backsight.estimators.varied_noise`."""
    index = {s.name: i for i, s in enumerate(model.states)}
    parts = []
    for walk in walks:
        Q = np.zeros((model.nx, model.nx))
        Q[index[walk.name], index[walk.name]] = walk.value**2
        parts.append(NoisePart((FACTOR + walk.name,) * 2, Q=Q))
    fields = {f.name: getattr(noise, f.name) for f in dataclasses.fields(noise)}
    return VariedNoise(**{**fields, "sigma_w": None}, parts=tuple(parts))


def _with_scales(estimator: AbstractEstimator, model: Model, dt: float) -> Model:
    """The model with the scales that the estimator would choose from noise and prior, fixed."""
    try:
        noise, prior = estimator.assumed
    except BacksightError:
        return model
    s = setting(model, dt, noise=noise, prior=prior)

    def sized(group: Sequence[Signal], scales: Array) -> tuple[Signal, ...]:
        pairs = zip(group, scales, strict=True)
        return tuple(dataclasses.replace(x, scale=float(k)) for x, k in pairs)

    return dataclasses.replace(
        model, states=sized(model.states, s.sx), outputs=sized(model.outputs, s.sy)
    )


def _compare(found: Tunable, data: Sequence[Array], parameters: Sequence[str]) -> None:
    """Raise `EngineError` unless the changeable step finds what the estimator finds."""
    plain = found.plain
    wanted = vm.run(plain, data, carry=plain.carry0)[1]
    for channel, a, b in zip(plain.channels, wanted, found.run(data), strict=True):
        size = np.max(np.abs(a), initial=0.0) or 1.0
        worst = np.max(np.abs(a - b), initial=0.0) / size
        if worst > DEVIATION:
            raise EngineError(
                f"{', '.join(parameters)} cannot be made changeable: '{channel.name}' would differ "
                f"by {worst:.1e} of its largest value on the recording"
            )
