"""Which column of a file a signal comes from, and how it becomes physical."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np

from backsight.description import Description, Range, Sound
from backsight.errors import BacksightError, DataError, nearest
from backsight.types import Array
from backsight.units import conversion, convertible, is_unit

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
    factor : float, optional
        From the file's unit to `unit`. If not given, it follows from the two, if the file says its
        unit; 1.0 takes the numbers as they are.
    offset : float
        Added after `factor` [unit].
    delay : float
        By which the samples come late [s], see `backsight.data.remove_delays`.
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
    factor: Annotated[float, ANY] | None = None
    offset: Annotated[float, ANY] = 0.0
    delay: float = dataclasses.field(default=0.0, kw_only=True)
    remove_mean: bool = False

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if not sound("name") or not self.name:
            yield f"a column is given by its name in the file, not by {self.name!r}"
        for name, value in (("factor", self.factor), ("offset", self.offset)):
            if sound(name) and value is not None and not math.isfinite(value):
                yield f"{name} is {value}, not a finite number"

    def settled(self, found: str) -> "Column":
        """With a factor and an offset that also come from the file's unit, `found`, to `unit`.

        A unit that is given wins over one of the file to which there is no way.
        """
        if self.factor is not None or not found or not self.unit:
            return self
        if not convertible(found, self.unit):
            return self
        between = conversion(found, self.unit)
        if between.same:
            return self
        return dataclasses.replace(self, factor=between.factor, offset=self.offset + between.offset)

    def contradicts(self, found: str) -> bool:
        """Whether there is no way from the file's unit, `found`, to `unit`."""
        given = self.factor is None and self.unit and found
        return bool(given) and is_unit(self.unit) and not convertible(found, self.unit)

    def unit_by(self, found: str) -> str:
        """Unit of the signal: as given, or that of the file, `found`, if nothing is converted."""
        return self.unit or (found if self.factor in (None, 1.0) else "")

    def physical(self, raw: Array) -> Array:
        """Values of the signal [unit] from those in the file, (n,)."""
        factor = 1.0 if self.factor is None else self.factor
        same = factor == 1.0 and self.offset == 0.0
        values = raw if same else factor * raw + self.offset
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
