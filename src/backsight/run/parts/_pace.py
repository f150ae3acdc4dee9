"""Parts of a recording: how they follow each other in time, and how they are known again."""

from __future__ import annotations

import dataclasses

import numpy as np
import xarray as xr

from backsight.data.parts import RecordingParts
from backsight.data.parts.parts import LATE
from backsight.description import digest
from backsight.errors import DataError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model


@dataclasses.dataclass(frozen=True)
class Pace:
    """Sampling period of all parts, and whether they say their times or follow each other."""

    dt: float
    timed: bool

    @classmethod
    def of(cls, parts: RecordingParts, dt: float) -> Pace:
        """That of parts of which the first has the sampling period dt [s]."""
        return cls(dt, parts.time is not None or parts.rows > 0)


def stamps_of(parts: RecordingParts) -> np.ndarray:
    """By which the files of all parts are known again, a row each."""
    return np.array([[*map(str, parts.stamp(k))] for k in range(parts.count)])


def said_of(
    estimator: AbstractEstimator, model: Model, parts: RecordingParts, *others: object
) -> str:
    """Digest of what is estimated; how many parts there are may grow, their cuts may not move."""
    cuts = dataclasses.replace(parts, files=parts.files[:1], rows=min(parts.rows, 1))
    try:
        return digest(estimator, model, {**vars(cuts), "files": str(parts.files[0])}, *others)
    except TypeError as error:
        raise TuningError(f"the estimator cannot be told from others: {error}") from None


def check_unchanged(known: np.ndarray, stamps: np.ndarray) -> None:
    """Raise `DataError` if the file of a part that is done is another one now.

    Further files may have come.
    """
    now = stamps[: len(known)]
    if len(now) < len(known):
        raise DataError("the recording has fewer parts than were estimated already")
    changed = np.flatnonzero((now != known).any(axis=1)) if len(known) else known
    if len(changed):
        raise DataError(
            f"{now[changed[0], 0]} has changed since it was estimated; begin anew in another folder"
        )


def in_step(recording: xr.Dataset, part: int, end: float, pace: Pace) -> xr.Dataset:
    """The recording of a part, with times that go on where the one before ends (NaN: none is)."""
    dt = float(recording.attrs["dt"])
    if abs(dt / pace.dt - 1) > 1e-6:
        raise DataError(
            f"part {part} has the sampling period {dt:g} s, the first one {pace.dt:g} s"
        )
    if not np.isfinite(end):
        return recording
    time, expected = recording["time"].values, end + pace.dt
    if pace.timed:
        if abs(time[0] - expected) > LATE * pace.dt:
            raise DataError(
                f"part {part} begins at {time[0]:.9g} s, but the one before ends so that "
                f"{expected:.9g} s would be next; fill the gap (NaN in outputs), or estimate what "
                "comes after it by itself"
            )
        return recording
    return recording.assign_coords(time=expected + pace.dt * np.arange(len(time)))
