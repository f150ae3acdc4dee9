"""Everything that is worked out: measured and simulated recordings, with and without the limit."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backsight.types import Array
from backsight_studies.frame_hammer.detect import Detection, detect
from backsight_studies.frame_hammer.follow import QUIET, SAMPLES, Track
from backsight_studies.frame_hammer.rig import DT, HEIGHTS
from backsight_studies.frame_hammer.score import Score, judged
from backsight_studies.frame_hammer.source import Hammer, Recording, recordings
from backsight_studies.frame_hammer.sparse import FORCES, Sparse, sparse
from backsight_studies.frame_hammer.straight import straightened
from backsight_studies.frame_hammer.synthetic import simulated
from backsight_studies.frame_hammer.window import Window
from backsight_studies.study import Progress, Recordings

COMPARED = 24
"""Windows in which models with and without the limit are compared."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One recording and what was found in it.

    Parameters
    ----------
    recording : Recording
    detection : Detection
    found : Hammer
        Times, heights and impulses of the hits.
    score : Score, optional
        If the hammer is known.
    limited, unlimited : float
        Unexplained share of the energy between the hits, with the limit of the sensors and when
        they are thought to have none.
    sparse : Sparse, optional
        Compressive-sensing MHE, of measured recordings with the clipping undone.
    sparse_score, direct_score : Score, optional
        Of its hits, and of those that it finds in the readings themselves.
    """

    recording: Recording
    detection: Detection
    found: Hammer
    score: Score | None
    limited: float
    unlimited: float
    sparse: Sparse | None = None
    sparse_score: Score | None = None
    direct_score: Score | None = None


@dataclasses.dataclass(frozen=True)
class Experiment:
    """Measured and simulated cases."""

    measured: tuple[Case, ...]
    simulated: tuple[Case, ...]


def carry_out(seeds: Sequence[int], further: Recordings, progress: Progress) -> Experiment:
    """Work on all recordings; `seeds` of the simulated ones, one per height each."""
    known = recordings(further)
    total = len(known) + len(HEIGHTS) * len(seeds)

    def told(done: int, name: str) -> Progress:
        return lambda _what, share: progress(name, (done + share) / total)

    measured = [
        _with_sparse(_case(recording, told(i, recording.name))) for i, recording in enumerate(known)
    ]
    plans = [(height, seed) for height in HEIGHTS for seed in seeds]
    simulations = [
        _case(simulated(height, seed=seed), told(len(known) + i, "simulated hits"))
        for i, (height, seed) in enumerate(plans)
    ]
    return Experiment(tuple(measured), tuple(simulations))


def _case(recording: Recording, progress: Progress) -> Case:
    detection = detect(recording.y, progress=progress)
    found = Hammer(
        recording.times([hit.sample for hit in detection.hits]),
        np.array([hit.height for hit in detection.hits]),
        np.array([hit.impulse for hit in detection.hits]),
    )
    shares = remaining(detection.track, recording.y)
    return Case(recording, detection, found, _judged(found, recording), *shares)


def _with_sparse(case: Case) -> Case:
    axis, y = case.detection.track.axis, case.recording.y
    straight = sparse(axis, straightened(case.detection.track, y))
    direct = sparse(axis, y - y.mean(axis=0))
    return dataclasses.replace(
        case,
        sparse=straight,
        sparse_score=_judged(_located(straight, case.recording), case.recording),
        direct_score=_judged(_located(direct, case.recording), case.recording),
    )


def _located(found: Sparse, recording: Recording) -> Hammer:
    return Hammer(
        recording.times([hit.time / DT for hit in found.hits]),
        np.array([FORCES[hit.place] for hit in found.hits]),
        np.array([hit.impulse for hit in found.hits]),
    )


def _judged(found: Hammer, recording: Recording) -> Score | None:
    if recording.hammer is None:
        return None
    return judged(found, recording.hammer, begin=recording.start, end=recording.end)


def remaining(track: Track, y: Array) -> tuple[float, float]:
    """Unexplained share of the energy of free windows, with and without a limit of the sensors."""
    window = Window(dataclasses.replace(track.axis, limit=np.inf), SAMPLES)
    energy, limited, unlimited = 0.0, 0.0, 0.0
    chosen = np.unique(np.linspace(0, len(track.free) - 1, COMPARED).astype(int))
    for piece in (track.free[i] for i in chosen):
        signals = np.ascontiguousarray(y[piece.start : piece.start + SAMPLES].T, float)
        start = window.beginning(signals, window.linear(signals))
        energy += float(((signals - signals.mean(axis=1, keepdims=True)) ** 2).sum())
        limited += piece.fit.cost
        unlimited += window.fit(signals, start).cost
    energy = max(energy, COMPARED * SAMPLES * QUIET**2)
    return limited / energy, unlimited / energy
