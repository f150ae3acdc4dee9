"""Rows of a small table in text: a line of names, then cells."""

import csv
from pathlib import Path

from backsight.errors import DataError

_SIGNS = (";", "\t", ",")


def rows_of(path: Path) -> list[dict[str, str]]:
    """Cells by the names in the first line, lower case; commas are decimal where ; parts cells.

    Raises
    ------
    DataError
        If the file cannot be read, or a row has more cells than there are names.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise DataError(f"there is no file '{path}'") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read the table '{path}': {error}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise DataError(f"{path} has no rows below a line of names")
    sign = next((sign for sign in _SIGNS if sign in lines[0]), " ")
    cells = list(csv.reader(lines, delimiter=sign, skipinitialspace=True))
    names = [name.strip().lower() for name in cells[0]]
    rows = []
    for number, row in enumerate(cells[1:], 2):
        if len(row) > len(names):
            raise DataError(f"{path}, row {number}: {len(row)} cells for {len(names)} names")
        filled = [cell.strip() for cell in row] + [""] * (len(names) - len(row))
        if sign == ";":
            filled = [_with_point(cell) for cell in filled]
        rows.append(dict(zip(names, filled, strict=True)))
    return rows


def number_in(row: dict[str, str], name: str, where: str) -> float:
    """Return the number in a cell."""
    try:
        return float(row[name])
    except ValueError:
        raise DataError(f"{where}: {name} is '{row[name]}', not a number") from None


def _with_point(cell: str) -> str:
    pointed = cell.replace(",", ".", 1)
    try:
        float(pointed)
    except ValueError:
        return cell
    return pointed
