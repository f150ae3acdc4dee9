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

_KINDS = {8: "{length}", 11: "{length}/s", 12: "{length}/s^2"} | dict.fromkeys((9, 13), "{force}")
"""Units of displacements, velocities, accelerations and forces, by their numbers in a set 58."""

_UNITS = {
    "length": {"m": 1.0, "mm": 1e3, "cm": 1e2, "ft": 1 / 0.3048, "inch": 1 / 0.0254},
    "force": {"N": 1.0, "mN": 1e3, "cN": 1e2, "kgf": 1 / 9.80665, "lbf": 1 / 4.4482216152605}
    | {"poundal": 1 / 0.138254954376},
}
"""What a set 164 gives: by how much a number in the file's unit is larger than in SI."""

_SAME = 1e-4


def read_uff(path: Path, request: Request) -> Contents:
    """Read functions of time (data sets 58) of a universal file, by number from 0 on or by name.

    Names are the first line of a set, or the label of its ordinate, where these are unique.
    """
    heads, system, header = _sets(path)
    named = _by_label(heads) | heads
    columns, units, clocks = {}, {}, []
    for name in present(request.wanted, named):
        head = named[name]
        if fault := _fault(head):
            raise DataError(f"'{name}' is {fault}")
        columns[name] = np.asarray(head["data"], float)
        units[name] = _unit(head, system)
        if int(head["abscissa_spacing"]) == 1:
            clocks.append((name, float(head["abscissa_min"]), float(head["abscissa_inc"])))
    uneven = [np.asarray(named[n]["x"], float) for n in columns if n not in {c[0] for c in clocks}]
    if uneven and (clocks or any(not np.array_equal(x, uneven[0]) for x in uneven)):
        raise DataError("the functions are at different times; read each by itself and merge them")
    time = uneven[0] if uneven else even_times(clocks, columns)
    model = str(header.get("model_name", "")).strip()
    return Contents(columns, units, f"model '{model}'" if model not in ("", "NONE") else "", time)


def list_uff(path: Path, _: Request) -> list[Listed]:
    """List the functions, by label where that is unique."""
    heads, _units, _header = _sets(path)
    labels: dict[str, str] = {}
    for label, number in _numbers_by_label(heads).items():
        labels.setdefault(number, label)  # the first line of the set before other names
    return [
        Listed(labels.get(number, number), "other" if (fault := _fault(head)) else "numbers", fault)
        for number, head in heads.items()
    ]


def _sets(path: Path) -> tuple[dict[str, dict[str, Any]], dict[str, Any], dict[str, Any]]:
    """Data sets 58 by their numbers, and the sets of units (164) and of the model (151), or {}."""
    check_room(path.stat().st_size * 2, "the file")
    file = library("pyuff").UFF(str(path))
    places: dict[int, list[int]] = {}
    for k, kind in enumerate(file.get_set_types()):
        places.setdefault(int(kind), []).append(k)
    systems = [dict(file.read_sets(k)) for k in places.get(164, [])]
    if any(system != systems[0] for system in systems):
        raise DataError("the file has several systems of units (164); write one file for each")
    header = file.read_sets(places[151][0]) if 151 in places else {}
    heads = {str(number): file.read_sets(k) for number, k in enumerate(places.get(58, []))}
    return heads, systems[0] if systems else {}, dict(header)


def _unit(head: Mapping[str, Any], system: Mapping[str, Any]) -> str:
    """As the function says it, or by its kind and the system of units of the file."""
    told = str(head.get("ordinate_axis_units_lab", "")).strip()
    if told not in ("", "NONE"):
        return told
    form = _KINDS.get(int(head.get("ordinate_spec_data_type", 0)), "")
    words = {part: _named(known, system.get(part)) for part, known in _UNITS.items()}
    if not form or any(part in form and not word for part, word in words.items()):
        return ""
    return form.format(**words)


def _named(known: Mapping[str, float], factor: float | None) -> str:
    """The unit by which a quantity is so many times larger than in SI, "" if it has no name."""
    return next((u for u, f in known.items() if factor and abs(f / factor - 1) < _SAME), "")


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
