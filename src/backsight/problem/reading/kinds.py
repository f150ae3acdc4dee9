"""The table ``[model]``: one entry of `KINDS` for every kind of model."""

import inspect
import typing
from collections.abc import Callable
from typing import Any, ClassVar

import pydantic

from backsight.errors import ModelError, ProblemError
from backsight.models.builtin import duffing, friction_drive, sdof
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.text.equations import from_equations
from backsight.plugins import Extended
from backsight.problem.reading._model_table import (
    MatrixEntry,
    ModelTable,
    ParameterTable,
    RestOfFile,
    matrix_of,
    parameters_of,
)
from backsight.problem.reading._structures import (
    BeamTable,
    ModalTable,
    ReducedTable,
    SecondOrderTable,
)


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


class EquationsTable(ModelTable):
    """Equations as text: the rate of every state, and the outputs.

    Parameters
    ----------
    states : dict
        Name to unit.
    outputs : dict
        Name to the formula; units are those of the columns.
    parameters : dict
        Name to value, or ``{ value = 1.0, unit = "kg" }``.
    """

    states: dict[str, str]
    equations: dict[str, str]
    outputs: dict[str, str]
    parameters: dict[str, ParameterTable] = pydantic.Field(default_factory=dict)
    algebraic: dict[str, str] = pydantic.Field(default_factory=dict)
    constraints: dict[str, str] = pydantic.Field(default_factory=dict)
    guesses: dict[str, str] = pydantic.Field(default_factory=dict)
    dt: float | None = None
    name: str = "model"

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        return from_equations(
            states=self.states,
            inputs=given.inputs,
            outputs={name: given.outputs.get(name, "") for name in self.outputs},
            parameters=parameters_of(self.parameters, given.start),
            equations=self.equations,
            output_equations=self.outputs,
            algebraic=self.algebraic,
            constraints=self.constraints,
            guesses=self.guesses,
            dt=self.dt,
            name=self.name,
        )


class LtiTable(ModelTable):
    """Matrices of a linear model, or the files that hold them."""

    A: MatrixEntry
    B: MatrixEntry
    C: MatrixEntry
    D: MatrixEntry | None = None
    states: dict[str, str]
    dt: float | None = None
    name: str = "lti"

    def build(self, given: RestOfFile) -> Model:
        """See `ModelTable.build`."""
        A, B, C = (matrix_of(entry, given.folder) for entry in (self.A, self.B, self.C))
        return lti(
            A,
            B,
            C,
            None if self.D is None else matrix_of(self.D, given.folder),
            states=self.states,
            inputs=given.inputs,
            outputs=given.outputs,
            dt=self.dt,
            name=self.name,
        )


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
