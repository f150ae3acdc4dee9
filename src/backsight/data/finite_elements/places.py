"""Tables of sensors and forces: where they are, in which direction, how noisy."""

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path

from backsight.data.finite_elements._rows import number_in, rows_of
from backsight.data.finite_elements.matrix import DIRECTIONS
from backsight.errors import DataError, nearest

_PLACE = ("coordinate", "node", "direction", "weight")
_SENSOR = ("name", *_PLACE, "kind", "unit", "noise")
_FORCE = ("name", *_PLACE, "unit")
_AXES = dict(zip("xyz123456", (*DIRECTIONS[:3], *DIRECTIONS), strict=True))


@dataclasses.dataclass(frozen=True)
class SensorList:
    """Sensors of a structure.

    Parameters
    ----------
    sensors : dict
        Name to ``(kind, {coordinate: weight})``, as `backsight.reduced` takes them.
    noise : dict
        Name to standard deviation [unit of the sensor], as ``Noise(sigma_y=...)`` takes them; of
        the sensors that have one.
    units : dict
        Name to unit; of the sensors that have one.
    """

    sensors: Mapping[str, tuple[str, Mapping[int | str, float]]]
    noise: Mapping[str, float]
    units: Mapping[str, str]


def read_sensors(path: str | os.PathLike[str]) -> SensorList:
    """Read a table of sensors.

    The first line names the columns: ``name``, ``kind`` (displacement, velocity, acceleration,
    strain...), the place as ``coordinate`` ("12:UX", or its number from 0 on) or as ``node`` and
    ``direction`` (UX ... RZ, X, Y, Z, 1 to 6; with a minus for the other way), and optionally
    ``unit``, ``noise`` and ``weight``. Several rows of one name are a weighted sum.

    Parameters
    ----------
    path : path
        Text with commas, semicolons (and decimal commas) or tabs.

    Raises
    ------
    DataError
        If a column is missing or unknown, or a cell is not what it should be, with row and column.
    """
    file = Path(path)
    rows = _checked(file, _SENSOR, needed=("name", "kind"))
    places = _places(file, rows)
    kinds: dict[str, str] = {}
    noise: dict[str, float] = {}
    units: dict[str, str] = {}
    for number, row in enumerate(rows, 2):
        where, name = f"{file}, row {number}", row["name"]
        kind = row["kind"].lower().replace(" ", "_")
        if kinds.setdefault(name, kind) != kind:
            raise DataError(f"{where}: sensor '{name}' is of two kinds, {kinds[name]} and {kind}")
        if row.get("noise"):
            noise[name] = number_in(row, "noise", where)
        if row.get("unit"):
            units[name] = row["unit"]
    return SensorList({k: (kinds[k], at) for k, at in places.items()}, noise, units)


def read_forces(path: str | os.PathLike[str]) -> dict[str, dict[int | str, float]]:
    """Read a table of forces: ``name`` and the place as in `read_sensors`.

    Returns
    -------
    dict
        Name to ``{coordinate: weight}``, as `backsight.reduced` takes forces and inputs.

    Raises
    ------
    DataError
        As in `read_sensors`.
    """
    file = Path(path)
    return _places(file, _checked(file, _FORCE, needed=("name",)))


def _checked(
    file: Path, known: tuple[str, ...], *, needed: tuple[str, ...]
) -> list[dict[str, str]]:
    rows = rows_of(file)
    for name in rows[0]:
        if name not in known:
            raise DataError(f"{file} has a column '{name}': {nearest(name, known)}")
    by_coordinate = "coordinate" in rows[0]
    lacking = [n for n in needed if n not in rows[0]]
    if by_coordinate == ("node" in rows[0]):
        lacking.append("coordinate" if not by_coordinate else "one of coordinate and node")
    if lacking:
        raise DataError(f"{file} lacks {', '.join(lacking)}; known columns: {', '.join(known)}")
    for number, row in enumerate(rows, 2):
        for name in needed:
            if not row[name]:
                raise DataError(f"{file}, row {number}: {name} is empty")
    return rows


def _places(file: Path, rows: list[dict[str, str]]) -> dict[str, dict[int | str, float]]:
    found: dict[str, dict[int | str, float]] = {}
    for number, row in enumerate(rows, 2):
        where = f"{file}, row {number}"
        at, sign = _place(row, where)
        weight = sign * (number_in(row, "weight", where) if row.get("weight") else 1.0)
        there = found.setdefault(row["name"], {})
        if at in there:
            raise DataError(f"{where}: '{row['name']}' is at {at} twice")
        there[at] = weight
    return found


def _place(row: Mapping[str, str], where: str) -> tuple[int | str, float]:
    if "coordinate" in row:
        at = row["coordinate"]
        if not at:
            raise DataError(f"{where}: coordinate is empty")
        return (int(at) if at.isdecimal() else at), 1.0
    given = row.get("direction", "")
    sign = -1.0 if given.startswith("-") else 1.0
    word = given.lstrip("+-")
    direction = _AXES.get(word.lower(), word.upper())
    if not row["node"] or (given and direction not in DIRECTIONS):
        raise DataError(
            f"{where}: node '{row['node']}' and direction '{given}' are no place; directions are "
            f"{', '.join(DIRECTIONS)}, X, Y, Z or 1 to 6"
        )
    return (f"{row['node']}:{direction}" if given else row["node"]), sign
