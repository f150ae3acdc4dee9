"""Values that stay changeable in exported code: they are inputs of the step, with defaults.

Standard deviations of sensors divide the weights of the sample, as `sigma_factor` of a recording
does, where the estimator can weigh; parameters of the model are inputs of it. All other numbers are
followed by the constants that are made of them (`backsight.engine.program.following`), and by the
memory before the first sample.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from backsight.engine import vm
from backsight.engine.c99 import SettingsField
from backsight.engine.program import Beginning, Program, following, starting, walk
from backsight.engine.recursion import Recursion
from backsight.errors import BacksightError, EngineError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.scaled import setting
from backsight.export._followed import PRIOR, SIGMA, Followed, changeable, followed, noisy, refusal
from backsight.export._opened import PARAMETERS, opened_step
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures import forces_as_inputs
from backsight.types import Array

DEVIATION = 1e-9
"""Largest deviation of an output that making values changeable may bring, of its largest value."""

SEED = 1
"""Of the trials that show what follows."""


@dataclasses.dataclass(frozen=True)
class Tunable:
    """A recursion with settings, ``(carry, *settings, u, y, mask) -> (carry, *outputs)``.

    Parameters
    ----------
    plain : Recursion
        As the estimator makes it, ``(carry, u, y, mask) -> (carry, *outputs)``.
    recursion : Recursion
        With the settings that are inputs of the step: weights of sensors, parameters of the model.
        The memory of a window holds parameters that are inputs, too.
    program : Program
        With all settings.
    start : Beginning, optional
        How the memory before the first sample follows them.
    fields : tuple of SettingsField
    signals : dict of tuple of Signal
        Name, unit and default of what a field holds.
    """

    plain: Recursion
    recursion: Recursion
    program: Program
    start: Beginning | None
    fields: tuple[SettingsField, ...]
    signals: dict[str, tuple[Signal, ...]]


def weighs(estimator: AbstractEstimator) -> bool:
    """Whether the noise of its sensors may be changed as the weight of a sample.

    Of one that looks back the covariance of the innovation is that of an earlier sample, whose
    noise nobody keeps.
    """
    return estimator.weighs and not estimator.constant_gain and not estimator.delay


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
        See `backsight.export.export_c`; by default the noise of sensors, where it is a weight.
    data : sequence of array
        u, y and mask of samples on which the results must stay what they are.
    restart : bool
        See `Recursion.restarting`.

    Raises
    ------
    EngineError
        If a name is unknown, or the estimator would find something else with it changeable.
    """
    plain = estimator.compile_watched(model, dt)
    told = weighs(estimator) and noisy(estimator, model)
    wanted = [SIGMA] * told if names is None else list(dict.fromkeys(names))
    _check(wanted, estimator, model)
    known = {s.name: s for s in model.parameters}
    parameters = [n for n in wanted if n in known]
    signals: dict[str, tuple[Signal, ...]] = {}
    if SIGMA in wanted and weighs(estimator):
        signals[SIGMA] = _sensors(estimator, model)
    if parameters:
        signals[PARAMETERS] = tuple(known[n] for n in parameters)
    others = [n for n in wanted if n not in known and n not in signals]
    fixed = _fixed(estimator, model, dt, parameters) if parameters or others else (estimator, model)
    groups = [followed(n, *fixed) for n in others]
    R = estimator.assumed[0].measurement(model) if SIGMA in signals else np.zeros((0, 0))

    def made(values: Sequence[Array]) -> Recursion:
        changed = fixed
        for group, v in zip(groups, values, strict=True):
            changed = group.change(*changed, v)
        inner = _compiled(*changed, dt, parameters) if parameters or others else plain
        inner = inner.restarting() if restart else inner
        return dataclasses.replace(inner, step=opened_step(inner, model, signals, R))

    recursion = made([group.values for group in groups])
    plain = plain.restarting() if restart else plain
    if parameters:
        _compare(plain, recursion, signals, data)
    program, start = _following(made, groups) if groups else (walk(recursion.step), None)
    signals |= {group.name: group.signals for group in groups}
    by_order = {name: signals[name] for name in sorted(signals, key=_order)}
    fields = tuple(
        SettingsField(name, tuple(s.value for s in group), tuple(_label(s) for s in group))
        for name, group in by_order.items()
    )
    return Tunable(plain, recursion, program, start, fields, by_order)


