"""What is around a structure: sensors, forces, and ground that moves."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, Self, TypeAlias, get_args

import numpy as np
import scipy

from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.structures.matrices._places import Place, Places
from backsight.models.structures.modal import SensorKind
from backsight.types import Array, Sparse

Accelerations: TypeAlias = Literal["absolute_acceleration", "relative_acceleration"]
"""Kinds of accelerations where the ground moves."""

ReducedKind: TypeAlias = Literal[SensorKind, Accelerations]
"""What a sensor measures; where the ground moves, an acceleration is absolute or relative to it."""


@dataclasses.dataclass(frozen=True)
class SensorRow:
    """A sensor of a structure.

    Parameters
    ----------
    kind : SensorKind
    weights : (n, 1) sparse array
        Of the coordinates.
    absolute : bool
        Whether it feels the acceleration of the ground, too.
    """

    kind: SensorKind
    weights: Sparse
    absolute: bool


@dataclasses.dataclass(frozen=True)
class Around:
    """Sensors by name; forces that are unknown, that are measured, and directions of the ground.

    Parameters
    ----------
    sensors : dict of SensorRow
    forces, inputs : dict of (n, 1) sparse array
    ground : dict of (n,) array
        Motion of the fixed coordinates, or of all if none is fixed.
    """

    sensors: Mapping[str, SensorRow]
    forces: Mapping[str, Sparse]
    inputs: Mapping[str, Sparse]
    ground: Mapping[str, Array]

    @classmethod
    def read(
        cls,
        places: Places,
        sensors: Mapping[str, tuple[ReducedKind, Place]],
        forces: Mapping[str, Place],
        inputs: Mapping[str, Place],
        ground: Mapping[str, Place],
    ) -> Self:
        """Find the places; raises `ModelError` naming who is nowhere."""
        twice = [name for name in ground if name in inputs]
        if twice:
            raise ModelError(f"'{twice[0]}' is an input and a motion of the ground")
        return cls(
            {k: _sensor(k, given, places, moved=bool(ground)) for k, given in sensors.items()},
            {k: places.weights(at, f"force '{k}'") for k, at in forces.items()},
            {k: places.weights(at, f"input '{k}'") for k, at in inputs.items()},
            {k: _direction(at, places, f"ground '{k}'") for k, at in ground.items()},
        )

    def loads(self) -> Sparse:
        """Where the forces act, the measured first, (n, k)."""
        columns = [*self.inputs.values(), *self.forces.values()]
        n = next(iter(self.sensors.values())).weights.shape[0]
        return scipy.sparse.csc_array(scipy.sparse.hstack(columns) if columns else (n, 0))


def feedthrough(
    around: Around, left: Array, moved: Mapping[str, Array]
) -> dict[str, dict[str, float]]:
    """What outputs take of forces and of the ground at once, sensor to input to factor.

    Parameters
    ----------
    left : (n, k) array
        Static deflection under the loads that the model has no states for.
    moved : dict of (n,) array
        Motion of all coordinates with the ground.
    """
    columns = dict(zip([*around.inputs, *around.forces], left.T, strict=True))
    found: dict[str, dict[str, float]] = {}
    for name, sensor in around.sensors.items():
        if sensor.kind in ("displacement", "strain"):
            felt = columns
        else:
            felt = moved if sensor.absolute else {}
        row = {k: float((sensor.weights.T @ shape).item()) for k, shape in felt.items()}
        found[name] = {k: value for k, value in row.items() if value}
    return found


def with_ground(model: Model, around: Around, length: str) -> Model:
    """Give the accelerations of the ground their unit."""
    unit = f"{length}/s2" if length else ""
    inputs = (
        dataclasses.replace(s, unit=unit) if s.name in around.ground else s for s in model.inputs
    )
    return dataclasses.replace(model, inputs=tuple(inputs))


def _sensor(
    name: str, given: tuple[ReducedKind, Place], places: Places, *, moved: bool
) -> SensorRow:
    match given:
        case (str() as kind, place):
            pass
        case _:
            raise ModelError(f"sensor '{name}' is {given!r}; give (kind, where)")
    kinds = [*get_args(SensorKind), *get_args(Accelerations)]
    if kind not in kinds:
        raise ModelError(f"sensor '{name}' is a '{kind}': {nearest(kind, kinds)}")
    if moved and kind == "acceleration":
        raise ModelError(
            f"sensor '{name}' is an acceleration, and the ground moves: say absolute_acceleration, "
            "what an accelerometer measures, or relative_acceleration, without the ground's"
        )
    plain: Any = "acceleration" if kind in get_args(Accelerations) else kind
    absolute = kind == "absolute_acceleration"
    return SensorRow(plain, places.weights(place, f"sensor '{name}'"), absolute)


def _direction(at: Place, places: Places, what: str) -> Array:
    """Motion of the ground at all coordinates; "UX" is 1 at every coordinate "node:UX"."""
    if isinstance(at, str) and at not in places.names:
        motion = np.array([float(name.rpartition(":")[2] == at) for name in places.names])
        if not motion.any():
            hint = "no coordinate is called so" if places.names else "the coordinates have no names"
            raise ModelError(f"{what} moves '{at}': {hint}, or ends with ':{at}'")
        return motion
    return places.weights(at, what).toarray().ravel()
