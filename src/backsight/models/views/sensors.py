"""Sensors between a model and its readings: range, low-pass, moment of reading, gain and zero."""

import dataclasses
import itertools
import math
from collections.abc import Mapping

import casadi as ca
import numpy as np

from backsight.description import (
    Count,
    Description,
    NonNegative,
    Positive,
    PositiveOrInfinite,
    Unlimited,
    checked,
)
from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import Signal, along
from backsight.models.views._linear_motion import LinearMotion, low_passed

ENDING, GAIN, OFFSET = "_sensor", "_gain", "_offset"
"""Of the name of the state that a low-pass adds, and of the parameters."""


@dataclasses.dataclass(frozen=True)
class Sensor(Description):
    """What is between an output and its readings, in this order.

    Parameters
    ----------
    limit : float
        What is beyond plus or minus this is not seen, and the low-pass is told the limit [unit of
        the output].
    cutoff : float
        Of a low-pass of the first order: the frequency at which it is 3 dB too small [Hz].
    late : float
        Time after the sample at which the channel is read [s]: converters that take one channel
        after the other. It needs the sampling period, see `with_sensors`.
    gain, offset : float, optional
        Reading over what it should be, and reading of nothing [unit of the output]: parameters
        ``"<output>_gain"`` and ``"<output>_offset"`` with these values, which `augment` makes
        unknown.

    Examples
    --------
    >>> bs.models.Sensor(limit=50.0, cutoff=45.0, offset=0.0).cutoff
    45.0
    """

    limit: PositiveOrInfinite = math.inf
    cutoff: PositiveOrInfinite = math.inf
    late: NonNegative = 0.0
    gain: Unlimited | None = None
    offset: Unlimited | None = None

    @property
    def slow(self) -> bool:
        """Whether it has a low-pass."""
        return math.isfinite(self.cutoff)

    def clipped(self, value: ca.SX) -> ca.SX:
        """Within the range."""
        if not math.isfinite(self.limit):
            return value
        return ca.fmax(ca.fmin(value, self.limit), -self.limit)


@checked(ModelError)
def with_sensors(
    model: Model,
    sensors: Mapping[str, Sensor],
    *,
    dt: Positive | None = None,
    parts: Count = 8,
) -> Model:
    r"""Read outputs through sensors.

    .. math:: \dot s_j = 2 \pi f_j \, (\mathrm{clip}(h_j(x, u, p), \pm l_j) - s_j), \qquad
        y_j(t) = g_j\, s_j(t + \tau_j) + b_j

    Where a sensor is clipped before its low-pass, as accelerometers are, the readings look like
    small, smooth and plausible accelerations while the sensor is at its limit most of the time.
    Estimators of nonlinear models know: at the limit a reading says nothing of the motion.

    Parameters
    ----------
    model : Model
        Continuous in time.
    sensors : dict
        Name of an output to its `Sensor`; outputs that are left out stay as they are.
    dt : float, optional
        Sampling period [s]. The model becomes one in discrete time: what it does itself, which has
        to be linear, is carried exactly from one of `parts` parts of a sample to the next, and
        limit and low-pass see straight lines in between. That is what channels that are read
        `late` need, and much faster than Runge-Kutta methods where modes are faster than samples.
    parts : int
        Parts of a sample, with `dt`.

    Returns
    -------
    Model
        With one more state for every low-pass, ``"<output>_sensor"``, and a parameter for every
        gain and offset; linear if the model is and no sensor has a limit.

    Raises
    ------
    ModelError
        If the model is in discrete time, a name is unknown or used, a sensor reads late and there
        is no `dt` or it reads later than that, or, with `dt`, the model is not linear in states,
        inputs and parameters, or has forces with dynamics or virtual sensors (add them afterwards).

    Examples
    --------
    >>> slow = bs.models.Sensor(cutoff=50.0, offset=0.0)
    >>> print(bs.models.with_sensors(bs.sdof(k=100.0, b=1.0), {"y": slow}))
    sdof (continuous)
    ├── states      q [m], v [m/s], y_sensor [m]
    ├── inputs      u [N]
    ├── outputs     y [m]
    └── parameters  k = 100, b = 1, c = 1, y_offset = 0
    """
    names = [s.name for s in model.outputs]
    for name in sensors:
        if name not in names:
            raise ModelError(f"sensors: the model has no output '{name}': {nearest(name, names)}")
    if not model.continuous:
        raise ModelError(
            "sensors need a model that is continuous in time: put them on before it is sampled"
        )
    chain = [sensors.get(name, Sensor()) for name in names]
    late = max(sensor.late for sensor in chain)
    if late and (dt is None or late > dt):
        period = "the sampling period dt is needed" if dt is None else f"a sample takes {dt:g} s"
        raise ModelError(f"a sensor reads {late:g} s late: {period}")
    places = _Places.of(model, chain)
    if dt is None:
        f, h = _continuous(model, chain, places)
    else:
        f, h = _sampled(model, chain, places, dt=dt, parts=parts)
    z, u, p, w = places.z, places.u, places.p, ca.SX.sym("w", places.z.numel())
    given = [places.x, u, p[: len(model.parameters)]]
    return dataclasses.replace(
        model,
        f=ca.Function("f", [z, u, p], [ca.densify(f)]),
        h=ca.Function("h", [z, u, p], [ca.densify(h)]),
        states=(*model.states, *places.states),
        parameters=(*model.parameters, *places.parameters),
        dt=dt,
        unsolved=model.unsolved_at([z, u, p], given),
        virtual=along(model.virtual, [z, u, p, w], [*given, w[: model.nx]]),
    )


