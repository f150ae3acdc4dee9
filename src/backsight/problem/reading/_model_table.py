"""What every kind of model in ``[model]`` has: a table, parameters, matrices in files."""

import abc
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from backsight.data.finite_elements import Matrix, read_matrix
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.problem.reading.tables import ShortTable, StrictTable


@dataclasses.dataclass(frozen=True)
class RestOfFile:
    """What the rest of the file says about the model.

    Parameters
    ----------
    inputs, outputs : dict
        Name to unit of the recording's columns.
    start : dict
        Values of the parameters that are estimated; they need not be in the model's table.
    folder : Path
        Of the problem file: paths are relative to it.
    virtual : dict
        Name to kind and place of what is wanted where no sensor is.
    """

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    start: Mapping[str, float]
    folder: Path
    virtual: Mapping[str, tuple[Any, Any]]


class ModelTable(StrictTable, abc.ABC):
    """The entries of ``[model]`` beside ``kind``."""

    has_places: ClassVar[bool] = False
    """Whether it is a structure, with sensors of a kind at a place."""

    @abc.abstractmethod
    def build(self, given: RestOfFile) -> Model:
        """Make the model; raises `ModelError` if it is described wrongly."""


class ParameterTable(ShortTable):
    """A known parameter; its value alone will do."""

    alone = "value"

    value: float
    unit: str = ""


def parameters_of(
    known: Mapping[str, ParameterTable], start: Mapping[str, float]
) -> dict[str, Signal]:
    """Known parameters as signals, those that are estimated with their start values."""
    fixed = {name: Signal(unit=entry.unit, value=entry.value) for name, entry in known.items()}
    unit = {name: signal.unit for name, signal in fixed.items()}
    return fixed | {name: Signal(unit.get(name, ""), value) for name, value in start.items()}


class MatrixTable(ShortTable):
    """A matrix in a file, and its name there; the path alone will do."""

    alone = "path"

    path: str
    name: str | None = None
    format: str | None = None


Rows = list[list[float]]

MatrixEntry = Rows | str | MatrixTable
"""Rows of numbers, or where they are."""


def matrix_of(given: MatrixEntry, folder: Path) -> Rows | Matrix:
    """Return rows as they are given, or read the file."""
    if isinstance(given, str):
        given = MatrixTable(path=given)
    if not isinstance(given, MatrixTable):
        return given
    form: Any = given.format  # which formats there are is the reader's own to say
    return read_matrix(folder / given.path, name=given.name, format=form)
