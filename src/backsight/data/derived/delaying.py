"""Take the delays of channels out of a recording."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from backsight.errors import DataError, nearest
from backsight.schema import SAME
from backsight.types import Array

_KINDS = {"u": "input", "y": "output", "x_true": "state", "sigma_factor": "output"}


def remove_delays(recording: xr.Dataset, delays: Mapping[str, float]) -> xr.Dataset:
    """Move the samples of channels to the times at which they were true.

    By whole samples where the delay is a multiple of the sampling period; otherwise along the line
    between two samples, which smooths noise and is said in ``understood``. An output is "not
    measured" where nothing is left to be moved there; where that happens to an input, the recording
    is cut.

    Parameters
    ----------
    recording : xarray.Dataset
    delays : dict
        Name of an input, output or reference state to the time by which its samples come late [s];
        negative if they come early. What is not named stays.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    DataError
        If there is no such signal, or a delay of inputs leaves less than two samples.

    Examples
    --------
    >>> from backsight.data import from_arrays
    >>> late = from_arrays(y=[0.0, 0.0, 1.0, 2.0], dt=0.1, inputs={}, outputs={"q": "m"})
    >>> remove_delays(late, {"q": 0.2}).y.values.ravel()
    array([ 1.,  2., nan, nan])
    """
    known = [n for kind in ("input", "output", "state") for n in _names(recording, kind)]
    for name in delays:
        if name not in known:
            raise DataError(f"remove_delays: there is no signal '{name}': {nearest(name, known)}")
    n, dt = recording.sizes["time"], float(recording.attrs["dt"])
    first, last, notes, changed = 0, n, [], {}
    for variable, kind in _KINDS.items():
        late = {k: delays.get(name, 0.0) / dt for k, name in enumerate(_names(recording, kind))}
        if variable not in recording or not any(late.values()):
            continue
        values = np.array(recording[variable].values)
        for k, shift in late.items():
            values[:, k] = _moved(values[:, k], shift)
            if variable == "u":
                first, last = max(first, int(np.ceil(-shift))), min(last, n - int(np.ceil(shift)))
            if abs(shift - round(shift)) > SAME and variable != "sigma_factor":
                notes.append(f"'{_names(recording, kind)[k]}' is interpolated by its delay")
        changed[variable] = (recording[variable].dims, values)
    if last - first < 2:
        raise DataError("remove_delays: the delays leave less than two samples with all inputs")
    result = recording.assign(changed).isel(time=slice(first, last))
    understood = "; ".join(filter(None, (recording.attrs.get("understood", ""), *notes)))
    return result.assign_attrs({"understood": understood} if understood else {})


def _names(recording: xr.Dataset, kind: str) -> list[str]:
    return recording[kind].values.tolist() if kind in recording.coords else []


def _moved(values: Array, shift: float) -> Array:
    """Values at ``k + shift``, NaN where there are none."""
    n = len(values)
    whole = round(shift) if abs(shift - round(shift)) <= SAME else int(np.floor(shift))
    part = 0.0 if abs(shift - round(shift)) <= SAME else shift - whole
    at = np.arange(n) + whole
    moved = np.full(n, np.nan)
    inside = (at >= 0) & (at + (part > 0) < n)
    at = at[inside]
    moved[inside] = values[at] if part == 0.0 else (1 - part) * values[at] + part * values[at + 1]
    return moved
