"""Hits in the raw readings by the library alone, sensors at their limits and all.

The model is one in parts of a sample, so that pulses of two samples have their moment and every
channel its own; parts at which no channel is read are not measured. `follow_hits` does the rest.
``python -m backsight_studies.frame_hammer.raw x160_multi.npz`` prints the hits of a recording; one
of 16 seconds takes some minutes.
"""

import sys
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs
from backsight.types import Array
from backsight_studies.frame_hammer.rig import DT, SENSORS, STEP, SUBSTEPS, Axis
from backsight_studies.frame_hammer.score import judged
from backsight_studies.frame_hammer.source import Hammer, read
from backsight_studies.frame_hammer.sparse import FORCES, LARGEST, TWIST

CALIBRATED = Axis(
    "weak axis, calibrated",
    second_moment=1.02e-8,
    tip_inertia=0.0004,
    frequencies=(
        4.0452,
        35.18,
        107.3112,
        218.4161,
        367.1349,
        553.0095,
        764.6336,
        1012.8157,
        141.0347,
    ),
    damping=(0.006, 0.004, 0.0004, 0.0019, 0.0011, 0.0015, 0.0016, 0.0027, 0.0003),
    limit=47.2707,
    cutoff=50.1881,
)
"""The rig as `calibrate` finds it from the free vibration in the first 4.5 s of ``x160_multi``,
without knowing the hits."""

SIGMA_Y, SIGMA_FORCE, SIGMA_OFFSET = 0.5, 3.0, 1e-3
"""Of the readings [m/s2], of small forces in every part of a sample [N], of the zeros [m/s2]."""

WIDTHS = (12, 18)
"""Shortest and longest pulse [parts of a sample]."""

SIZES = (40.0, 500.0)
"""Smallest and largest height that is tried [N]."""

BEFORE, AFTER = 56 * SUBSTEPS, 64 * SUBSTEPS


def model(axis: Axis) -> bs.Model:
    """All modes, read through sensors with a limit, a low-pass and an unknown zero."""
    forces = {name: axis.driven[i] for i, name in enumerate(FORCES)}
    outputs = [f"a{j + 1}" for j in range(len(SENSORS))]
    structure = bs.modal(
        axis.frequencies,
        damping=axis.damping,
        sensors={name: ("acceleration", axis.seen[:, j]) for j, name in enumerate(outputs)},
        forces={**forces, TWIST: np.eye(axis.modes)[-1]},
    )
    sensor = bs.models.Sensor(limit=axis.limit, cutoff=axis.cutoff, offset=0.0)
    read_out = bs.models.with_sensors(structure, dict.fromkeys(outputs, sensor), dt=STEP, parts=1)
    return bs.augment(read_out, [f"{name}_offset" for name in outputs])


def in_parts(y: Array) -> xr.Dataset:
    """Readings (n, 4) at the moments at which they were read, one channel after the other."""
    values = np.full((SUBSTEPS * len(y), len(SENSORS)), np.nan)
    for j in range(len(SENSORS)):
        values[j::SUBSTEPS, j] = y[:, j]
    outputs = {f"a{j + 1}": "m/s2" for j in range(len(SENSORS))}
    return bs.from_arrays(y=values, dt=STEP, inputs={}, outputs=outputs)


def estimator(axis: Axis, y: Array) -> bs.CompressiveSensingMHE:
    """What is known of noise, motion and hits."""
    omega, sensors = 2 * np.pi * np.array(axis.frequencies), len(SENSORS)
    known = [s.name for s in model(axis).states]
    start = np.concatenate(
        [LARGEST / omega**2, LARGEST / omega, np.full(sensors, LARGEST / 2), np.ones(sensors)]
    )
    zeros = [f"a{j + 1}_offset" for j in range(sensors)]
    return bs.CompressiveSensingMHE(
        noise=bs.Noise(sigma_y=SIGMA_Y, sigma_w=dict.fromkeys(zeros, SIGMA_OFFSET)),
        prior=bs.Prior(
            sigma_x0=dict(zip(known, start, strict=True)),
            x0=dict(zip(zeros, map(float, y.mean(axis=0)), strict=True)),
        ),
        forces=(*FORCES, TWIST),
        lam=1.0,
        sigma_force=SIGMA_FORCE,
        dictionary=bs.forces.HalfSines(WIDTHS),
    )


def hits_in(y: Array, axis: Axis = CALIBRATED) -> xr.Dataset:
    """Hits in readings (n, 4) [m/s2]."""
    return bs.forces.follow_hits(
        estimator(axis, y),
        model(axis),
        in_parts(y),
        sizes=SIZES,
        before=BEFORE,
        after=AFTER,
        beside=(TWIST,),
    )


def as_hammer(hits: xr.Dataset) -> Hammer:
    """The hits found, as those of the hammer are."""
    heights = np.array([FORCES[str(name)] for name in hits["force"].values])
    return Hammer(hits["time"].values, heights, hits["impulse"].values)


def main(path: Path) -> None:
    """Print the hits of a recording, and how many are right."""
    recording = read(path)
    hits = hits_in(recording.y)
    print(hits[["force", "time", "impulse", "width", "rival"]].to_dataframe().to_string())
    if recording.hammer is not None:
        print(judged(as_hammer(hits), recording.hammer, begin=0.0, end=DT * len(recording.y)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
