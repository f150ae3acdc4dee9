"""Bring recordings of several rates together."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight import schema
from backsight.data.recording import BEGIN, UNDERSTOOD, Group, with_sigma_factor, with_truth
from backsight.errors import DataError
from backsight.types import Array

KINDS = {"u": "input", "y": "output", "x_true": "state", schema.SIGMA_FACTOR: "output"}
"""Variables of a recording, and the dimension of their columns."""


def merge(*recordings: xr.Dataset) -> xr.Dataset:
    """Bring recordings of one experiment, made at several rates, on the fastest time grid.

    An output of a slower recording is ``NaN`` where it was not measured; an input holds its last
    value. A slower sample goes to the nearest time of the grid, which moves it by half the fast
    period at most; where that matters, `resample` first. The result covers the time that all
    recordings cover.

    Parameters
    ----------
    *recordings : xarray.Dataset
        With different names for all signals, and one common zero of time; those with dates are put
        on the clock of the earliest one.

    Returns
    -------
    xarray.Dataset
        Inputs and outputs in the order of the arguments.

    Raises
    ------
    DataError
        If a name occurs twice, the recordings do not overlap, or two samples of one fall on the
        same time.

    Examples
    --------
    >>> import numpy as np
    >>> one = bs.data.from_arrays(inputs={}, y=np.zeros((5, 1)), dt=0.1, outputs={"roof": "mm"})
    >>> two = bs.data.from_arrays(inputs={}, y=np.ones((5, 1)), dt=0.1, outputs={"floor": "mm"})
    >>> bs.merge(one, two).output.values.tolist()
    ['roof', 'floor']
    """
    if not recordings:
        raise DataError("merge: give at least one recording")
    recordings, begin = _on_one_clock(recordings)
    fastest = min(recordings, key=lambda r: r.attrs["dt"])
    dt = fastest.attrs["dt"]
    time = _common(recordings, fastest.time.to_numpy(), dt)
    if any(schema.SIGMA_FACTOR in r for r in recordings):
        recordings = tuple(_with_factors(r) for r in recordings)
    aligned = [_aligned(r, time, dt) for r in recordings]
    u, y, x, factors = (_joined([groups[k] for groups in aligned if k in groups], k) for k in KINDS)
    merged = schema.recording(
        time,
        u=u.values,
        y=y.values,
        inputs=dict(u.units),
        outputs=dict(y.units),
        dt=dt,
    )
    notes = {BEGIN: begin, UNDERSTOOD: "; ".join(_notes(recordings))}
    merged.attrs |= {name: text for name, text in notes.items() if text}
    if factors.units:
        merged = with_sigma_factor(merged, factors.values, where="merge")
    return with_truth(merged, x) if x.units else merged


def _on_one_clock(recordings: tuple[xr.Dataset, ...]) -> tuple[tuple[xr.Dataset, ...], str]:
    """Recordings whose times count from the earliest date of them, and that date."""
    dates = [r.attrs.get(BEGIN, "") for r in recordings]
    if not any(dates) or len(recordings) == 1:
        return recordings, dates[0]
    if not all(dates):
        raise DataError(
            "merge: some recordings have dates, their time counts from the first sample, and "
            "others have none: read all with numbers as time, or all with dates"
        )
    stamps = [np.datetime64(date, "ns") for date in dates]
    first = min(stamps)
    shifts = [float((stamp - first).astype(np.int64)) / 1e9 for stamp in stamps]
    shifted = tuple(
        r.assign_coords(time=("time", r.time.to_numpy() + shift, r.time.attrs))
        for r, shift in zip(recordings, shifts, strict=True)
    )
    return shifted, dates[stamps.index(first)]


def _notes(recordings: Sequence[xr.Dataset]) -> list[str]:
    return list(dict.fromkeys(r.attrs[UNDERSTOOD] for r in recordings if UNDERSTOOD in r.attrs))


def _with_factors(recording: xr.Dataset) -> xr.Dataset:
    """The recording with ``sigma_factor``, which is 1 if it has none."""
    if schema.SIGMA_FACTOR in recording:
        return recording
    return with_sigma_factor(recording, np.ones(recording["y"].shape), where="merge")


def _common(recordings: Sequence[xr.Dataset], grid: Array, dt: float) -> Array:
    begin = max(float(r.time[0]) for r in recordings)
    end = min(float(r.time[-1]) for r in recordings)
    time = grid[(grid >= begin - dt / 2) & (grid <= end + dt / 2)]
    if len(time) < 2:
        raise DataError(
            f"merge: the recordings have no time in common: the last begins at {begin:.9g} s, the "
            f"first ends at {end:.9g} s"
        )
    return time


def _aligned(recording: xr.Dataset, time: Array, dt: float) -> dict[str, Group]:
    place = _places(recording.time.to_numpy(), time, dt)
    inside = (place >= 0) & (place < len(time))
    # The first sample may lie up to half a period after the grid's first: it holds there too.
    held = np.maximum(np.searchsorted(place, np.arange(len(time)), side="right") - 1, 0)
    groups = {}
    for name, kind in KINDS.items():
        if name in recording:
            values = recording[name].to_numpy()
            spread = np.full((len(time), values.shape[1]), np.nan)
            spread[place[inside]] = values[inside]
            names, units = recording[kind].to_numpy(), recording[f"{kind}_unit"].to_numpy()
            groups[name] = Group(
                values[held] if name == "u" else spread,
                dict(zip(names.tolist(), units.tolist(), strict=True)),
            )
    return groups


def _places(stamps: Array, time: Array, dt: float) -> np.ndarray:
    """Index of the nearest time for every stamp: -1 before the grid, ``len(time)`` after it."""
    between = (time[1:] + time[:-1]) / 2
    edges = np.concatenate([[time[0] - dt / 2], between, [time[-1] + dt / 2]])
    place = np.searchsorted(edges, stamps, side="right") - 1
    double = (np.diff(place) == 0) & (place[1:] >= 0) & (place[1:] < len(time))
    if double.any():
        k = int(np.argmax(double))
        raise DataError(
            f"merge: the samples at {stamps[k]:.9g} and {stamps[k + 1]:.9g} s fall on the same "
            f"time of the fastest recording; resample one of the two first"
        )
    return place


def _joined(groups: Sequence[Group], name: str) -> Group:
    names = Counter(n for group in groups for n in group.units)
    double = [n for n, count in names.items() if count > 1]
    if double:
        raise DataError(f"merge: two recordings have the {KINDS[name]} '{double[0]}'; rename one")
    return Group(
        np.hstack([g.values for g in groups] or [np.empty((0, 0))]),
        {n: unit for g in groups for n, unit in g.units.items()},
    )
