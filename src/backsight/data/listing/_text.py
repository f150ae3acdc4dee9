"""The table of the columns of a file."""

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from backsight.data.listing.found import FileColumn, FileColumns

_HEAD = ("column", "unit", "rate [Hz]", "minimum", "maximum", "missing")
_LONGEST = 40
"""Characters of a name beyond which its numbers go to a line of their own."""


def table_of(found: "FileColumns", width: int) -> str:
    """Return a line on the file and its clock, the table of signals, and what is no signal."""
    signals = found.signals
    rows = [_row(column) for column in signals]
    names = [row[0] for row in rows if len(row[0]) <= _LONGEST]
    lengths = [max(map(len, ["column", *names])), *_widths([row[1:] for row in rows])]
    lines = [*_wrapped(_on_the_file(found), width, ""), ""]
    if signals:
        lines.append(_line(_HEAD, lengths))
    for column, row in zip(signals, rows, strict=True):
        if len(row[0]) > lengths[0]:
            lines.append(row[0])
            row = ("", *row[1:])
        lines.append(_line(row, lengths))
        for remark in column.remarks:
            lines += _wrapped(remark, width, "    ")
    halves = (found.clock or "").split(" + ")
    others = [
        c for c in found.values() if c.kind != "numbers" and c.name not in (found.clock, *halves)
    ]
    if others:
        lines += ["", "No signals:"] if signals else ["No signals:"]
        for column in others:
            what = "; ".join(column.remarks) or column.kind
            lines += _wrapped(f"{column.name}: {what}", width, "    ")
    return "\n".join(lines)


def _on_the_file(found: "FileColumns") -> str:
    samples = max((c.samples for c in found.values()), default=0)
    parts = [f"{found.path.name}: {samples} rows", _on_the_clock(found)]
    parts += [f"begins {found.begin}"] if found.begin else []
    parts += found.remarks
    parts += [f"understood: {found.understood}"] if found.understood else []
    return "; ".join(parts)


def _on_the_clock(found: "FileColumns") -> str:
    if found.clock is None:
        asked = "no column looks like time, say the sampling period (dt)"
        return asked if found.told is None else f"{asked}: {found.told}, so dt = {found.told.dt:g}?"
    name = f"time '{found.clock}'" if found.clock else "with a time of its own"
    if not found.sure:
        name = f"'{found.clock}' rises evenly and may be time"
    factor = "" if found.factor == 1.0 else f" (factor {found.factor:g})"
    form = f' (time_format "{found.time_format}")' if found.time_format else ""
    if not found.dt > 0:
        return f"{name}{factor}{form}, which does not rise from row to row"
    return f"{name}{factor}{form}, every {found.dt:.9g} s ({1 / found.dt:.6g} Hz)"


def _row(column: "FileColumn") -> tuple[str, ...]:
    return (
        column.name,
        column.unit,
        _number(column.rate),
        _number(column.low),
        _number(column.high),
        str(column.missing) if column.missing else "",
    )


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(_HEAD[1:], *rows, strict=True)]


def _line(cells: Sequence[str], lengths: Sequence[int]) -> str:
    name, unit, *numbers = cells
    parts = [name.ljust(lengths[0]), unit.ljust(lengths[1])]
    parts += [cell.rjust(n) for cell, n in zip(numbers, lengths[2:], strict=True)]
    return "  ".join(parts).rstrip()


def _wrapped(text: str, width: int, indent: str) -> list[str]:
    return textwrap.wrap(
        text, max(width, 40), initial_indent=indent, subsequent_indent=f"{indent}  "
    )
