"""Vibrating structures from natural frequencies, damping ratios and mode shapes."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures.second_order import Motion, second_order
from backsight.types import Array

SensorKind: TypeAlias = Literal[Motion, "strain"]
"""What a sensor on a structure measures."""

SENSORS: dict[SensorKind, str | None] = {
    "displacement": "",
    "velocity": "/s",
    "acceleration": "/s2",
    "strain": None,
}
"""Kinds of sensors, and what their unit adds to that of the length (a strain has none)."""


FASTEST = 1e100
"""Above it squares of frequencies would leave the range of numbers [Hz]."""


def modal(
    frequencies: ArrayLike,
    *,
    damping: ArrayLike = 0.01,
    sensors: Mapping[str, tuple[SensorKind, ArrayLike]],
    forces: Mapping[str, ArrayLike] | None = None,
    inputs: Mapping[str, ArrayLike] | None = None,
    virtual: Mapping[str, tuple[SensorKind, ArrayLike]] | None = None,
    modal_masses: ArrayLike = 1.0,
    length_unit: str = "m",
    force_unit: str = "N",
    name: str = "modes",
) -> Model:
    r"""Build a structure from its modes, measured or computed.

    .. math::
        \ddot q_i + 2 \zeta_i \omega_i \dot q_i + \omega_i^2 q_i
            = \frac{1}{m_i} \sum_j \varphi_i(x_j) F_j, \qquad w(x) = \sum_i \varphi_i(x)\, q_i

    Parameters
    ----------
    frequencies : (n,) array
        Undamped natural frequencies [Hz]; 0 for the motion of a rigid body.
    damping : number, (n,) array or (n, n) array
        Ratio of every mode to critical damping (or one for all); or the damping matrix
        :math:`\Phi' C \Phi` of mass-normalised modes [1/s], where modes are coupled by damping.
    sensors : dict
        Name of the output to ``(kind, shapes)``: "displacement", "velocity" or "acceleration" with
        the deflection of every mode at the sensor, (n,), or "strain" with the strain that a unit of
        every modal coordinate makes there.
    forces : dict, optional
        Name of every force that is not known to the deflections of the modes where it acts, (n,).
        It becomes a parameter with the value 0; an estimator finds it, or `augment` makes it a
        state.
    inputs : dict, optional
        The same for the forces that are measured.
    virtual : dict, optional
        What is wanted where no sensor is, described like `sensors`; see `with_virtual`.
    modal_masses : number or (n,) array
        Of the shapes as they are scaled; 1 for mass-normalised shapes.
    length_unit, force_unit : str
        For labels. Any consistent set of units will do.
    name : str
        Shown in results.

    Returns
    -------
    Model
        States ``q1, q2, ..., q1_dot, q2_dot, ...``.

    Raises
    ------
    ModelError
        If sizes do not fit, a number is out of range, a sensor sees no mode or a force moves none.

    Examples
    --------
    Two modes from a hammer test, an accelerometer at the tip, an unknown force in the middle:

    >>> arm = modal(
    ...     [12.1, 75.8], damping=[0.01, 0.02],
    ...     sensors={"a": ("acceleration", [2.0, -2.0])}, forces={"F": [0.7, 1.4]},
    ... )
    >>> print(arm)
    modes (continuous)
    ├── states      q1, q2, q1_dot, q2_dot
    ├── outputs     a [m/s2]
    └── parameters  F = 0
    """
    hertz = np.atleast_1d(_numbers(frequencies, "frequencies"))
    if hertz.ndim != 1 or not hertz.size or (hertz < 0).any():
        raise ModelError(f"frequencies is {frequencies}; give one number >= 0 [Hz] for every mode")
    n = len(hertz)
    masses = _per_mode(modal_masses, n, "modal_masses")
    if not (masses > 0).all():
        raise ModelError(f"modal_masses is {modal_masses}; every one must be positive")
    if hertz.max() > FASTEST:
        raise ModelError(f"a frequency is {hertz.max():g} Hz; no structure moves so fast")
    omega = 2 * np.pi * hertz
    unknown = {k: _shape(v, n, f"force '{k}'") for k, v in (forces or {}).items()}
    known = {k: _shape(v, n, f"input '{k}'") for k, v in (inputs or {}).items()}
    seen = {k: _sensor(f"sensor '{k}'", given, n) for k, given in sensors.items()}
    wanted = {k: _sensor(f"virtual '{k}'", given, n) for k, given in (virtual or {}).items()}
    for what, shape in {
        **{f"sensor '{k}' sees no mode": shape for k, (_, shape) in seen.items()},
        **{f"virtual '{k}' sees no mode": shape for k, (_, shape) in wanted.items()},
        **{f"force '{k}' moves no mode": shape for k, shape in unknown.items()},
        **{f"input '{k}' moves no mode": shape for k, shape in known.items()},
    }.items():
        if not shape.any():
            raise ModelError(f"{what}: all its shapes are zero; move it, or take more modes")
    model = second_order(
        np.eye(n),
        _damping_matrix(damping, omega),
        np.diag(omega**2),
        forces={k: shape / masses for k, shape in (known | unknown).items()},
        inputs=dict.fromkeys(known, force_unit),
        parameters=dict.fromkeys(unknown, (0.0, force_unit)),
        outputs={k: (_motion(kind), shape) for k, (kind, shape) in seen.items()},
        virtual={k: (_motion(kind), shape) for k, (kind, shape) in wanted.items()},
        name=name,
    )
    units = [_unit(kind, length_unit) for kind, _ in seen.values()]
    made = dataclasses.replace(model, outputs=_with_units(model.outputs, units))
    if made.virtual is None:
        return made
    units = [_unit(kind, length_unit) for kind, _ in wanted.values()]
    signals = _with_units(made.virtual.signals, units)
    return dataclasses.replace(made, virtual=dataclasses.replace(made.virtual, signals=signals))


def _sensor(what: str, given: tuple[SensorKind, ArrayLike], n: int) -> tuple[SensorKind, Array]:
    match given:
        case (str() as kind, shape):
            pass
        case _:
            raise ModelError(f"{what} is {given!r}; give (kind, where)")
    if kind not in SENSORS:
        raise ModelError(f"{what} is a '{kind}': {nearest(kind, SENSORS)}")
    return kind, _shape(shape, n, what)


def _shape(given: ArrayLike, n: int, what: str) -> Array:
    shape = np.atleast_1d(_numbers(given, f"the shapes of {what}"))
    if shape.shape != (n,):
        raise ModelError(f"the shapes of {what} have the size {shape.shape}; {n} modes need ({n},)")
    return shape


def _damping_matrix(damping: ArrayLike, omega: Array) -> Array:
    n, given = len(omega), _numbers(damping, "damping")
    if given.ndim == 2:
        if given.shape != (n, n):
            raise ModelError(f"damping has the shape {given.shape}; {n} modes need {(n, n)}")
        return given
    ratios = _per_mode(given, n, "damping")
    for i in np.flatnonzero((ratios < 0) | (ratios >= 1)):
        raise ModelError(
            f"the damping ratio of mode {i + 1} is {ratios[i]:g}; it must be from 0 to below 1"
        )
    return np.diag(2 * ratios * omega)


def _per_mode(given: ArrayLike, n: int, what: str) -> Array:
    values = _numbers(given, what)
    if values.shape not in ((), (n,)):
        raise ModelError(
            f"{what} has the size {values.shape}; give one number, or {n}, one per mode"
        )
    return np.broadcast_to(values, (n,))


def _numbers(given: ArrayLike, what: str) -> Array:
    try:
        values = np.asarray(given, float)
    except (OverflowError, TypeError, ValueError):
        raise ModelError(f"{what} must be numbers, not {given!r}") from None
    if not np.isfinite(values).all():
        raise ModelError(f"{what} has an entry that is not finite")
    return values


def _motion(kind: SensorKind) -> Motion:
    return "displacement" if kind == "strain" else kind


def _unit(kind: SensorKind, length: str) -> str:
    ends = SENSORS[kind]
    return "" if ends is None or not length else length + ends


def _with_units(group: Sequence[Signal], units: Sequence[str]) -> tuple[Signal, ...]:
    return tuple(dataclasses.replace(s, unit=u) for s, u in zip(group, units, strict=True))
