"""What a reader is asked for, and what it answers."""

import dataclasses
from collections.abc import Collection, Mapping
from typing import Literal

import numpy as np

from backsight.errors import DataError

Axis = Literal[0, 1]
"""Axis of a matrix along which time runs."""


@dataclasses.dataclass(frozen=True)
class TextForm:
    """How a text is written; None of a field is "see for yourself".

    Parameters
    ----------
    delimiter : str, optional
        Between cells; ``" "`` stands for any number of blanks.
    decimal, thousands : str, optional
        Signs in numbers.
    encoding : str, optional
        As Python calls it.
    header : int, optional
        Line with the names, from 1 on; 0 if there is none.
    skip_lines : int
        Lines to pass over at the top.
    missing : tuple of str or float
        Further cells that mean "not measured".
    """

    delimiter: str | None = None
    decimal: str | None = None
    thousands: str | None = None
    encoding: str | None = None
    header: int | None = None
    skip_lines: int = 0
    missing: tuple[str | float, ...] = ()

    def __post_init__(self) -> None:
        sign = self.delimiter
        if sign is not None and len(sign) != 1 and sign.strip(" "):
            raise DataError(f"delimiter is {sign!r}; give one sign, or blanks")


@dataclasses.dataclass(frozen=True)
class Request:
    """What is wanted of a file.

    Parameters
    ----------
    wanted : tuple of str
        Names of columns.
    clock : str, optional
        The one that holds time: its cells may be dates.
    time_format : str, optional
        How these are written, see `backsight.data.times.dates`.
    axis : 0 or 1, optional
        Axis of matrices along which time runs; None is "see for yourself".
    outside : collection of str
        Other files that it may read from.
    text : TextForm
    """

    wanted: tuple[str, ...]
    clock: str | None = None
    time_format: str | None = None
    axis: Axis | None = None
    outside: Collection[str] = ()
    text: TextForm = TextForm()


@dataclasses.dataclass(frozen=True)
class Listed:
    """A column that a file holds.

    Parameters
    ----------
    name : str
        By which it can be asked for.
    kind : {"numbers", "dates", "other"}
        Only numbers can be signals, only numbers and dates time.
    remark : str
        What it is if it is neither.
    """

    name: str
    kind: Literal["numbers", "dates", "other"] = "numbers"
    remark: str = ""

    @classmethod
    def of(cls, name: str, dtype: np.dtype | None) -> "Listed":
        """Judge a column by the type of its values."""
        match dtype.kind if dtype is not None else "O":
            case "f" | "i" | "u" | "b":
                return cls(name)
            case "M" | "m":
                return cls(name, "dates")
            case "c":
                return cls(name, "other", "complex numbers")
        return cls(name, "other", "text" if dtype is None or dtype.kind in "OSUT" else str(dtype))


@dataclasses.dataclass(frozen=True)
class Contents:
    """What a file holds of it.

    Parameters
    ----------
    columns : dict of (n,) arrays
        Numbers; the clock may be ``datetime64`` or ``timedelta64``.
    units : dict
        Of the columns of which the file says it.
    understood : str
        How the file was understood, where that could be seen otherwise; one line.
    time : (n,) array, optional
        Times of the samples [s] where the file has them without a column for them.
    begin : str
        Date of the zero of `time`.
    """

    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    understood: str = ""
    time: np.ndarray | None = None
    begin: str = ""
