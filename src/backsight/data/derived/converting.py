"""Bring the signals of a recording to other units."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from backsight.errors import DataError
from backsight.units import UnitError, conversion, is_unit

_KINDS = {"u": "input", "y": "output", "x_true": "state"}


def convert_units(recording: xr.Dataset, units: Mapping[str, str]) -> xr.Dataset:
    """Convert signals of a recording to other units.

    Parameters
    ----------
    recording : xarray.Dataset
    units : dict
        Name of an input, output or reference state to its new unit. One without a unit, or with one
        that is none, keeps its numbers and gets the new one.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    DataError
        If two units measure different things.

    Examples
    --------
    >>> from backsight.data import from_arrays
    >>> recording = from_arrays(y=[1.0, 2.0], dt=0.1, inputs={}, outputs={"q": "mm"})
    >>> convert_units(recording, {"q": "m"}).y.values.ravel()
    array([0.001, 0.002])
    """
    changed = {}
    for variable, kind in _KINDS.items():
        if variable not in recording:
            continue
        names = recording[kind].values.tolist()
        old = recording[f"{kind}_unit"].values.tolist()
        new = [units.get(name) or unit for name, unit in zip(names, old, strict=True)]
        if new == old:
            continue
        values = np.array(recording[variable].values)
        for k, (name, given, wanted) in enumerate(zip(names, old, new, strict=True)):
            if given == wanted or not (given and is_unit(given) and is_unit(wanted)):
                continue
            try:
                between = conversion(given, wanted)
            except UnitError as error:
                raise DataError(f"{kind} '{name}': {error}") from None
            if not between.same:
                values[:, k] = between.factor * values[:, k] + between.offset
        changed[variable] = (recording[variable].dims, values)
        recording = recording.assign_coords({f"{kind}_unit": (kind, new)})
    return recording.assign(changed)
