"""The checks of the study."""

from collections.abc import Sequence

from backsight_studies.checks import Check
from backsight_studies.frame_hammer.experiment import Case, Experiment
from backsight_studies.frame_hammer.rig import HEIGHTS
from backsight_studies.frame_hammer.score import TOLERANCE

RIGHT, FALSE = 0.9, 0.1
"""Isolated hits at the right height at least, and false alarms at most."""

WHERE = "hits.csv"


def checks(experiment: Experiment) -> list[Check]:
    """Height, time and false alarms of every measured recording and of every simulated height."""
    found = [check for case in experiment.measured for check in _three(case.recording.name, [case])]
    for height in HEIGHTS:
        cases = [c for c in experiment.simulated if _height(c) == height]
        if cases:
            found += _three(f"simulated hits at {height:.2f} m", cases)
    return found


def _height(case: Case) -> float:
    hammer = case.recording.hammer
    return float(hammer.height[0]) if hammer is not None else float("nan")


def _three(name: str, cases: Sequence[Case]) -> list[Check]:
    scores = [case.score for case in cases if case.score is not None]
    isolated, reported = sum(s.isolated for s in scores), sum(s.reported for s in scores)
    if not isolated:
        return []
    right = sum(s.right for s in scores) / isolated
    false = sum(s.false for s in scores) / reported if reported else 0.0
    late = max(s.latest for s in scores)
    return [
        Check(
            f"{name}: isolated hits at the right time and height", RIGHT, right,
            f"at least {RIGHT:g}", bool(right >= RIGHT), WHERE,
        ),
        Check(
            f"{name}: largest error of time [s]", TOLERANCE, late,
            f"at most {TOLERANCE:g}", bool(late <= TOLERANCE), WHERE,
        ),
        Check(
            f"{name}: false alarms, share of all that is reported", FALSE, false,
            f"at most {FALSE:g}", bool(false <= FALSE), WHERE,
        ),
    ]  # fmt: skip
