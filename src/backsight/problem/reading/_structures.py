"""Kinds of models that are structures: by matrices, by modes, by geometry."""

import abc
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pydantic

from backsight.data.finite_elements import read_modes
from backsight.models.model import Model
from backsight.models.structures.beam import beam
from backsight.models.structures.matrices import reduced
from backsight.models.structures.modal import modal
from backsight.models.structures.second_order import second_order
from backsight.problem.reading._model_table import (
    MatrixEntry,
    MatrixTable,
    ModelTable,
    ParameterTable,
    RestOfFile,
    matrix_of,
    parameters_of,
)
from backsight.problem.reading.tables import StrictTable


class SensorTable(StrictTable):
    """What an output measures: displacement, velocity or acceleration, and where."""

    kind: str
    at: Any


class SecondOrderTable(ModelTable):
    """Mass, damping and stiffness matrices of numbers and formulas."""

    function = staticmethod(second_order)
    has_places: ClassVar[bool] = True

    mass: Any
    damping: Any
    stiffness: Any
    forces: dict[str, Any]
    outputs: dict[str, SensorTable]
    coordinates: dict[str, str] | None = None
    parameters: dict[str, ParameterTable] = pydantic.Field(default_factory=dict)
    name: str = "structure"

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        # Which kinds there are is the model's own to say.
        outputs: dict[str, Any] = {name: (s.kind, s.at) for name, s in self.outputs.items()}
        return type(self).function(
            self.mass,
            self.damping,
            self.stiffness,
            forces=self.forces,
            outputs=outputs,
            inputs=given.inputs,
            parameters=parameters_of(self.parameters, given.start),
            coordinates=self.coordinates,
            virtual=given.virtual,
            name=self.name,
        )


def _or_file(schema: dict[str, Any]) -> None:
    """Say in the schema of a table that the path of a file may stand for it, see `_places`."""
    table = dict(schema)
    schema.clear()
    schema["anyOf"] = [table, {"type": "string"}]


class StructureTable(ModelTable, abc.ABC):
    """Sensors, unknown forces and measured forces at places of a structure."""

    has_places: ClassVar[bool] = True
    function: ClassVar[Callable[..., Model]]

    sensors: dict[str, SensorTable] = pydantic.Field(min_length=1, json_schema_extra=_or_file)
    forces: dict[str, Any] = pydantic.Field(default_factory=dict, json_schema_extra=_or_file)
    inputs: dict[str, Any] = pydantic.Field(default_factory=dict, json_schema_extra=_or_file)
    damping: Any = None
    name: str | None = None

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        return type(self).function(**self.arguments(given.folder), virtual=given.virtual)

    def arguments(self, folder: Path) -> dict[str, Any]:
        """Return what the function takes; what the table leaves out has its default."""
        del folder  # everything is in the table
        values = {k: getattr(self, k) for k in type(self).model_fields}
        values |= {"sensors": {name: (at.kind, at.at) for name, at in self.sensors.items()}}
        return {k: v for k, v in values.items() if v is not None}


class BeamTable(StructureTable):
    """A uniform beam by its geometry; places are positions [m]."""

    function = staticmethod(beam)

    length: float
    boundary: str = "cantilever"
    modes: int = 3
    width: float | None = None
    thickness: float | None = None
    youngs_modulus: float | None = None
    density: float | None = None
    bending_stiffness: float | None = None
    mass_per_length: float | None = None
    tip_mass: float = 0.0


class ModalTable(StructureTable):
    """A structure by its modes; a place is a list of their shapes there, or in a file by name."""

    function = staticmethod(modal)

    frequencies: list[float] | str
    modal_masses: Any = None
    feedthrough: dict[str, dict[str, float]] | None = None
    length_unit: str = "m"
    force_unit: str = "N"

    def arguments(self, folder: Path) -> dict[str, Any]:
        """See `StructureTable.arguments`."""
        values = super().arguments(folder)
        if isinstance(self.frequencies, str):
            values["frequencies"] = read_modes(folder / self.frequencies)
        return values


class ReducedTable(StructureTable):
    """A structure by its matrices; a place is a coordinate by number or name, or weights."""

    function = staticmethod(reduced)

    mass: MatrixEntry
    stiffness: MatrixEntry
    modes: int
    damping_matrix: MatrixEntry | None = None
    rayleigh: list[float] | None = pydantic.Field(default=None, min_length=2, max_length=2)
    loss_factor: float | None = None
    fixed: list[int | str] = pydantic.Field(default_factory=list)
    constraints: list[dict[str, float]] | MatrixEntry | None = None
    ground: dict[str, Any] | None = None
    residual: str = "none"
    coordinates: list[str] | None = None
    length_unit: str = "m"
    force_unit: str = "N"

    def arguments(self, folder: Path) -> dict[str, Any]:
        """See `StructureTable.arguments`."""
        values = super().arguments(folder)
        for key in ("mass", "stiffness", "damping_matrix", "constraints"):
            if isinstance(values.get(key), str | MatrixTable):
                values[key] = matrix_of(values[key], folder)
        return values
