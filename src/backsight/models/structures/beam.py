"""Beams by their modes: geometry or stiffness in, a linear model with unknown forces out."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from backsight.description import checked
from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.structures._beam_modes import BoundaryName, Shapes, shapes
from backsight.models.structures.modal import SENSORS, SensorKind, modal
from backsight.types import Array

AT_NODE = 1e-9
"""A deflection below this share of what a shape can reach is that of a vibration node."""

_SECTION = ("width", "thickness", "youngs_modulus", "density")
_DIRECT = ("bending_stiffness", "mass_per_length")


@checked(ModelError, only=("boundary",))
def beam(
    length: float,
    *,
    sensors: Mapping[str, tuple[SensorKind, float]],
    forces: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    virtual: Mapping[str, tuple[SensorKind, float]] | None = None,
    boundary: BoundaryName = "cantilever",
    modes: int = 3,
    damping: ArrayLike = 0.01,
    width: float | None = None,
    thickness: float | None = None,
    youngs_modulus: float | None = None,
    density: float | None = None,
    bending_stiffness: float | None = None,
    mass_per_length: float | None = None,
    tip_mass: float = 0.0,
    name: str = "beam",
) -> Model:
    r"""Build a uniform Euler-Bernoulli beam of its first modes.

    .. math::
        w(x, t) = \sum_i \varphi_i(x)\, q_i(t), \qquad
        \ddot q_i + 2 \zeta_i \omega_i \dot q_i + \omega_i^2 q_i = \sum_j \varphi_i(x_j) F_j,
        \qquad \omega_i = \frac{\lambda_i^2}{L^2} \sqrt{\frac{E I}{\rho A}}

    with mass-normalised shapes: :math:`\rho A \int \varphi_i^2 dx + m_{tip} \varphi_i(L)^2 = 1`.

    Parameters
    ----------
    length : float
        L [m].
    sensors : dict
        Name of the output to ``(kind, position [m])``; the kind is "displacement" [m], "velocity"
        [m/s], "acceleration" [m/s2] or "strain" [1], the strain of the surface on the side of
        positive deflection.
    forces : dict, optional
        Name to position [m] of every place where an unknown force may act. Each becomes a
        parameter with the value 0 [N]; an estimator finds it, or `augment` makes it a state.
    inputs : dict, optional
        Name to position [m] of the forces that are measured.
    virtual : dict, optional
        What is wanted where no sensor is, described like `sensors`; see `with_virtual`.
    boundary : {"cantilever", "pinned-pinned", "free-free", "clamped-clamped"}
        A cantilever is clamped at 0. The first two modes of a free beam are its translation and
        its rotation, at 0 Hz.
    modes : int
        Number of modes.
    damping : number or (modes,) array
        Ratio to critical damping.
    width, thickness, youngs_modulus, density : float
        Of a rectangular cross-section [m, m, Pa, kg/m3]; it bends about its width. Or give the two
        below.
    bending_stiffness, mass_per_length : float
        E I [N m2] and rho A [kg/m] of any cross-section; a strain sensor needs `thickness`, twice
        its distance from the neutral axis, too.
    tip_mass : float
        Mass at the free end of a cantilever [kg].
    name : str
        Shown in results.

    Returns
    -------
    Model
        States ``q1, q2, ..., q1_dot, q2_dot, ...`` in m sqrt(kg) and m sqrt(kg)/s.

    Raises
    ------
    ModelError
        If a size is not positive, a sensor or force is off the beam, a force is at a vibration node
        of all modes, or a sensor sees none of them.

    Notes
    -----
    `check_sampling` finds modes that are too fast for a sampling period.

    References
    ----------
    Blevins, "Formulas for Natural Frequency and Mode Shape", 1979, table 8-1.

    Examples
    --------
    >>> cantilever = beam(
    ...     0.405, width=0.025, thickness=0.003, youngs_modulus=65.9e9, density=7502.0,
    ...     damping=[0.030, 0.037, 0.119],
    ...     sensors={"s1": ("displacement", 0.245), "s2": ("strain", 0.02)},
    ...     forces={"F1": 0.125, "F2": 0.405},
    ... )
    >>> print(cantilever)
    beam (continuous)
    ├── states      q1, q2, q3, q1_dot, q2_dot, q3_dot
    ├── outputs     s1 [m], s2
    └── parameters  F1 = 0, F2 = 0
    """
    given = {
        "length": length,
        "width": width,
        "thickness": thickness,
        "youngs_modulus": youngs_modulus,
        "density": density,
        "bending_stiffness": bending_stiffness,
        "mass_per_length": mass_per_length,
    }
    section = _section({k: v for k, v in given.items() if v is not None})
    if not (math.isfinite(tip_mass) and tip_mass >= 0):
        raise ModelError(f"tip_mass is {tip_mass:g} kg; it must not be negative")
    mass = section.mass_per_length * length
    of = shapes(boundary, modes, tip=tip_mass / mass)
    speed = math.sqrt(section.bending_stiffness / section.mass_per_length)
    row, unknown = _Places(of, length, mass, section.thickness), forces or {}
    made = modal(
        (of.wavenumbers / length) ** 2 * speed / (2 * math.pi),
        damping=damping,
        sensors={k: row.sensor(f"sensor '{k}'", sensor) for k, sensor in sensors.items()},
        virtual={k: row.sensor(f"virtual '{k}'", v) for k, v in (virtual or {}).items()},
        forces={k: row.force(f"force '{k}'", x) for k, x in unknown.items()},
        inputs={k: row.force(f"input '{k}'", x) for k, x in (inputs or {}).items()},
        name=name,
    )
    placed = (dataclasses.replace(s, position=float(unknown[s.name])) for s in made.parameters)
    return dataclasses.replace(made, parameters=tuple(placed))


@dataclasses.dataclass(frozen=True)
class _Section:
    """E I [N m2], rho A [kg/m] and thickness [m]."""

    bending_stiffness: float
    mass_per_length: float
    thickness: float | None


def _section(given: Mapping[str, float]) -> _Section:
    bad = [f"{k} is {v:g}" for k, v in given.items() if not (math.isfinite(v) and v > 0)]
    if bad:
        raise ModelError(f"{', '.join(bad)}; sizes must be positive and finite")
    direct = [k for k in _DIRECT if k in given]
    by_section = [k for k in _SECTION if k in given and k != "thickness"]
    needed = _DIRECT if direct else _SECTION
    lacking = [k for k in needed if k not in given]
    if direct and by_section:
        raise ModelError(
            f"{direct[0]} and {by_section[0]} are both given; describe the cross-section either by "
            f"{', '.join(_SECTION)} or by {' and '.join(_DIRECT)}"
        )
    if lacking:
        raise ModelError(f"the cross-section lacks {', '.join(lacking)}")
    if direct:
        stiffness, mass = (given[k] for k in _DIRECT)
        return _Section(stiffness, mass, given.get("thickness"))
    width, thickness, youngs_modulus, density = (given[k] for k in _SECTION)
    stiffness = youngs_modulus * width * thickness**3 / 12
    return _Section(stiffness, density * width * thickness, thickness)


@dataclasses.dataclass(frozen=True)
class _Places:
    """Mass-normalised shapes at places of a beam."""

    of: Shapes
    length: float
    mass: float
    thickness: float | None

    def force(self, what: str, position: float) -> Array:
        row = self._row(what, position, 0)
        if not row.any():
            raise ModelError(
                f"{what} at {position:g} m moves no mode: it is at a vibration node of all; "
                "move it, or take more modes"
            )
        return row

    def sensor(self, what: str, given: tuple[SensorKind, float]) -> tuple[SensorKind, Array]:
        match given:
            case (str() as kind, position):
                pass
            case _:
                raise ModelError(f"{what} is {given!r}; give (kind, position)")
        if kind not in SENSORS:
            raise ModelError(f"{what} is a '{kind}': {nearest(kind, SENSORS)}")
        if kind != "strain":
            row = self._row(what, position, 0)
        elif self.thickness is None:
            raise ModelError(f"{what} is a strain; give the thickness of the beam")
        else:
            row = -self.thickness / 2 / self.length**2 * self._row(what, position, 2)
        if not row.any():
            raise ModelError(
                f"{what} at {position:g} m sees no mode: there is no {kind} there in any of them; "
                "move it"
            )
        return kind, row

    def _row(self, what: str, position: float, derivative: int) -> Array:
        if not isinstance(position, int | float | np.number) or not math.isfinite(position):
            raise ModelError(f"{what} is at {position!r}; give a position [m]")
        # A position computed as a sum may miss the end by rounding.
        if not -AT_NODE <= position / self.length <= 1 + AT_NODE:
            raise ModelError(
                f"{what} is at {position:g} m, off the beam, which goes from 0 to {self.length:g} m"
            )
        row = self.of.at(position / self.length, derivative=derivative)[0]
        size = self.of.size(derivative)
        return np.where(np.abs(row) > AT_NODE * size, row, 0.0) / math.sqrt(self.mass)
