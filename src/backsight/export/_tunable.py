"""Values that stay changeable in exported code: they are inputs of the step, with defaults.

Standard deviations of sensors divide the weights of the sample, as `sigma_factor` of a recording
does; parameters of the model are inputs of it. Everything else is what it was.
"""

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine import vm
from backsight.engine.c99 import SettingsField
from backsight.engine.recursion import Recursion
from backsight.errors import BacksightError, EngineError, nearest
from backsight.estimators.base import AbstractEstimator, setting
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures import forces_as_inputs
from backsight.types import Array

SIGMA = "sigma_y"
"""Field of the standard deviations of the sensors, and the word that asks for them."""

PARAMETERS = "parameters"
"""Field of the parameters of the model."""

DEVIATION = 1e-9
"""Largest deviation of an output that making values changeable may bring, of its largest value."""

DATA = ("u", "y", "mask")


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
        ``"sigma_y"`` and parameters of the model; by default the first, where the estimator can.
    data : sequence of array
        u, y and mask of samples on which the results must stay what they are.
    restart : bool
        See `Recursion.restarting`.

    Raises
    ------
    EngineError
        If a name is unknown, or the estimator would find something else with it changeable.
    """
    plain = estimator.compile(model, dt)
    wanted = [SIGMA] * weighs(estimator) if names is None else list(dict.fromkeys(names))
    _check(wanted, estimator, model)
    parameters = [n for n in wanted if n != SIGMA]
    inner = _with_parameters(estimator, model, dt, parameters) if parameters else plain
    if restart:
        plain, inner = plain.restarting(), inner.restarting()
    signals = {}
    if SIGMA in wanted:
        signals[SIGMA] = _sensors(estimator, model)
    if parameters:
        known = {s.name: s for s in model.parameters}
        signals[PARAMETERS] = tuple(known[n] for n in parameters)
    fields = tuple(
        SettingsField(name, tuple(s.value for s in group), tuple(_label(s) for s in group))
        for name, group in signals.items()
    )
    R = estimator.assumed[0].measurement(model) if SIGMA in wanted else np.zeros((0, 0))
    opened = dataclasses.replace(inner, step=_opened(inner, model, signals, R))
    found = Tunable(plain, opened, fields, signals)
    if parameters:
        _compare(found, data, parameters)
    return found


def _check(wanted: Sequence[str], estimator: AbstractEstimator, model: Model) -> None:
    known = [SIGMA] * weighs(estimator) + [s.name for s in model.parameters]
    for name in wanted:
        if name == SIGMA and not weighs(estimator):
            raise EngineError(
                f"{estimator.title} has no noise of its sensors that could be changed while it runs"
            )
        if name not in known:
            raise EngineError(f"'{name}' cannot be made changeable: {nearest(name, known)}")


def _sensors(estimator: AbstractEstimator, model: Model) -> tuple[Signal, ...]:
    sigma = np.sqrt(np.diag(estimator.assumed[0].measurement(model)))
    pairs = zip(model.outputs, sigma, strict=True)
    return tuple(Signal(s.unit, value=float(v), name=s.name) for s, v in pairs)


def _label(signal: Signal) -> str:
    return f"{signal.name} [{signal.unit}]" if signal.unit else signal.name


def _with_parameters(
    estimator: AbstractEstimator, model: Model, dt: float, names: Sequence[str]
) -> Recursion:
    """The recursion whose last inputs are parameters of the model."""
    chosen = estimator.chosen(model, dt)
    if chosen is not None and chosen.scheme == "exact":
        raise EngineError(
            f"{', '.join(names)} cannot be made changeable: the model is carried by its matrix "
            "exponential, which is computed here; give the estimator integrator = 'rk4'"
        )
    wide = forces_as_inputs(_with_scales(estimator, model, dt), names)
    fixed = (
        estimator if chosen is None else dataclasses.replace(estimator, integrator=chosen)  # type: ignore[call-arg]
    )
    try:
        return fixed.compile(wide, dt)
    except BacksightError as error:
        raise EngineError(f"{', '.join(names)} cannot be made changeable: {error}") from error


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


def _opened(
    inner: Recursion, model: Model, signals: dict[str, tuple[Signal, ...]], R: Array
) -> ca.Function:
    """The step with the settings as inputs of their own, before the data."""
    sizes = {
        "carry": len(inner.carry0),
        **{name: len(group) for name, group in signals.items()},
        **dict(zip(DATA, (model.nu, model.ny, model.ny), strict=True)),
    }
    given = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    u, mask = given["u"], given["mask"]
    if PARAMETERS in given:
        u = ca.vertcat(u, given[PARAMETERS])
    if SIGMA in given:
        mask = _weights(R)(mask, given[SIGMA])
    results = inner.step.call([given["carry"], u, given["y"], mask], True, False)
    if SIGMA in given:
        where = 1 + [c.name for c in inner.channels].index("S")
        results[where] = _unmeasured(R)(results[where], given["mask"], given[SIGMA])
    outputs = [f"o{i}" for i in range(len(results))]
    return ca.Function(inner.name, list(given.values()), results, list(given), outputs)


def _weights(R: Array) -> ca.Function:
    """Weights of a sample whose sensors have other standard deviations than the nominal ones."""
    mask, sigma = ca.SX.sym("mask", len(R)), ca.SX.sym("sigma", len(R))
    return ca.Function("weights", [mask, sigma], [mask * (_nominal(R) / sigma)])


def _unmeasured(R: Array) -> ca.Function:
    """Covariance of the innovation of outputs that were not measured, which have no weight.

    A weight w makes R_ij of it R_ij / (w_i w_j); without one the nominal noise is in it.
    """
    n = len(R)
    S, mask = ca.SX.sym("S", n * (n + 1) // 2), ca.SX.sym("mask", n)
    sigma = ca.SX.sym("sigma", n)
    hidden = ca.logic_not(mask > 0)
    is_ = sigma / _nominal(R) / ca.if_else(hidden, 1, mask)
    was = ca.if_else(hidden, 1, is_)
    added = ca.SX(R) * (is_ @ is_.T - was @ was.T)
    return ca.Function("unmeasured", [S, mask, sigma], [ca.densify(S + vech(added))])


def _nominal(R: Array) -> ca.SX:
    return ca.SX(ca.DM(np.sqrt(np.diag(R))))


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
