"""From accelerations to hits: direction, motion, calibration, motion again."""

import dataclasses
from collections.abc import Callable

import numpy as np

from backsight.errors import DataError
from backsight.types import Array
from backsight_studies.frame_hammer.calibrate import calibrated
from backsight_studies.frame_hammer.follow import (
    SAMPLES,
    Hit,
    Track,
    first_fit,
    follow,
    unexplained,
)
from backsight_studies.frame_hammer.rig import AXES, WIDTHS, Axis
from backsight_studies.frame_hammer.window import Window

LOOKED_AT = 6
"""Windows by which the direction of the hits is found: those with the most energy of
`CANDIDATES` evenly over the recording, but for the upper quarter, in which there may be a hit."""

CANDIDATES = 48

UNDERSTOOD = 0.3
"""Unexplained share of the energy up to which the model is thought to be that of the rig."""

REBOUND = 0.25
"""Hits below this share of the usual size are rebounds of the hammer, and no hits."""


@dataclasses.dataclass(frozen=True)
class Detection:
    """What was found in a recording.

    Parameters
    ----------
    start : Axis
        Direction of the hits, as described.
    track : Track
        Motion and all pulses, with the calibrated axis.
    hits : tuple of Hit
        Pulses that are hits.
    shares : dict
        Name of the direction to the unexplained share by which it was chosen.
    """

    start: Axis
    track: Track
    hits: tuple[Hit, ...]
    shares: dict[str, float]


def detect(
    y: Array, *, progress: Callable[[str, float], None] = lambda _what, _share: None
) -> Detection:
    """Find hits in accelerations (n, 4) [m/s2].

    Raises
    ------
    DataError
        If the beam does not swing as that of the rig, in either direction.
    """
    progress("direction", 0.0)
    shares = {axis.name: _share(axis, y) for axis in AXES}
    start = min(AXES, key=lambda axis: shares[axis.name])
    if shares[start.name] > UNDERSTOOD:
        raise DataError(
            "the accelerations are not those of the rig: its modes leave "
            f"{shares[start.name]:.0%} of their energy unexplained"
        )
    first = follow(start, y, progress=lambda share: progress("following", 0.05 + 0.6 * share))
    track = follow(
        calibrated(start, y, first.free),
        y,
        widths=_usual_widths(first),
        progress=lambda share: progress("following again", 0.7 + 0.3 * share),
    )
    return Detection(start, track, hits_among(track.hits), shares)


def _usual_widths(track: Track) -> tuple[int, ...]:
    """The pulse that fits most hits: a hammer has one tip, and sizes become comparable."""
    counts = np.bincount([hit.width for hit in track.hits], minlength=len(WIDTHS))
    return (int(np.argmax(counts)),) if counts.any() else tuple(range(len(WIDTHS)))


def hits_among(pulses: tuple[Hit, ...]) -> tuple[Hit, ...]:
    """Leave out the rebounds."""
    if not pulses:
        return ()
    usual = np.median([abs(hit.impulse) for hit in pulses])
    return tuple(hit for hit in pulses if abs(hit.impulse) >= REBOUND * usual)


def _share(axis: Axis, y: Array) -> float:
    """Median of what the modes of an axis leave unexplained."""
    window = Window(axis, SAMPLES)
    starts = np.linspace(0, len(y) - SAMPLES, CANDIDATES).astype(int)
    signals = [np.ascontiguousarray(y[k : k + SAMPLES].T, float) for k in starts]
    by_energy = sorted(signals, key=lambda s: float(s.std()))[: 3 * CANDIDATES // 4]
    chosen = by_energy[-LOOKED_AT:]
    return float(np.median([unexplained(s, first_fit(window, s).cost) for s in chosen]))
