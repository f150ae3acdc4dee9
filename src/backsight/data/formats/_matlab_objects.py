"""Tables, timetables, dates and durations in MATLAB files, by mat-io.

They are objects of classes, which MATLAB writes in a form of its own that SciPy passes over.
"""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backsight.data.formats.libraries import library

_WAYS = {
    "timeseries": "there, s = struct('t', {0}.Time, 'y', {0}.Data); save('run.mat', 's')",
    "Simulink.SimulationData.Dataset": (
        "there, v = {0}.get(1).Values; s = struct('t', v.Time, 'y', v.Data); save('run.mat', 's')"
    ),
}
"""How to write classes as structures, in MATLAB."""

_UNITS = ("VariableUnits", "varUnits")


@dataclasses.dataclass(frozen=True)
class MatlabObject:
    """An object that only MATLAB reads.

    Parameters
    ----------
    kind : str
        Its class.
    name : str
        Of the variable.
    """

    kind: str
    name: str = "x"

    @property
    def way(self) -> str:
        """What to do in MATLAB."""
        return _WAYS.get(self.kind, "there, write its numbers as a structure or as arrays").format(
            self.name
        )


@dataclasses.dataclass(frozen=True)
class Objects:
    """What a file holds.

    Parameters
    ----------
    leaves : dict
        Arrays, `MatlabObject` for an object that only MATLAB reads, None for what is not read.
    units : dict
        Of the columns of tables.
    times : dict
        Of the rows of timetables, dates or durations.
    column_major : bool
        Arrays have their axes in reverse order.
    """

    leaves: Mapping[str, Any]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    times: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    column_major: bool = False


def read_objects(path: Path, roots: Sequence[str] | None) -> Objects:
    """Leaves of variables, of all without `roots`: ``tt/acc`` of a table, ``tt/Time``."""
    with warnings.catch_warnings():
        # Time zones are said to be lost: dates are in UTC then, as everywhere.
        warnings.simplefilter("ignore")
        matio = library("matio")
        names = list(matio.whosmat(str(path)))
        known = [name for name in names if roots is None or name in roots]
        found = matio.load_from_mat(
            str(path), add_table_attrs=True, variable_names=known, raw_data=False
        )
    read = {name: found[name] for name in known if name in found}
    own = _flat(read)
    others = dict.fromkeys(name for name in names if name not in read)
    return dataclasses.replace(own, leaves={**others, **own.leaves})


def _flat(tree: Mapping[str, Any]) -> Objects:
    leaves: dict[str, Any] = {}
    units: dict[str, str] = {}
    times: dict[str, np.ndarray] = {}
    for name, entry in tree.items():
        inner: dict[str, Any] = {}
        if isinstance(entry, pd.DataFrame):
            leaves |= {f"{name}/{column}": entry[column].to_numpy() for column in entry}
            units |= _units(name, entry)
            if isinstance(entry.index, (pd.DatetimeIndex, pd.TimedeltaIndex)):
                times[name] = entry.index.to_numpy()
                leaves[f"{name}/{entry.index.name or 'Time'}"] = times[name]
        elif isinstance(entry, np.ndarray) and entry.dtype.names:
            records = entry.ravel(order="F")
            one = len(records) == 1
            for k, record in enumerate(records):
                place = name if one else f"{name}[{k}]"
                inner |= {f"{place}/{field}": record[field] for field in entry.dtype.names}
        elif isinstance(entry, np.ndarray) and entry.dtype == object:
            inner = {f"{name}[{k}]": cell for k, cell in enumerate(entry.ravel(order="F"))}
        elif kind := getattr(entry, "classname", ""):
            leaves[name] = MatlabObject(str(kind), name)
        else:
            leaves[name] = entry
        deeper = _flat(inner)
        leaves |= deeper.leaves
        units |= deeper.units
        times |= deeper.times
    return Objects(leaves, units, times)


def _units(name: str, table: pd.DataFrame) -> dict[str, str]:
    told = next((table.attrs[key] for key in _UNITS if len(table.attrs.get(key, ()))), ())
    words = [str(np.squeeze(unit)) if np.size(unit) else "" for unit in told]
    return {f"{name}/{c}": unit for c, unit in zip(table, words, strict=False) if unit}
