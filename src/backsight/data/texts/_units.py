"""Units in a text: a line of them under the names, or in brackets behind a name."""

import re
from collections.abc import Sequence

from backsight.units import PATTERN

_BRACKETS = re.compile(r"[(\[<]\s*(?P<unit>[^()\[\]<>]*)\s*[)\]>]")
_BEHIND = re.compile(r"(?P<name>.+?)\s*[(\[]\s*(?P<unit>[^()\[\]]*)\s*[)\]]\s*")
_BY = re.compile(r"(?P<name>.*?\S)(?: / | in )(?P<unit>\S+)\s*")
"""As on the axis of a plot: ``Force / kN``, ``Force in kN``."""


def units_of(cells: Sequence[str]) -> list[str] | None:
    """Units in a line, "" where there is none, or None if the line holds something else."""
    found = [_unit(cell) for cell in cells]
    units = [unit for unit in found if unit is not None]
    return units if len(units) == len(found) and any(units) else None


def _unit(cell: str) -> str | None:
    bracketed = _BRACKETS.fullmatch(cell)
    if bracketed:
        return "" if bracketed["unit"] in ("-", "1") else bracketed["unit"].strip()
    if cell in ("", "-", "1"):
        return ""
    return cell if PATTERN.fullmatch(cell) else None


def split(name: str) -> tuple[str, str]:
    """Name and unit of ``Current [A]`` or ``Current / A``; the unit is "" if there is none."""
    if behind := _BEHIND.fullmatch(name):
        return behind["name"], behind["unit"].strip()
    by = _BY.fullmatch(name)
    return (by["name"], by["unit"]) if by and PATTERN.fullmatch(by["unit"]) else (name, "")
