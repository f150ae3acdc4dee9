"""Vibrating structures from natural frequencies, damping ratios and mode shapes."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from backsight.data.finite_elements import ModeShapes
from backsight.errors import DataError, ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures.second_order import Motion, second_order
from backsight.models.views.virtual import built_with_virtual
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


Shape: TypeAlias = ArrayLike | str | Mapping[str, float]
"""Deflection of every mode; of modes from a file, a coordinate or coordinates to weights."""

DAMPING = 0.01
"""Ratio to critical damping where nothing says it."""

FASTEST = 1e100
"""Above it squares of frequencies would leave the range of numbers [Hz]."""


def modal(
    frequencies: ArrayLike | ModeShapes,
    *,
    damping: ArrayLike | None = None,
    sensors: Mapping[str, tuple[SensorKind, Shape]],
    forces: Mapping[str, Shape] | None = None,
    inputs: Mapping[str, Shape] | None = None,
    virtual: Mapping[str, tuple[SensorKind, Shape]] | None = None,
    modal_masses: ArrayLike | None = None,
    feedthrough: Mapping[str, Mapping[str, float]] | None = None,
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
    frequencies : (n,) array or ModeShapes
        Undamped natural frequencies [Hz]; 0 for the motion of a rigid body. Or modes from a file
        (`read_modes`), which may bring damping and modal masses, too.
    damping : number, (n,) array or (n, n) array
        Ratio of every mode to critical damping (or one for all); or the damping matrix
        :math:`\Phi' C \Phi` of mass-normalised modes [1/s], where modes are coupled by damping.
        0.01 if nothing says it.
    sensors : dict
        Name of the output to ``(kind, shapes)``: "displacement", "velocity" or "acceleration" with
        the deflection of every mode at the sensor, (n,), or "strain" with the strain that a unit of
        every modal coordinate makes there. Of modes from a file, the name of a coordinate will do,
        or ``{coordinate: weight}``.
    forces : dict, optional
        Name of every force that is not known to the deflections of the modes where it acts, (n,).
        It becomes a parameter with the value 0; an estimator finds it, or `augment` makes it a
        state.
    inputs : dict, optional
        The same for the forces that are measured.
    virtual : dict, optional
        What is wanted where no sensor is, described like `sensors`; see `with_virtual`.
    modal_masses : number or (n,) array
        Of the shapes as they are scaled; 1 for mass-normalised shapes, and if nothing says it.
    feedthrough : dict of dict, optional
        What a sensor takes of a force at once, beside the modes: name of the output to name of the
        force to factor. Of a displacement it is the residual flexibility, the static deflection
        that modes above the given ones would make [length/force].
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
    if virtual:

        def seeing(sensors: Mapping[str, tuple[SensorKind, Shape]]) -> Model:
            return modal(
                frequencies,
                damping=damping,
                sensors=sensors,
                forces=forces,
                inputs=inputs,
                modal_masses=modal_masses,
                feedthrough=feedthrough,
                length_unit=length_unit,
                force_unit=force_unit,
                name=name,
            )

        return built_with_virtual(seeing, sensors, virtual)
    if isinstance(frequencies, ModeShapes):
        modes, at = frequencies, frequencies.at
        return modal(
            modes.frequencies,
            damping=modes.damping if damping is None else damping,
            sensors={k: (kind, _found(at, v, f"sensor '{k}'")) for k, (kind, v) in sensors.items()},
            forces={k: _found(at, v, f"force '{k}'") for k, v in (forces or {}).items()},
            inputs={k: _found(at, v, f"input '{k}'") for k, v in (inputs or {}).items()},
            modal_masses=modes.modal_masses if modal_masses is None else modal_masses,
            feedthrough=feedthrough,
            length_unit=length_unit,
            force_unit=force_unit,
            name=name,
        )
    hertz = np.atleast_1d(_numbers(frequencies, "frequencies"))
    if hertz.ndim != 1 or not hertz.size or (hertz < 0).any():
        raise ModelError(f"frequencies is {frequencies}; give one number >= 0 [Hz] for every mode")
    n = len(hertz)
    masses = _per_mode(1.0 if modal_masses is None else modal_masses, n, "modal_masses")
    if not (masses > 0).all():
        raise ModelError(f"modal_masses is {modal_masses}; every one must be positive")
    if hertz.max() > FASTEST:
        raise ModelError(f"a frequency is {hertz.max():g} Hz; no structure moves so fast")
    omega = 2 * np.pi * hertz
    unknown = {k: _shape(v, n, f"force '{k}'") for k, v in (forces or {}).items()}
    known = {k: _shape(v, n, f"input '{k}'") for k, v in (inputs or {}).items()}
    seen = {k: _sensor(k, given, n) for k, given in sensors.items()}
    for what, shape in {
        **{f"sensor '{k}' sees no mode": shape for k, (_, shape) in seen.items()},
        **{f"force '{k}' moves no mode": shape for k, shape in unknown.items()},
        **{f"input '{k}' moves no mode": shape for k, shape in known.items()},
    }.items():
        if not shape.any():
            raise ModelError(f"{what}: all its shapes are zero; move it, or take more modes")
    model = second_order(
        np.eye(n),
        _damping_matrix(DAMPING if damping is None else damping, omega),
        np.diag(omega**2),
        forces={k: shape / masses for k, shape in (known | unknown).items()},
        inputs=dict.fromkeys(known, force_unit),
        parameters=dict.fromkeys(unknown, (0.0, force_unit)),
        outputs={k: (_motion(kind), shape) for k, (kind, shape) in seen.items()},
        name=name,
    )
    units = [output_unit(kind, length_unit) for kind, _ in seen.values()]
    model = dataclasses.replace(model, outputs=_with_units(model.outputs, units))
    return _fed_through(model, feedthrough or {})


def _fed_through(model: Model, given: Mapping[str, Mapping[str, float]]) -> Model:
    """Add to outputs what they take of inputs and parameters at once."""
    if not any(given.values()):
        return model
    x, u, p = (
        ca.SX.sym(k, n)
        for k, n in zip("xup", (model.nx, model.nu, len(model.parameters)), strict=True)
    )
    felt = {s.name: u[i] for i, s in enumerate(model.inputs)}
    felt |= {s.name: p[i] for i, s in enumerate(model.parameters)}
    rows = dict(zip([s.name for s in model.outputs], ca.vertsplit(model.h(x, u, p)), strict=True))
    for output, terms in given.items():
        if output not in rows:
            raise ModelError(f"feedthrough names the sensor '{output}': {nearest(output, rows)}")
        for force, factor in terms.items():
            if force not in felt:
                raise ModelError(
                    f"feedthrough of '{output}' names the force '{force}': {nearest(force, felt)}"
                )
            rows[output] += float(_numbers(factor, f"feedthrough of '{output}'")) * felt[force]
    return dataclasses.replace(model, h=ca.Function("h", [x, u, p], [ca.vertcat(*rows.values())]))


def _found(at: Callable[[str | Mapping[str, float]], Array], place: Shape, what: str) -> ArrayLike:
    if not isinstance(place, str | Mapping):
        return place
    try:
        return at(place)
    except DataError as error:
        raise ModelError(f"{what}: {error}") from None


def _sensor(name: str, given: tuple[SensorKind, Shape], n: int) -> tuple[SensorKind, Array]:
    match given:
        case (str() as kind, shape):
            pass
        case _:
            raise ModelError(f"sensor '{name}' is {given!r}; give (kind, where)")
    if kind not in SENSORS:
        raise ModelError(f"sensor '{name}' is a '{kind}': {nearest(kind, SENSORS)}")
    return kind, _shape(shape, n, f"sensor '{name}'")


def _shape(given: Shape, n: int, what: str) -> Array:
    if isinstance(given, str | Mapping):
        raise ModelError(f"{what} is at {given!r}: only modes from a file have coordinates")
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


def output_unit(kind: SensorKind, length: str) -> str:
    """Unit of what a sensor of a kind measures, by that of lengths."""
    ends = SENSORS[kind]
    return "" if ends is None or not length else length + ends


def _with_units(group: Sequence[Signal], units: Sequence[str]) -> tuple[Signal, ...]:
    return tuple(dataclasses.replace(s, unit=u) for s, u in zip(group, units, strict=True))
