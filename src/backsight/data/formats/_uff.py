"""Universal files (UFF, UNV), by pyuff."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from backsight.data._pick import present
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_room
from backsight.data.formats.libraries import library
from backsight.data.times.grid import even_times
from backsight.errors import DataError


def read_uff(path: Path, request: Request) -> Contents:
    """Read functions of time (data sets 58) of a universal file, by number from 0 on or by name.

    Names are the first line of a set, or the label of its ordinate, where these are unique.
    """
    heads = _functions(path)
    named = _by_label(heads) | heads
    columns, units, clocks = {}, {}, []
    for name in present(request.wanted, named):
        head = named[name]
        if fault := _fault(head):
            raise DataError(f"'{name}' is {fault}")
        columns[name] = np.asarray(head["data"], float)
        unit = str(head.get("ordinate_axis_units_lab", "")).strip()
        units[name] = "" if unit == "NONE" else unit
        if int(head["abscissa_spacing"]) == 1:
            clocks.append((name, float(head["abscissa_min"]), float(head["abscissa_inc"])))
    uneven = [np.asarray(named[n]["x"], float) for n in columns if n not in {c[0] for c in clocks}]
    if uneven and (clocks or any(not np.array_equal(x, uneven[0]) for x in uneven)):
        raise DataError("the functions are at different times; read each by itself and merge them")
    return Contents(columns, units, time=uneven[0] if uneven else even_times(clocks, columns))


def list_uff(path: Path, _: Request) -> list[Listed]:
    """List the functions, by label where that is unique."""
    heads = _functions(path)
    labels: dict[str, str] = {}
    for label, number in _numbers_by_label(heads).items():
        labels.setdefault(number, label)  # the first line of the set before other names
    return [
        Listed(labels.get(number, number), "other" if (fault := _fault(head)) else "numbers", fault)
        for number, head in heads.items()
    ]


def _functions(path: Path) -> dict[str, dict[str, Any]]:
    """Data sets 58 by their numbers."""
    check_room(path.stat().st_size * 2, "the file")
    file = library("pyuff").UFF(str(path))
    places = [k for k, kind in enumerate(file.get_set_types()) if int(kind) == 58]
    return {str(number): file.read_sets(k) for number, k in enumerate(places)}


def _numbers_by_label(heads: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Number of the set that a label names, where it names one only."""
    labels: dict[str, list[str]] = {}
    for number, head in heads.items():
        for key in ("id1", "rsp_ent_name", "ordinate_axis_lab"):
            label = str(head.get(key, "")).strip()
            if label and label != "NONE":
                labels.setdefault(label, []).append(number)
    return {label: n[0] for label, n in labels.items() if len(set(n)) == 1}


def _by_label(heads: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {label: heads[number] for label, number in _numbers_by_label(heads).items()}


def _fault(head: Mapping[str, Any]) -> str:
    """What a function is if it is not one of time."""
    if np.iscomplexobj(head["data"]):
        return "a spectrum, not a function of time"
    if int(head.get("abscissa_spec_data_type", 17)) not in (0, 17):
        return f"not a function of time, but of '{head.get('abscissa_axis_lab')}'"
    return ""
