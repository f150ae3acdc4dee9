"""Which column of a file a signal comes from, and how it becomes physical."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np

from backsight.description import Description, Range, Sound
from backsight.errors import BacksightError, DataError, nearest
from backsight.types import Array

ANY = Range("be a number", infinite=True, missing=True)


@dataclasses.dataclass(frozen=True)
class Column(Description):
    """A column of a file: the signal is ``factor * column + offset``.

    Parameters
    ----------
    name : str
        Name in the file; ``group/name`` inside a structure or group, ``acc[2]`` for the third
        column of a matrix.
    unit : str
        Unit of the signal, after `factor`; if not given, that of the file, where it says one.
    factor : float
        From the file's unit to `unit`.
    offset : float
        Added after `factor` [unit].
    remove_mean : bool
        Subtract the mean over the samples that are kept.

    Raises
    ------
    DataError
        If the name is empty or a number is not finite.
    """

    refusal: ClassVar[type[BacksightError]] = DataError

    name: str
    unit: str = ""
    factor: Annotated[float, ANY] = 1.0
    offset: Annotated[float, ANY] = 0.0
    remove_mean: bool = False

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if not sound("name") or not self.name:
            yield f"a column is given by its name in the file, not by {self.name!r}"
        for name, value in (("factor", self.factor), ("offset", self.offset)):
            if sound(name) and not math.isfinite(value):
                yield f"{name} is {value}, not a finite number"

    def unit_by(self, found: str) -> str:
        """Unit of the signal: as given, or that of the file, `found`, if nothing is converted."""
        return self.unit or (found if self.factor == 1.0 else "")

    def physical(self, raw: Array) -> Array:
        """Values of the signal [unit] from those in the file, (n,)."""
        same = self.factor == 1.0 and self.offset == 0.0
        values = raw if same else self.factor * raw + self.offset
        if not self.remove_mean:
            return values
        known = values[np.isfinite(values)]
        return values - known.mean() if known.size else values


ColumnLike: TypeAlias = str | Column | Mapping[str, object]
"""A column name, a `Column`, or a mapping with the fields of one."""


def columns(given: Mapping[str, ColumnLike], kind: str) -> dict[str, Column]:
    """Read ``{signal: column name}``, ``{signal: Column}`` or ``{signal: {field: value}}``.

    Raises `DataError` naming the signal and the unknown or missing field.
    """
    return {signal: column(entry, f"{kind} '{signal}'") for signal, entry in given.items()}


def column(given: ColumnLike, where: str) -> Column:
    """Read one column; `where` says in messages whose it is."""
    match given:
        case Column():
            return given
        case str():
            return Column(given)
        case Mapping():
            known = [f.name for f in dataclasses.fields(Column)]
            for key in given:
                if key not in known:
                    raise DataError(f"{where} has no field '{key}': {nearest(key, known)}")
            if "name" not in given:
                raise DataError(f"{where} has no field 'name': give the column's name in the file")
            fields: dict[str, Any] = dict(given)
            return Column(**fields)
    raise DataError(f"{where}: give a column name, a Column or a mapping, not {given!r}")
