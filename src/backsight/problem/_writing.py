"""The text of a problem file with other values in it; comments and order stay."""

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from backsight.description import alike
from backsight.errors import ProblemError
from backsight.estimators.uncertainty import Noise
from backsight.problem.problem import Problem
from backsight.tune import Tuned

DIGITS = 5
"""Significant digits of what is written."""


def written(problem: Problem, name: str, tuned: Tuned, *, folder: Path) -> str:
    """Problem file with the values that were found for an estimator.

    Values that differ from recording to recording have no place in it: they are only in
    ``[tune.found]``, which lists all that was found.

    Parameters
    ----------
    problem : Problem
    name : str
        Of the estimator.
    tuned : Tuned
    folder : Path
        Where the file will be; relative paths in it are made to fit.

    Raises
    ------
    ProblemError
        If the file has no place for a value.
    """
    document = tomlkit.parse(problem.text)
    own: Any = document["estimators"][name]  # type: ignore[index]
    noise, prior = tuned.estimators[0].assumed
    parameters = {s.name for s in tuned.models[0].parameters}
    for value in [n for n in tuned.values if "[" not in n]:
        group, _, entry = value.partition(".")
        number = tuned.values[value]
        if group == "delay" and value not in parameters:
            continue
        if group in ("sigma_y", "R"):
            table = own["noise"] if "noise" in own else document["noise"]
            _sensor(table, noise, {entry: number} if entry else {})
        elif group in ("sigma_w", "Q", "Qc"):
            table = own["noise"] if "noise" in own else document["noise"]
            _walk(document, table, noise, {entry: number} if group == "sigma_w" else {})
        elif group in ("sigma_x0", "P0", "x0"):
            table = own["prior"] if "prior" in own else _table(document, "prior")
            if group == "x0":
                _by_state(document, table, "x0", "start", {entry: number})
            elif prior.P0 is not None:
                table["P0"] = _rows(prior.P0)
            else:
                every: Any = prior.sigma_x0
                chosen = {entry: number} if entry else every
                _by_state(document, table, "sigma_x0", "sigma", chosen)
        elif value in parameters:
            _parameter(document["model"], value, number)
        elif group in document.get("forces", {}):
            force: Any = document["forces"][group]  # type: ignore[index]
            force["time" if entry == "length" and "time" in force else entry] = _number(number)
        elif value in tuned.estimators[0].multiplied_settings:
            own[value] = _plain(getattr(tuned.estimators[0], value))
        else:
            _put(own, value, number)
    _late(document, tuned)
    for setting, option in tuned.chosen.items():
        _put(own, setting, _plain(option))
    _found(document, tuned)
    _paths(document, problem.path.absolute().parent, folder)
    return tomlkit.dumps(document)


def _sensor(table: Any, noise: Noise, chosen: Mapping[str, float]) -> None:
    """One standard deviation of a sensor, or all of them."""
    if noise.R is not None:
        table.pop("sigma_y", None)
        table["R"] = _rows(noise.R)
    else:
        _each(table, "sigma_y", chosen or noise.sigma_y)


def _walk(document: Any, table: Any, noise: Noise, chosen: Mapping[str, float]) -> None:
    """One step of a state that walks, or all process noise."""
    for matrix in ("Q", "Qc"):
        if getattr(noise, matrix) is not None:
            table.pop("sigma_w", None)
            for kind in ("estimate", "disturbances"):
                for unknown in document.get(kind, {}).values():
                    unknown.pop("walk", None)
            table[matrix] = _rows(getattr(noise, matrix))
    if noise.sigma_w is not None:
        given: Any = chosen or noise.sigma_w
        _by_state(document, table, "sigma_w", "walk", given)


def _by_state(document: Any, table: Any, key: str, own: str, values: Mapping[str, float]) -> None:
    """Numbers by state: those of unknowns are in their own tables under another key."""
    rest = dict(values)
    for kind in ("estimate", "disturbances"):
        unknowns = document.get(kind, {})
        for state in [s for s in rest if s in unknowns]:
            if own in unknowns[state] or state not in table.get(key, {}):
                unknowns[state][own] = _number(rest.pop(state))
    if rest:
        _each(table, key, rest)


