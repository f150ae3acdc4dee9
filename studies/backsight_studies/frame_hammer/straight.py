"""Signals as sensors without limit would have given them, all channels at the same time.

A linear estimator needs them: what the clipping took away is added from the motion that was found.
Modes beyond half the sampling frequency, which the readings show folded down, are taken out.
"""

import numpy as np
from numpy.typing import NDArray

from backsight.types import Array
from backsight_studies.frame_hammer.follow import ADVANCE, LOOK, SAMPLES, Track
from backsight_studies.frame_hammer.rig import DT, SENSORS, SUBSTEPS, Axis
from backsight_studies.frame_hammer.window import CHANNELS, Window, low_passed


def slow(axis: Axis) -> NDArray[np.bool_]:
    """Which modes are below half the sampling frequency, (modes,)."""
    return np.array(axis.frequencies) < 0.5 / DT


def straightened(track: Track, y: Array) -> Array:
    """Signals of unlimited sensors for the slow modes, (n, 4); NaN where no motion was found."""
    everything, wanted = _raw(track, len(y))
    axis = track.axis
    clipped = np.clip(everything, -axis.limit, axis.limit)
    read = SUBSTEPS * np.arange(len(y))
    taken = _low_pass(axis, clipped)[CHANNELS, read + CHANNELS]
    given = _low_pass(axis, wanted)[:, read]
    left = y.T - taken
    left = left - np.nanmedian(left, axis=1, keepdims=True)
    return (left + given).T


def _raw(track: Track, samples: int) -> tuple[Array, Array]:
    """Raw accelerations of all modes and of the slow ones, (4, sub-steps)."""
    axis = track.axis
    window = Window(axis, SAMPLES + ADVANCE + LOOK)
    chosen = np.repeat(slow(axis), 2)
    filtered = Window(axis.only(slow(axis)), window.samples)
    steps = samples * SUBSTEPS + len(SENSORS)
    everything, wanted = np.full((2, len(SENSORS), steps), np.nan)
    starts = [p.start for p in track.pieces[1:]] + [samples]
    for piece, end in zip(track.pieces, starts, strict=True):
        length = min(end - piece.start, window.samples) * SUBSTEPS
        place = slice(piece.start * SUBSTEPS, piece.start * SUBSTEPS + length)
        unknowns = np.concatenate([piece.fit.modes, piece.fit.hits])
        columns = window.columns(piece.pulses)[..., :length]
        everything[:, place] = np.tensordot(unknowns, columns, 1)
        unknowns = np.concatenate([piece.fit.modes[chosen], piece.fit.hits])
        columns = filtered.columns(piece.pulses)[..., :length]
        wanted[:, place] = np.tensordot(unknowns, columns, 1)
    return everything, wanted


def _low_pass(axis: Axis, raw: Array) -> Array:
    return np.where(np.isnan(raw), np.nan, low_passed(axis, np.nan_to_num(raw)))
