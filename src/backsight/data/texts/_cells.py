"""Lines of a text, and cells of a line."""

import csv
import dataclasses
from collections.abc import Iterator


@dataclasses.dataclass(frozen=True)
class Line:
    """A line with its number, from 1 on, and where it begins in the content [bytes]."""

    number: int
    start: int
    text: str


def lines(
    content: bytes, *, start: int = 0, number: int = 1, stop: int | None = None
) -> Iterator[Line]:
    """Lines of the content one by one, from the byte `start` to `stop`."""
    end = len(content) if stop is None else stop
    while start < end:
        after = content.find(b"\n", start, end)
        after = end if after < 0 else after
        yield Line(number, start, content[start:after].decode(errors="replace").rstrip("\r"))
        start, number = after + 1, number + 1


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Cells without blanks and quotes around; None stands for blanks between them.

    A quote that is not closed in its line is a sign like any other: it does not swallow what
    follows.
    """
    line = line.strip("\r\n")
    if delimiter is None:
        return [cell.strip('"') for cell in line.split()]
    if line.count('"') % 2 or len(line) > csv.field_size_limit():
        return [cell.strip() for cell in line.split(delimiter)]
    rows = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    return [cell.strip() for cell in next(rows, [])]


def trimmed(cells: list[str]) -> list[str]:
    """Without the blank cell that a delimiter at the end of the line makes."""
    return cells[:-1] if cells and not cells[-1] else cells


def is_blank(line: str, delimiter: str | None = None) -> bool:
    """Whether nothing is in a line; one of tabs, in a table of tabs, is a row of missing cells."""
    return not line.strip(" \r\n\v\f" if delimiter == "\t" else None)
