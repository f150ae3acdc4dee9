"""The checks of the study: numbers of an independent implementation on other scenarios."""

import math

from backsight_studies.beam.plant import THICKNESS
from backsight_studies.beam_random.experiment import Experiment
from backsight_studies.beam_random.scenarios import (
    CALIBRATED,
    GATED,
    L0,
    L1_WINDOW,
    PAPER,
    READING_3,
    REWEIGHTED,
)
from backsight_studies.checks import Check

BEST = 0.98
"""Least F1 of l0 with the calibrated model, in every mismatch."""

EXPECTED: dict[str, tuple[float, float, float, float]] = {
    PAPER: (0.68, 0.69, 0.69, 0.67),
    L1_WINDOW: (0.96, 0.95, 0.83, 0.70),
    GATED: (0.99, 0.96, 0.80, 0.61),
    L0: (0.97, 0.97, 0.93, 0.84),
    L0 + CALIBRATED: (1.00, 1.00, 1.00, 1.00),
    REWEIGHTED + CALIBRATED: (0.99, 0.99, 0.99, 0.99),
}
"""F1 by mismatch with 50 other scenarios; weights were chosen there for each method on its own."""

MAGNITUDE: dict[str, tuple[float, float, float, float]] = {
    L1_WINDOW: (0.18, 0.26, 0.36, 0.46),
    GATED: (0.02, 0.07, 0.17, 0.30),
    L0 + CALIBRATED: (0.01, 0.04, 0.07, 0.10),
}
"""Mean relative error of the sizes."""

ALLOWED = 0.1
"""Of F1 and of sizes: other scenarios and other weights."""


def checks(e: Experiment) -> list[Check]:
    """All checks."""
    count = len(next(iter(e.outcomes.values())))
    rows = [_best(e, m) for m in THICKNESS]
    for m in THICKNESS:
        best, paper = (e.mean(k, m, "f1") for k in (L0 + CALIBRATED, PAPER))
        rows.append(
            Check(
                f"l0 with calibration against the paper's method: F1, {m:g} %",
                "at least 0.2 more", best - paper, "at least 0.2", best - paper >= 0.2,
                "methods.csv",
            )
        )  # fmt: skip
        alarms = e.mean(L0 + CALIBRATED, m, "false_alarms")
        rows.append(
            Check(
                f"l0 with calibration: false alarms per recording, {m:g} %",
                0.0, alarms, "at most 0.1", alarms <= 0.1, "methods.csv",
            )
        )  # fmt: skip
        gated, plain = (e.mean(k, m, "magnitude") for k in (GATED, L1_WINDOW))
        rows.append(
            Check(
                f"age gate against the l1 norm alone: error of the sizes, {m:g} %",
                "smaller", gated - plain, "below 0", gated < plain, "methods.csv",
            )
        )  # fmt: skip
    gated, plain = (e.mean(k, 0.0, "f1") for k in (GATED, READING_3))
    rows.append(
        Check(
            "age gate against carrying over at once: F1, 0 %",
            "larger", gated - plain, "above 0", gated > plain, "methods.csv",
        )
    )  # fmt: skip
    # Few scenarios say little about means.
    spread = ALLOWED * max(1.0, math.sqrt(50 / count))
    for field, expected in (("f1", EXPECTED), ("magnitude", MAGNITUDE)):
        for method, values in expected.items():
            for m, value in zip(THICKNESS, values, strict=True):
                found = e.mean(method, m, field)
                error = abs(found - value)
                name = {"f1": "F1", "magnitude": "error of the sizes"}[field]
                rows.append(
                    Check(
                        f"{name}: {method}, {m:g} %", value, found, f"within {spread:.2g}",
                        error <= spread, "methods.csv",
                    )
                )  # fmt: skip
    return rows


def _best(e: Experiment, m: float) -> Check:
    found = e.mean(L0 + CALIBRATED, m, "f1")
    name = f"l0 with calibration: F1, {m:g} %"
    return Check(name, BEST, found, f"at least {BEST}", found >= BEST, "methods.csv")