def _late(document: Any, tuned: Tuned) -> None:
    """Delays of columns, beside those that the file has already."""
    if any(late != tuned.late[0] for late in tuned.late):
        return
    recording = document["recording"]
    for name, late in tuned.late[0].items():
        columns = [recording[k] for k in ("inputs", "outputs") if name in recording.get(k, {})]
        if not columns:
            raise ProblemError(
                f"recording: the file has no column '{name}' of its own, whose delay was found"
            )
        column = columns[0][name]
        if not isinstance(column, Mapping):
            table = tomlkit.inline_table()
            table["column"] = column
            columns[0][name] = column = table
        column["delay"] = _number(float(column.get("delay", 0.0)) + late)  # type: ignore[index]


def _each(table: Any, key: str, values: Any) -> None:
    """Numbers by name, in a table that is there or in a new one."""
    if key not in table:
        table[key] = tomlkit.inline_table()
    for name, value in values.items():
        table[key][name] = _number(value)


def _parameter(model: Any, name: str, value: float) -> None:
    parameters = model.get("parameters", {})
    if name in parameters:
        entry = parameters[name]
        if isinstance(entry, Mapping):
            entry["value"] = _number(value)  # type: ignore[index]
        else:
            parameters[name] = _number(value)
    elif isinstance(model.get(name), int | float):
        model[name] = _number(value)
    else:
        raise ProblemError(
            f"model: the file has no place for '{name}': write its value there first"
        )


def _put(table: Any, path: str, value: object) -> None:
    *inner, last = path.split(".")
    for key in inner:
        table = _table(table, key)
    table[last] = _number(value) if isinstance(value, float) else value


def _plain(value: Any) -> Any:
    """A value of a description as a problem file has it."""
    if dataclasses.is_dataclass(value):
        table = tomlkit.inline_table()
        table["kind"] = type(value).__name__
        for field in dataclasses.fields(value):
            own = getattr(value, field.name)
            if own is not None and not alike(own, field.default):
                table[field.name] = _plain(own)
        return table
    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        table.update({name: _plain(entry) for name, entry in value.items()})
        return table
    if isinstance(value, tuple | list | np.ndarray):
        return [_plain(entry) for entry in value]
    if isinstance(value, complex):
        # More digits: a pole near 1 must stay inside the unit circle.
        rounded = complex(_number(value.real, 9), _number(value.imag, 9))
        return rounded.real if rounded.imag == 0 else f"{rounded.real:.9g}{rounded.imag:+.9g}j"
    return _number(value) if isinstance(value, float) else value


def _table(document: Any, key: str) -> Any:
    if key not in document:
        document[key] = tomlkit.table()
    return document[key]


def _found(document: Any, tuned: Tuned) -> None:
    """``[tune.found]``: every value with its standard deviation, and what it was before."""
    found = tomlkit.table()
    for name, value in tuned.values.items():
        entry = tomlkit.inline_table()
        entry["value"] = _number(value)
        entry["std"] = _number(tuned.std[name], 2)
        entry["before"] = _number(tuned.start[name])
        found[name] = entry
    if found:
        _table(document, "tune")["found"] = found


def _paths(document: Any, before: Path, after: Path) -> None:
    """Relative paths of recordings as seen from the new folder."""
    if before == after:
        return

    def moved(path: str) -> str:
        if path.startswith("${") or Path(path).is_absolute():
            return path
        return Path(os.path.relpath(before / path, after)).as_posix()

    recording = document["recording"]
    for table in (recording, *recording.get("sources", {}).values()):
        table["path"] = moved(str(table["path"]))
    others = document.get("tune", {}).get("recordings", [])
    for i, path in enumerate(others):
        others[i] = moved(str(path))


def _rows(matrix: Any) -> list[list[float]]:
    return [[_number(v) for v in row] for row in matrix]


def _number(value: Any, digits: int = DIGITS) -> float:
    return float(f"{value:.{digits}g}")