def _order(name: str) -> tuple[int, str]:
    """The prior first, then standard deviations: so FMUs find them, see `export.fmi`."""
    if name in PRIOR:
        return PRIOR.index(name), name
    return len(PRIOR) + (not name.startswith("sigma_")), name


def _following(
    made: Callable[[Sequence[Array]], Recursion], groups: Sequence[Followed]
) -> tuple[Program, Beginning | None]:
    """The program whose constants follow, and how its memory begins."""
    rng = np.random.default_rng(SEED)
    trials = [group.trials(rng) for group in groups]
    recursions = [made([t[k] for t in trials]) for k in range(3)]
    settings = np.hstack(trials)
    fields = {group.name: len(group.signals) for group in groups}
    what = ", ".join(fields)
    programs = [walk(r.step) for r in recursions]
    memories = [np.asarray(r.carry0, float) for r in recursions]
    return (
        following(programs, settings, fields, what=what),
        starting(memories, settings, fields, what=what),
    )


def _check(wanted: Sequence[str], estimator: AbstractEstimator, model: Model) -> None:
    known = [*changeable(estimator, model), *(s.name for s in model.parameters)]
    for name in wanted:
        if name not in known:
            problem = f"'{name}' cannot be made changeable: {nearest(name, known)}"
            raise refusal(name, estimator) or EngineError(problem)


def _sensors(estimator: AbstractEstimator, model: Model) -> tuple[Signal, ...]:
    sigma = np.sqrt(np.diag(estimator.assumed[0].measurement(model)))
    pairs = zip(model.outputs, sigma, strict=True)
    return tuple(Signal(s.unit, value=float(v), name=s.name) for s, v in pairs)


def _label(signal: Signal) -> str:
    return f"{signal.name} [{signal.unit}]" if signal.unit else signal.name


def _fixed(
    estimator: AbstractEstimator, model: Model, dt: float, parameters: Sequence[str]
) -> tuple[AbstractEstimator, Model]:
    """Estimator and model with nothing left open that would depend on what is changed."""
    chosen = estimator.chosen(model, dt)
    if parameters and chosen is not None and chosen.scheme == "exact":
        raise EngineError(
            f"{', '.join(parameters)} cannot be made changeable: the model is carried by its "
            "matrix exponential, which is computed here; give the estimator integrator = 'rk4'"
        )
    settled: dict[str, Any] = {} if chosen is None else {"integrator": chosen}
    return dataclasses.replace(estimator, **settled), _with_scales(estimator, model, dt)


def _compiled(
    estimator: AbstractEstimator, model: Model, dt: float, parameters: Sequence[str]
) -> Recursion:
    """The recursion whose last inputs are parameters."""
    wide = forces_as_inputs(model, parameters) if parameters else model
    try:
        return estimator.compile_watched(wide, dt)
    except BacksightError as error:
        what = ", ".join(parameters) or "that"
        raise EngineError(f"{what} cannot be made changeable: {error}") from error


def _with_scales(estimator: AbstractEstimator, model: Model, dt: float) -> Model:
    """The model with the scales that the estimator would choose from noise and prior, fixed."""
    try:
        noise, prior = estimator.assumed
    except BacksightError:
        return model
    s = setting(model, dt, noise=noise, prior=prior, noiseless=True)

    def sized(group: Sequence[Signal], scales: Array) -> tuple[Signal, ...]:
        pairs = zip(group, scales, strict=True)
        return tuple(dataclasses.replace(x, scale=float(k)) for x, k in pairs)

    return dataclasses.replace(
        model, states=sized(model.states, s.sx), outputs=sized(model.outputs, s.sy)
    )


def _compare(
    plain: Recursion,
    opened: Recursion,
    signals: Mapping[str, Sequence[Signal]],
    data: Sequence[Array],
) -> None:
    """Raise `EngineError` unless parameters as inputs give what the estimator finds."""
    wanted = vm.run(plain, data, carry=plain.carry0)[1]
    rows = [np.tile([s.value for s in group], (len(data[0]), 1)) for group in signals.values()]
    found = vm.run(opened, [*rows, *data], carry=opened.carry0)[1]
    names = ", ".join(s.name for s in signals[PARAMETERS])
    for channel, a, b in zip(plain.channels, wanted, found, strict=True):
        size = np.max(np.abs(a), initial=0.0) or 1.0
        worst = np.max(np.abs(a - b), initial=0.0) / size
        if worst > DEVIATION:
            raise EngineError(
                f"{names} cannot be made changeable: '{channel.name}' would differ by {worst:.1e} "
                "of its largest value on the recording"
            )
