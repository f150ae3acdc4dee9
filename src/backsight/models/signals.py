"""Named signals with unit, scale and bounds, and access to expressions by name."""

import dataclasses
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from backsight.description import Description, Positive, Sound, Unlimited
from backsight.errors import BacksightError, ModelError, nearest, printable
from backsight.types import Array, ByName


@dataclasses.dataclass(frozen=True)
class Signal(Description):
    """A state, input, output or parameter.

    Parameters
    ----------
    unit : str
        Physical unit, for labels.
    value : float
        Initial value of a state, value of a parameter [unit].
    scale : float, optional
        Typical size [unit], used inside for conditioning; found from the prior if not given.
    lower, upper : float
        Bounds [unit].
    positive : bool
        Of a state or of a parameter that becomes one: it is estimated as a logarithm and cannot
        reach zero, see `backsight.estimators.around.positive`. No bound is needed.
    position : float, optional
        Where along the structure it is [m], for maps.
    dummy : float, optional
        Of an output that no sensor has: the value that stands for its measurement in every sample,
        see `backsight.models.views.virtual.with_dummies`.
    wrap : float, optional
        Of an output that is an angle and starts anew after a turn: what a turn is, ``360`` or
        ``2 * np.pi`` [unit]. Innovations are then the shortest way round.
    resolution : float, optional
        Of an output: the step of its readings [unit]. Rounding to it counts as noise of the
        variance ``resolution**2 / 12`` beside that of the estimator.
    saturation : (float, float), optional
        Of an output: the ends of the range of its sensor [unit], infinite where there is none.
        Readings at an end or beyond count as not measured.
    name : str
        Set by the model.

    Examples
    --------
    >>> bs.sdof(k=bs.Signal(value=40.0, lower=10.0, upper=90.0), b=0.8).parameters[0].upper
    90.0
    """

    refusal: ClassVar[type[BacksightError]] = ModelError

    unit: str = ""
    value: float = 0.0
    scale: Positive | None = None
    lower: Unlimited = -math.inf
    upper: Unlimited = math.inf
    positive: bool = False
    position: float | None = None
    dummy: Unlimited | None = None
    wrap: Positive | None = None
    resolution: Positive | None = None
    saturation: tuple[Unlimited, Unlimited] | None = None
    name: str = ""

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        of = f" of '{self.name}'" if self.name else ""
        if sound("unit") and (printable(self.unit) != self.unit or {*self.unit} & {"\n", "\t"}):
            yield f"unit{of} has control characters: {self.unit!a}"
        if sound("saturation") and self.saturation is not None:
            low, high = self.saturation
            if not low < high:
                yield f"saturation{of} is {low} to {high}; give the lower end first"
        if not sound("lower", "upper", "value"):
            return
        if not self.lower < self.upper:
            yield f"bounds{of} are contradictory: {self.lower} to {self.upper}"
        elif not self.lower <= self.value <= self.upper:
            yield f"value{of} is {self.value}, outside its bounds {self.lower} to {self.upper}"


@dataclasses.dataclass(frozen=True)
class Virtual:
    """Quantities that no sensor measures, see `backsight.models.views.virtual`.

    Parameters
    ----------
    signals : tuple of Signal
    g : casadi.Function
        ``(x, u, p, w) -> (nz,)`` with the process noise w that is added to the rates of the states
        (in discrete time, to their next values).
    """

    signals: tuple[Signal, ...]
    g: ca.Function


def along(
    virtual: Virtual | None, symbols: Sequence[ca.SX], arguments: Sequence[ca.SX]
) -> Virtual | None:
    """Virtual outputs of a model of other variables: `symbols`, of which `arguments` are made."""
    if virtual is None:
        return None
    g = ca.Function("g", list(symbols), virtual.g.call(list(arguments)))
    return dataclasses.replace(virtual, g=g)


def signals(given: Mapping[str, object] | Sequence[Signal], kind: str) -> tuple[Signal, ...]:
    """Read ``{name: unit}``, ``{name: value}``, ``{name: (value, unit)}`` or ``{name: Signal}``."""
    if not isinstance(given, Mapping):
        for entry in given:
            if not isinstance(entry, Signal):
                raise ModelError(
                    f"{kind}s: give a dict of names, or Signals that have names; not {entry!r}"
                )
        return tuple(given)
    return tuple(dataclasses.replace(_signal(n, v, kind), name=n) for n, v in given.items())


def _signal(name: str, value: object, kind: str) -> Signal:
    match value:
        case Signal():
            return value
        case str():
            return Signal(unit=value)
        case int() | float() | np.number():
            return Signal(value=float(value))
        case (number, str() as unit):
            return Signal(unit=unit, value=float(number))
        case Mapping():
            known = [f.name for f in dataclasses.fields(Signal) if f.name != "name"]
            for key in value:
                if key not in known:
                    raise ModelError(f"{kind} '{name}' has no field '{key}': {nearest(key, known)}")
            return _of_table(value, f"{kind} '{name}'")
    raise ModelError(
        f"{kind} '{name}': give a unit, a value, (value, unit) or a Signal, not {value!r}"
    )


def _of_table(given: Mapping[str, Any], where: str) -> Signal:
    try:
        return Signal(**given)
    except ModelError as error:
        raise ModelError(f"{where}: {error.bare or error}") from None


def vector(given: ByName, of: Sequence[Signal], *, what: str, default: Array) -> Array:
    """One number per signal, from a mapping by name, a sequence, or one number for all.

    Names that a mapping leaves out take their `default`. Raises `ModelError` on unknown names and
    wrong lengths.
    """
    names = [s.name for s in of]
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                raise ModelError(f"{what} names '{name}': {nearest(name, names)}")
        return np.array([float(given.get(n, d)) for n, d in zip(names, default, strict=True)])
    values = np.asarray(given, float)
    if values.ndim == 0:
        return np.full(len(of), float(values))
    if values.shape != (len(of),):
        raise ModelError(
            f"{what} has the shape {values.shape}; one number is needed for each of "
            f"{', '.join(names)}"
        )
    return values


def traced(formulas: Callable[..., Any], *arguments: Any) -> Any:
    """Result of equations that are Python functions; those of NumPy may be used in them."""
    with warnings.catch_warnings():
        # CasADi announces that np.sin(x.q) will return another type; either is taken.
        warnings.filterwarnings("ignore", "(?s).*casadi", FutureWarning)
        return formulas(*arguments)


class Named:
    """Read-only access to the elements of a vector expression by attribute: ``x.v``, ``p.k``."""

    def __init__(self, kind: str, names: Iterable[str], vector: ca.SX) -> None:
        self._kind = kind
        self._entries = {n: vector[i] for i, n in enumerate(names)}

    def __getattr__(self, name: str) -> ca.SX:
        if name.startswith("__"):
            raise AttributeError(name)
        return self[name]

    def __getitem__(self, name: str) -> ca.SX:
        try:
            return self._entries[name]
        except KeyError:
            hint = nearest(name, self._entries)
            raise ModelError(f"the model has no {self._kind} '{name}': {hint}") from None
