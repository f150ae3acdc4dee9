"""Hits in raw readings of the study `frame_hammer`, by the library alone."""

import os
from pathlib import Path

import numpy as np
import pytest

from backsight_studies.frame_hammer import raw, source
from backsight_studies.frame_hammer.rig import DT, HEIGHTS, WEAK
from backsight_studies.frame_hammer.source import read
from backsight_studies.frame_hammer.synthetic import simulated

LOOK = 70
"""Samples behind a hit that a window needs."""

MARGIN = 60
"""Samples before it."""


def compare(y, hammer, axis, height):
    """All hits with a window around them are found at their height, and nothing else is."""
    hits = raw.hits_in(y, axis)
    found = raw.as_hammer(hits)
    inside = (hammer.time > DT * MARGIN) & (hammer.time < DT * (len(y) - LOOK))
    true = hammer.time[inside]
    assert len(true) == len(found.time) > 0
    assert np.abs(found.time - true).max() < 3e-3
    assert (found.height == height).all()
    assert (hits["rival"] > 1.5).all()


@pytest.mark.slow
@pytest.mark.data
def test_measured_hits_are_at_the_right_height():
    path = Path(os.environ.get(source.VARIABLE, ""), source.FOLDER, "x160_multi.npz")
    if not path.exists():
        pytest.skip(
            f"no x160_multi.npz in the folder BACKSIGHT_DATA; it comes from {source.SOURCE}"
        )
    recording = read(path)
    assert recording.hammer is not None
    compare(recording.y[:1000], recording.hammer, raw.CALIBRATED, 1.6)


@pytest.mark.slow
@pytest.mark.parametrize("height", HEIGHTS)
def test_hits_at_every_height(height):
    recording = simulated(height, seed=2, axis=WEAK)
    assert recording.hammer is not None
    last = int(recording.hammer.time[0] / DT) + 150
    compare(recording.y[:last], recording.hammer, WEAK, height)
