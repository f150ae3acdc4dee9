"""Recordings of the rig: where they come from and how they are read."""

import dataclasses
import os
import zipfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from backsight.errors import DataError
from backsight.types import Array
from backsight_studies.frame_hammer.rig import DT, SENSORS

SOURCE = "github.com/XERN0N/System-Dynamics-and-Identification-Project-Group-3, commit 9269f89"

VARIABLE, FOLDER, FILES = "BACKSIGHT_DATA", "frame_hammer", ("x160_multi", "y160_4hit_rest")

SAME_PERIOD = 0.01
"""Relative difference of the sampling period that calibration makes good."""

SHORTEST = 1000
"""Samples of a recording at least."""


@dataclasses.dataclass(frozen=True)
class Hammer:
    """Hits: those that the hammer's own sensor saw, only used to judge, or those that were found.

    Parameters
    ----------
    time : (n,) array
        Of every hit [s].
    height : (n,) array
        [m].
    impulse : (n,) array
        [N s].
    """

    time: Array
    height: Array
    impulse: Array


@dataclasses.dataclass(frozen=True)
class Recording:
    """Accelerations and perhaps the truth.

    Parameters
    ----------
    name : str
    y : (n, 4) array
        As recorded [m/s2].
    hammer : Hammer, optional
    start, period : float
        Time of the first sample and from one to the next [s].
    """

    name: str
    y: Array
    hammer: Hammer | None
    start: float = 0.0
    period: float = DT

    def times(self, samples: ArrayLike) -> Array:
        """Times [s] of places in samples."""
        return self.start + self.period * np.asarray(samples, float)

    @property
    def end(self) -> float:
        """Time behind the last sample [s]."""
        return float(self.times(len(self.y)))


def recordings(further: Sequence[str | os.PathLike[str]] = ()) -> list[Recording]:
    """The two recordings of the data folder, if it is there, and further files.

    Raises
    ------
    DataError
        If there are none at all, one cannot be read, or two have the same name.
    """
    folder = os.environ.get(VARIABLE)
    paths = [Path(folder, FOLDER, f"{name}.npz") for name in FILES] if folder else []
    there = [path for path in paths if path.exists()]
    if not there and not further:
        raise DataError(
            f"the measured recordings are missing: put {' and '.join(f'{n}.npz' for n in FILES)} "
            f"into the folder '{FOLDER}' of the folder that the environment variable {VARIABLE} "
            f"names, or give files with --recording; they come from {SOURCE}"
        )
    files = dict.fromkeys(path.resolve() for path in (*there, *map(Path, further)))
    found = [read(path) for path in files]
    for name, count in Counter(recording.name for recording in found).items():
        if count > 1:
            raise DataError(f"{count} recordings have the name '{name}'; rename a file")
    return found


def read(path: Path) -> Recording:
    """Read one NumPy file with `acc_ms2` and, where known, `hit_time_s` and the like.

    Raises
    ------
    DataError
        If it cannot be read, or its accelerations are not those of the rig.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            found = {key: np.asarray(stored[key], float) for key in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"recording '{path}' cannot be read as a NumPy file: {error}") from None
    if "acc_ms2" not in found:
        raise DataError(f"recording '{path}' has no accelerations 'acc_ms2'")
    y = found["acc_ms2"]
    if y.ndim != 2 or y.shape[1] != len(SENSORS) or len(y) < SHORTEST or not np.isfinite(y).all():
        raise DataError(
            f"recording '{path}': 'acc_ms2' must hold at least {SHORTEST} finite samples of "
            f"{len(SENSORS)} accelerometers; its shape is {y.shape}"
        )
    dead = np.flatnonzero(np.ptp(y, axis=0) == 0)
    if dead.size:
        raise DataError(
            f"recording '{path}': the accelerometer at {SENSORS[dead[0]]:g} m never changes"
        )
    start, period = _clock(path, found.get("t_acc_s"), len(y))
    return Recording(path.stem, y, _hammer(path, found), start, period)


def _clock(path: Path, time: Array | None, samples: int) -> tuple[float, float]:
    if time is None:
        return 0.0, DT
    if time.shape != (samples,) or not np.isfinite(time).all():
        raise DataError(f"recording '{path}': 't_acc_s' must have a time for each of the samples")
    period = float((time[-1] - time[0]) / (samples - 1))
    if abs(period / DT - 1) > SAME_PERIOD:
        raise DataError(
            f"recording '{path}': its sampling period is {period:g} s; the model of the sensors "
            f"is for {DT:g} s"
        )
    return float(time[0]), period


def _hammer(path: Path, found: dict[str, Array]) -> Hammer | None:
    keys = ("hit_time_s", "hit_height_m", "hit_impulse_Ns")
    if "hit_time_s" not in found:
        return None
    missing = [key for key in keys if key not in found]
    if missing:
        raise DataError(f"recording '{path}' has 'hit_time_s' but no {', '.join(missing)}")
    time = np.atleast_1d(found["hit_time_s"])
    try:
        height, impulse = (np.broadcast_to(found[key], time.shape) for key in keys[1:])
    except ValueError:
        raise DataError(f"recording '{path}': {', '.join(keys)} differ in length") from None
    return Hammer(time, height, impulse)
