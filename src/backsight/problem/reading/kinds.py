"""The table ``[model]``: one entry of `KINDS` for every kind of model."""

import abc
import dataclasses
import inspect
import typing
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import pydantic

from backsight.errors import ModelError, ProblemError
from backsight.models.builtin import duffing, friction_drive, sdof
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures.beam import beam
from backsight.models.structures.modal import modal
from backsight.models.structures.reduced import reduced
from backsight.models.structures.second_order import second_order
from backsight.models.text.equations import from_equations
from backsight.plugins import Extended
from backsight.problem.reading.tables import ShortTable, StrictTable

Matrix = list[list[float]]


@dataclasses.dataclass(frozen=True)
class RestOfFile:
    """What the rest of the file says about the model.

    Parameters
    ----------
    inputs, outputs : dict
        Name to unit of the recording's columns.
    start : dict
        Values of the parameters that are estimated; they need not be in the model's table.
    """

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    start: Mapping[str, float]


class ModelTable(StrictTable, abc.ABC):
    """The entries of ``[model]`` beside ``kind``."""

    @abc.abstractmethod
    def build(self, given: RestOfFile) -> Model:
        """Make the model; raises `ModelError` if it is described wrongly."""


class BuiltinTable(ModelTable):
    """The arguments of a function that makes a model, all by name."""

    function: ClassVar[Callable[..., Model]]

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        arguments = inspect.signature(type(self).function).parameters
        values = self.model_dump(exclude_unset=True)
        values |= {name: value for name, value in given.start.items() if name in arguments}
        for name, argument in arguments.items():
            if argument.default is argument.empty and name not in values:
                raise ProblemError(
                    f"model.{name}: is missing; give its value, or estimate it: [estimate.{name}]"
                )
        return type(self).function(**values)


class ParameterTable(ShortTable):
    """A known parameter; its value alone will do."""

    alone = "value"

    value: float
    unit: str = ""


class EquationsTable(ModelTable):
    """Equations as text: the rate of every state, and the outputs."""

    states: dict[str, str]
    equations: dict[str, str]
    outputs: dict[str, str]
    parameters: dict[str, ParameterTable] = pydantic.Field(default_factory=dict)
    dt: float | None = None
    name: str = "model"

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        return from_equations(
            states=self.states,
            inputs=given.inputs,
            outputs={name: given.outputs.get(name, "") for name in self.outputs},
            parameters=_parameters(self.parameters, given.start),
            equations=self.equations,
            output_equations=self.outputs,
            dt=self.dt,
            name=self.name,
        )


class LtiTable(ModelTable):
    """Matrices of a linear model."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix | None = None
    states: dict[str, str]
    dt: float | None = None
    name: str = "lti"

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        return lti(
            self.A,
            self.B,
            self.C,
            self.D,
            states=self.states,
            inputs=given.inputs,
            outputs=given.outputs,
            dt=self.dt,
            name=self.name,
        )


class SensorTable(StrictTable):
    """What an output measures: displacement, velocity or acceleration, and where."""

    kind: str
    at: Any


class SecondOrderTable(ModelTable):
    """Mass, damping and stiffness matrices of numbers and formulas."""

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
        return second_order(
            self.mass,
            self.damping,
            self.stiffness,
            forces=self.forces,
            outputs=outputs,
            inputs=given.inputs,
            parameters=_parameters(self.parameters, given.start),
            coordinates=self.coordinates,
            name=self.name,
        )


class StructureTable(ModelTable, abc.ABC):
    """Sensors, unknown forces and measured forces at places of a structure."""

    function: ClassVar[Callable[..., Model]]

    sensors: dict[str, SensorTable] = pydantic.Field(min_length=1)
    forces: dict[str, Any] = pydantic.Field(default_factory=dict)
    inputs: dict[str, Any] = pydantic.Field(default_factory=dict)
    damping: Any = None
    name: str | None = None

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        del given  # everything is in the table
        values = {k: getattr(self, k) for k in type(self).model_fields}
        values |= {"sensors": {name: (at.kind, at.at) for name, at in self.sensors.items()}}
        return type(self).function(**{k: v for k, v in values.items() if v is not None})


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
    """A structure by its modes; a place is a list of their shapes there."""

    function = staticmethod(modal)

    frequencies: list[float]
    modal_masses: Any = 1.0
    length_unit: str = "m"
    force_unit: str = "N"


class ReducedTable(StructureTable):
    """A structure by its matrices; a place is the number of a coordinate, or weights."""

    function = staticmethod(reduced)

    mass: Matrix
    stiffness: Matrix
    modes: int
    damping_matrix: Matrix | None = None
    length_unit: str = "m"
    force_unit: str = "N"


def _parameters(
    known: Mapping[str, ParameterTable], start: Mapping[str, float]
) -> dict[str, Signal]:
    fixed = {name: Signal(unit=entry.unit, value=entry.value) for name, entry in known.items()}
    unit = {name: signal.unit for name, signal in fixed.items()}
    return fixed | {name: Signal(unit.get(name, ""), value) for name, value in start.items()}


def _builtin(function: Callable[..., Model]) -> type[ModelTable]:
    arguments = inspect.signature(function).parameters.values()
    entries: dict[str, Any] = {
        a.name: (str if a.annotation is str else float, None) for a in arguments
    }
    table = pydantic.create_model(function.__name__, __base__=BuiltinTable, **entries)
    table.function = staticmethod(function)
    return table


KINDS: dict[str, type[ModelTable]] = {
    "equations": EquationsTable,
    "lti": LtiTable,
    "second_order": SecondOrderTable,
    "beam": BeamTable,
    "modal": ModalTable,
    "reduced": ReducedTable,
    **{function.__name__: _builtin(function) for function in (sdof, duffing, friction_drive)},
}
"""Every kind of model by the name that ``model.kind`` gives."""


def _adopted(kind: str, found: object) -> type[ModelTable]:
    """Somebody else's function that makes a model: its annotations say what a file may give."""
    if not callable(found):
        raise ModelError(f"it must be a function that returns a Model, not {found!r}")
    hints = typing.get_type_hints(found)
    untyped = [n for n in inspect.signature(found).parameters if n not in hints]
    if untyped:
        raise ModelError(f"{', '.join(untyped)}: an argument needs a type that a file can give")
    entries: dict[str, Any] = {
        name: (float if Signal in typing.get_args(hint) else hint, None)
        for name, hint in hints.items()
        if name != "return"
    }
    try:
        table = pydantic.create_model(kind, __base__=BuiltinTable, **entries)
    except pydantic.errors.PydanticUserError as error:
        reason = str(error).partition(".")[0]
        raise ModelError(f"an argument has a type that a file cannot give: {reason}") from None
    table.function = staticmethod(typing.cast(Callable[..., Model], found))
    return table


ALL_KINDS = Extended("backsight.models", "model", KINDS, _adopted)
"""Ours and those of installed extensions."""
