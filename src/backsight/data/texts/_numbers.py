"""NumberForm as texts write them: decimal points and commas, thousands, words for missing ones."""

import dataclasses
import math
import re
from collections.abc import Iterable

from backsight.errors import DataError

NOT_MEASURED = (
    *("", "nan", "NaN", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "#N/A", "NaT"),
    *("null", "NULL", "Null", "None", "none", "<NA>", "nan(ind)", "-nan(ind)"),
    *("#DIV/0!", "#VALUE!", "#NUM!", "#REF!", "#NAME?", "#NULL!"),  # spreadsheets
    *("1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND", "1.#QNAN0", "-1.#IND00"),  # older Windows
)
"""Cells that mean "not measured"."""

TOO_LARGE = tuple(
    form
    for word in ("overload", "overflow", "overrange", "ovld", "ovl")
    for form in (word, word.upper(), word.title())
)
"""Cells of a channel beyond its range, where the value is not known either."""

MISSING = NOT_MEASURED + TOO_LARGE

_INFINITE = {"1.#INF": math.inf, "-1.#INF": -math.inf}
_CUT = re.compile(r"[+-]?1\.#[A-Z]+0*")
"""``1.#QNAN`` with fewer digits, ``1.#QO``: not a number, or infinite."""

_FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[dD]([+-]?\d+)|([+-]\d{3}))")
_SIGNS = str.maketrans("\u2212\u00a0\u2009\u202f\u2019", "-   '")
"""Typographic signs in numbers: minus, spaces and an apostrophe between thousands."""

_GROUPED = r"[+-]?\d{{1,3}}(?:{thousands}\d{{3}})+(?:{decimal}\d*)?(?:[eE][+-]?\d+)?"
_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
_BOTH = re.compile(r"[+-]?\d{1,3}(?:([.,' ])\d{3})+(?!\1)[.,]\d*")
_MANY = re.compile(r"[+-]?\d{1,3}(?:([.,' ])\d{3})(?:\1\d{3})+")
_EITHER = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}")


@dataclasses.dataclass(frozen=True)
class NumberForm:
    """Signs in numbers, and further words for missing ones."""

    decimal: str = "."
    thousands: str | None = None
    missing: tuple[str, ...] = MISSING

    def value(self, cell: str) -> float | None:
        """The number in a cell, NaN if it is missing, None if it is none."""
        if cell in self.missing:
            return math.nan
        if cell in _INFINITE:
            return _INFINITE[cell]
        cell = without_typography(cell)
        if self.thousands and self.thousands in cell:
            signs = {"thousands": re.escape(self.thousands), "decimal": re.escape(self.decimal)}
            if not re.fullmatch(_GROUPED.format(**signs), cell):
                return None
            cell = cell.replace(self.thousands, "")
        if self.decimal != ".":
            if "." in cell:
                return None
            cell = cell.replace(self.decimal, ".")
        if "_" in cell or not cell.isascii():
            return None
        try:
            return float(cell)
        except ValueError:
            return _rarely_written(cell)


def without_typography(cell: str) -> str:
    """A number without typographic signs."""
    return cell if cell.isascii() else cell.translate(_SIGNS)


def _rarely_written(cell: str) -> float | None:
    """Exponents of Fortran, and what is not a number on older Windows."""
    if _CUT.fullmatch(cell):
        return math.nan
    fortran = _FORTRAN.fullmatch(cell)
    return float(f"{fortran[1]}e{fortran[2] or fortran[3]}") if fortran else None


def is_numeric(cell: str) -> bool:
    """Whether a cell is a number by any signs, or a word for a missing one."""
    cell = without_typography(cell)
    return (
        NumberForm().value(cell) is not None
        or bool(_COMMA.fullmatch(cell))
        or bool(_BOTH.fullmatch(cell))
        or bool(_MANY.fullmatch(cell))
    )


def signs(cells: Iterable[str]) -> tuple[str, str | None]:
    """Decimal sign and sign of thousands by the cells of a file.

    A comma that three digits follow may be either: other cells, or the caller, must tell.

    Raises
    ------
    DataError
        If they do not, or contradict each other.
    """
    decimal: set[str] = set()
    thousands: set[str] = set()
    either: dict[str, str] = {}
    for cell in map(without_typography, cells):
        if match := _BOTH.fullmatch(cell):
            thousands.add(match[1])
            decimal.add(cell[max(cell.rfind("."), cell.rfind(","))])
        elif match := _MANY.fullmatch(cell):
            thousands.add(match[1])
        elif match := _EITHER.fullmatch(cell):
            either.setdefault(match[1], cell)
        elif _COMMA.fullmatch(cell):
            decimal.add(",")
        elif "." in cell and cell not in MISSING and NumberForm().value(cell) is not None:
            decimal.add(".")
    if not decimal and "." in either and not thousands & {"."}:
        decimal.add(".")  # what programs write by themselves
    if "," in either and not decimal and not thousands:
        cell = either[","]
        raise DataError(
            f"'{cell}' may be {cell.replace(',', '')} or {cell.replace(',', '.')}; say "
            'decimal = "," or thousands = ","'
        )
    thousands |= {sign for sign in either if decimal and sign not in decimal}
    if len(decimal) > 1 or len(thousands) > 1 or decimal & thousands:
        raise DataError('numbers have points and commas in several ways; say decimal = "." or ","')
    sign = decimal.pop() if decimal else "," if "." in thousands else "."
    return sign, thousands.pop() if thousands else None
