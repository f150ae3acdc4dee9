"""The numbers of the study as files."""

from pathlib import Path

from backsight_studies.frame_hammer.experiment import Case, Experiment
from backsight_studies.frame_hammer.rig import DT, HEIGHTS, WIDTHS
from backsight_studies.sheets import write_sheet

HITS = (
    "recording", "time_s", "height_m", "impulse_Ns", "width_s",
    *(f"explained_with_{z:.2f}_m" for z in HEIGHTS), "explained_without",
)  # fmt: skip

TRUE = ("recording", "time_s", "height_m", "impulse_Ns")

SPARSE = ("recording", "time_s", "place", "impulse_Ns", "std_Ns")

CALIBRATION = ("recording", "direction", "quantity", "start", "calibrated")


def write_tables(experiment: Experiment, folder: Path) -> None:
    """Write what was found, the truth, the hits of the sparse estimator, and the calibration."""
    cases = (*experiment.measured, *experiment.simulated)
    write_sheet(folder / "hits.csv", HITS, [row for case in cases for row in _hits(case)])
    write_sheet(folder / "hammer.csv", TRUE, [row for case in cases for row in _true(case)])
    write_sheet(folder / "sparse.csv", SPARSE, [row for c in cases for row in _sparse(c)])
    write_sheet(folder / "calibration.csv", CALIBRATION, [r for c in cases for r in _fitted(c)])


def _hits(case: Case) -> list[list[object]]:
    return [
        [
            case.recording.name, float(time), hit.height, hit.impulse, WIDTHS[hit.width],
            *map(float, hit.shares), hit.without,
        ]
        for time, hit in zip(case.found.time, case.detection.hits, strict=True)
    ]  # fmt: skip


def _true(case: Case) -> list[list[object]]:
    hammer = case.recording.hammer
    if hammer is None:
        return []
    rows = zip(hammer.time, hammer.height, hammer.impulse, strict=True)
    return [[case.recording.name, *map(float, row)] for row in rows]


def _sparse(case: Case) -> list[list[object]]:
    if case.sparse is None:
        return []
    hits = case.sparse.hits
    times = case.recording.times([hit.time / DT for hit in hits])
    return [
        [case.recording.name, float(time), h.place, h.impulse, h.std]
        for time, h in zip(times, hits, strict=True)
    ]


def _fitted(case: Case) -> list[list[object]]:
    start, axis = case.detection.start, case.detection.track.axis
    rows = [
        (f"frequency {i + 1} [Hz]", a, b)
        for i, (a, b) in enumerate(zip(start.frequencies, axis.frequencies, strict=True))
    ]
    rows += [
        ("limit [m/s2]", start.limit, axis.limit),
        ("cutoff [Hz]", start.cutoff, axis.cutoff),
    ]
    return [[case.recording.name, start.name, what, float(a), float(b)] for what, a, b in rows]
