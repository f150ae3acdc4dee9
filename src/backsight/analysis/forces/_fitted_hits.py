"""Hits that were fitted as pulses, as a result holds them."""

import dataclasses
from collections.abc import Mapping, Sequence

import xarray as xr

from backsight.rounding import plus_minus, significant

PREFIX = "hit_"
"""Of the variables of a result with a column of a table of hits, ``(hit,)``."""

_UNITS = {"place": "m", "time": "s", "start": "s", "width": "s", "speed": "m/s"}


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A number with its standard deviation, and its unit.

    Parameters
    ----------
    value, std : float
    unit : str
    """

    value: float
    std: float
    unit: str


@dataclasses.dataclass(frozen=True)
class FittedHit:
    """A pulse that was fitted.

    Parameters
    ----------
    force : str
        Name of the place; empty if it may be anywhere on a line.
    numbers : dict
        What is known of it by name: time, start, size, impulse, width, place, speed.
    """

    force: str
    numbers: Mapping[str, Fitted]

    def __str__(self) -> str:
        """When, where and how hard."""
        time, size = self.numbers["time"], self.numbers["size"]
        place = self.numbers.get("place")
        at = f"{plus_minus(place.value, place.std)} m" if place and place.std > 0 else self.force
        where = f" at {at}" if at else ""
        speed = self.numbers.get("speed")
        moving = f" with {plus_minus(speed.value, speed.std)} m/s" if speed else ""
        told = f"{plus_minus(size.value, size.std)} {size.unit}".strip()
        return f"{significant(time.value)} s{where}{moving}: {told}"

    def entry(self) -> dict[str, object]:
        """As plain numbers and texts."""
        numbers = {name: dataclasses.asdict(number) for name, number in self.numbers.items()}
        return {"force": self.force, **numbers}


def with_fitted_hits(result: xr.Dataset, table: xr.Dataset) -> xr.Dataset:
    """The result with a table of hits, as of `follow_hits` and `locate_hits`, as its variables."""
    columns = {f"{PREFIX}{name}": column for name, column in table.data_vars.items()}
    if f"{PREFIX}force" in columns:
        columns[f"{PREFIX}force"] = columns[f"{PREFIX}force"].astype(str)
    return result.assign(columns)


def fitted_hits(result: xr.Dataset) -> tuple[FittedHit, ...]:
    """Hits that a result holds as a table, in the order of time."""
    if f"{PREFIX}time" not in result:
        return ()
    names = [
        str(name).removeprefix(PREFIX)
        for name in result.data_vars
        if str(name).startswith(PREFIX) and f"{name}_std" in result
    ]
    forces = set(result["force_unit"].values) if "force_unit" in result.coords else set()
    unit = str(next(iter(forces))) if len(forces) == 1 else ""
    units = {**_UNITS, "size": unit, "impulse": f"{unit} s".strip()}
    columns = {n: (result[f"{PREFIX}{n}"], result[f"{PREFIX}{n}_std"]) for n in names}
    found = []
    for i in range(result.sizes["hit"]):
        numbers = {
            n: Fitted(float(value[i]), float(std[i]), units.get(n, ""))
            for n, (value, std) in columns.items()
        }
        force = str(result[f"{PREFIX}force"].values[i]) if f"{PREFIX}force" in result else ""
        found.append(FittedHit(force, numbers))
    return tuple(sorted(found, key=lambda hit: hit.numbers["time"].value))


def largest_of(hits: Sequence[FittedHit]) -> str:
    """Say how many hits were fitted, and the largest of them."""
    first = max(hits, key=lambda hit: abs(hit.numbers["size"].value))
    count = f"{len(hits)} hits, the largest" if len(hits) > 1 else "1 hit"
    return f"{count} at {first}"