@dataclasses.dataclass(frozen=True)
class _Places:
    """Symbols of all states, inputs and parameters, and which are whose.

    Parameters
    ----------
    z, u, p : SX
    x : SX
        The states of the model itself.
    slow : dict
        Number of an output with a low-pass to its state.
    factors : dict
        Number of an output to its gain and offset, expressions or numbers.
    states, parameters : tuple of Signal
        What is added to the model's.
    """

    z: ca.SX
    u: ca.SX
    p: ca.SX
    x: ca.SX
    slow: dict[int, ca.SX]
    factors: dict[int, tuple[ca.SX, ca.SX]]
    states: tuple[Signal, ...]
    parameters: tuple[Signal, ...]

    @staticmethod
    def of(model: Model, chain: list[Sensor]) -> "_Places":
        slow = [j for j, sensor in enumerate(chain) if sensor.slow]
        x, s = ca.SX.sym("x", model.nx), ca.SX.sym("s", len(slow))
        outputs = model.outputs
        states = [Signal(unit=outputs[j].unit, name=outputs[j].name + ENDING) for j in slow]
        added: list[Signal] = []
        factors: dict[int, tuple[ca.SX, ca.SX]] = {}
        known = ca.SX.sym("p", len(model.parameters))
        for j, sensor in enumerate(chain):
            ends = []
            for value, ending, plain in (
                (sensor.gain, GAIN, 1.0),
                (sensor.offset, OFFSET, 0.0),
            ):
                name, unit = outputs[j].name + ending, "" if ending == GAIN else outputs[j].unit
                ends.append(ca.SX(plain) if value is None else ca.SX.sym(name))
                if value is not None:
                    added.append(Signal(unit=unit, value=value, name=name))
            factors[j] = ends[0], ends[1]
        free = [e for pair in factors.values() for e in pair if e.is_symbolic()]
        read = dict(zip(slow, ca.vertsplit(s), strict=True)) if slow else {}
        return _Places(
            z=ca.vertcat(x, s),
            u=ca.SX.sym("u", model.nu),
            p=ca.vertcat(known, *free),
            x=x,
            slow=read,
            factors=factors,
            states=tuple(states),
            parameters=tuple(added),
        )

    def shown(self, seen: list[ca.SX]) -> ca.SX:
        """Readings of what the sensors have seen."""
        factors = (self.factors[j] for j in range(len(seen)))
        return ca.vertcat(*(g * y + b for y, (g, b) in zip(seen, factors, strict=True)))


def _continuous(model: Model, chain: list[Sensor], at: _Places) -> tuple[ca.SX, ca.SX]:
    """State and output equations."""
    given = [at.x, at.u, at.p[: len(model.parameters)]]
    rows = ca.vertsplit(model.h.call(given)[0])
    seen = _clipped(rows, chain)
    rates = [2 * np.pi * chain[j].cutoff * (seen[j] - s) for j, s in at.slow.items()]
    read = [at.slow.get(j, row) for j, row in enumerate(seen)]
    return ca.vertcat(model.f.call(given)[0], *rates), at.shown(read)


def _sampled(
    model: Model, chain: list[Sensor], at: _Places, *, dt: float, parts: int
) -> tuple[ca.SX, ca.SX]:
    """The same of a linear model in discrete time, from part to part of a sample."""
    motion = LinearMotion.of(model, at.u, at.p[: len(model.parameters)])
    moments = sorted({dt * k / parts for k in range(parts + 1)} | {k.late for k in chain})
    x, s = at.x, dict(at.slow)
    raw = _clipped(motion.seen(x), chain)
    read = [s.get(j, raw[j]) for j in range(len(chain))]
    for begin, end in itertools.pairwise(moments):
        x, before = motion.moved(x, end - begin), raw
        raw = _clipped(motion.seen(x), chain)
        for j in s:
            s[j] = low_passed(s[j], before[j], raw[j], 2 * np.pi * chain[j].cutoff * (end - begin))
        for j, sensor in enumerate(chain):
            if sensor.late == end:
                read[j] = s.get(j, raw[j])
    return ca.vertcat(x, *s.values()), at.shown(read)


def _clipped(rows: list[ca.SX], chain: list[Sensor]) -> list[ca.SX]:
    """Outputs within the ranges of their sensors."""
    return [sensor.clipped(row) for sensor, row in zip(chain, rows, strict=True)]
