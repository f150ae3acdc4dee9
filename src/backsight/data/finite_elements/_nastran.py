"""Matrices of Nastran: DMIG entries of bulk data and punch files."""

import re
from collections.abc import Iterator
from pathlib import Path

from backsight.data.finite_elements.matrix import Matrix, of_places, precision_of
from backsight.errors import DataError, nearest

_SQUARE, _SYMMETRIC = 1, 6
"""Forms of matrices that structures have."""

_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d+)$")
"""Nastran leaves out the E of 1.5+6."""


def read_dmig(path: Path, name: str | None) -> Matrix:
    """Read one matrix; `name` chooses among several, such as ``KAAX`` and ``MAAX``.

    Source: MSC Nastran Quick Reference Guide, entry DMIG: fields of 8 or 16 characters or with
    commas; of a symmetric matrix each entry stands for its mirror image, too.
    """
    cards: dict[str, list[list[str]]] = {}
    for fields in _cards(path):
        cards.setdefault(fields[0], []).append(fields)
    if not cards:
        raise DataError(f"{path} has no entry DMIG")
    if name is None and len(cards) > 1:
        raise DataError(f"{path} has the matrices {', '.join(cards)}; say which by name")
    name = name or next(iter(cards))
    if name not in cards:
        raise DataError(f"{path} has no matrix '{name}': {nearest(name, cards)}")
    heads = [fields for fields in cards[name] if fields[1] == "0"]
    if len(heads) != 1:
        raise DataError(f"{path}: DMIG {name} has {len(heads)} header entries; it needs one")
    form, kind = _whole(heads[0][2]), _whole(heads[0][3])
    if form not in (_SQUARE, _SYMMETRIC):
        raise DataError(f"{path}: DMIG {name} is of the form {form}, not square (1 or 6)")
    if kind not in (1, 2):
        raise DataError(f"{path}: DMIG {name} is complex")
    rows, columns, values, written = [], [], [], []
    for fields in cards[name]:
        if fields[1] == "0":
            continue
        column = (_whole(fields[1]), _whole(fields[2] or "0"))
        for k in range(4, len(fields), 4):
            entry = [*fields[k : k + 4], "", "", ""]
            if not entry[0]:
                continue
            rows.append((_whole(entry[0]), _whole(entry[1] or "0")))
            columns.append(column)
            values.append(_real(entry[2]))
            written.append(entry[2])
    return of_places(
        rows,
        columns,
        values,
        precision=precision_of(written),
        name=name,
        mirrored=form == _SYMMETRIC,
    )


def _cards(path: Path) -> Iterator[list[str]]:
    """Fields of every DMIG with its continuations: name, then what follows."""
    card: list[str] = []
    for line in path.read_text(encoding="latin-1").splitlines():
        line = line.split("$")[0].expandtabs(8).rstrip()
        if not line:
            continue
        first = (line.split(",")[0] if "," in line else line[:8]).strip().upper()
        goes_on = card and (first.startswith(("*", "+")) or not first)
        if not goes_on:
            if card:
                yield card
            card = []
        if goes_on or first in ("DMIG", "DMIG*"):
            card += _fields(line, wide=first.endswith("*") or first.startswith("*"))
    if card:
        yield card


def _fields(line: str, *, wide: bool) -> list[str]:
    many = 4 if wide else 8
    if "," in line:
        found = [part.strip() for part in line.split(",")[1 : many + 1]]
    else:
        width = 16 if wide else 8
        found = [line[8 + i * width : 8 + (i + 1) * width].strip() for i in range(many)]
    return [*found, *[""] * (many - len(found))]


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise DataError(f"DMIG: '{text}' is not a whole number") from None


def _real(text: str) -> float:
    try:
        return float(_EXPONENT.sub(r"E\1", text.upper().replace("D", "E")))
    except ValueError:
        raise DataError(f"DMIG: '{text}' is not a number") from None
