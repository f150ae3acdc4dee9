"""Everything that the study computes."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backsight.analysis.forces import compare_forces
from backsight.engine.parallel import in_processes, in_threads
from backsight.run.sparse_forces import find_sparse_forces
from backsight.tune.calibration import calibrate
from backsight.types import Array
from backsight_studies.beam.plant import DT, THICKNESS, frequencies, model
from backsight_studies.beam.tuning import THRESHOLD, estimator
from backsight_studies.beam.windows import program
from backsight_studies.beam_random.scenarios import (
    CALIBRATED,
    WEIGHTS,
    WHOLE,
    WINDOWED,
    ByFrequencies,
    Scenario,
    scenario,
    whole,
)
from backsight_studies.study import Progress

SPAN, POINTS = 0.16, 9
"""Common scales of the frequencies that a calibration tries."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How well the hits of one scenario were found.

    Parameters
    ----------
    f1 : float
        With the right step and place.
    f1_near : float
        One step and one place off are right, too.
    false_alarms : int
    magnitude : float
        Mean relative error of the size of the hits found; NaN if none was.
    """

    f1: float
    f1_near: float
    false_alarms: int
    magnitude: float


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All results.

    Parameters
    ----------
    outcomes : dict
        (method, mismatch) to the outcome of every scenario.
    detuning : dict
        Mismatch to the relative errors of the calibrated frequencies (scenarios, modes).
    """

    outcomes: dict[tuple[str, float], list[Outcome]]
    detuning: dict[float, Array]

    def mean(self, method: str, mismatch: float, field: str) -> float:
        """Mean over the scenarios of a field of `Outcome`, where it is known."""
        values = [getattr(o, field) for o in self.outcomes[method, mismatch]]
        return float(np.nanmean(values))


def carry_out(seeds: Sequence[int], progress: Progress) -> Experiment:
    """Run all methods on the scenarios of the seeds."""
    progress("window by window", 0.0)
    scenarios = [scenario(seed) for seed in seeds]
    keys = [(method, m) for method in WINDOWED for m in THICKNESS]
    found = in_threads(lambda key: _windowed(*key, scenarios), keys)
    outcomes = dict(zip(keys, found, strict=True))
    jobs = [(seed, m) for m in THICKNESS for seed in seeds]
    results = in_processes(
        recorded,
        jobs,
        progress=lambda done: progress("whole recordings, calibration", done / len(jobs)),
    )
    detuning = {}
    for m in THICKNESS:
        of = [r for (_, mismatch), r in zip(jobs, results, strict=True) if mismatch == m]
        for method in of[0][0]:
            outcomes[method, m] = [by_method[method] for by_method, _ in of]
        detuning[m] = np.array([errors for _, errors in of])
    return Experiment(outcomes, detuning)


def _windowed(method: str, mismatch: float, scenarios: Sequence[Scenario]) -> list[Outcome]:
    setting, carryover = WINDOWED[method]
    thickness = THICKNESS[mismatch]
    made = estimator(thickness, setting, carryover=carryover)
    ready = program(made, model(thickness), DT)
    outcomes = []
    for s in scenarios:
        output = ready.run(s.recording).output
        outcomes.append(outcome(output, s.d[: len(output)]))
    return outcomes


def outcome(found: Array, true: Array) -> Outcome:
    """Compare forces (steps, nodes) with the true ones; small ones do not count."""
    exact = compare_forces(found, true, least=THRESHOLD)
    near = compare_forces(found, true, least=THRESHOLD, steps=1, places=1)
    return Outcome(exact.f1, near.f1, exact.false_alarms, exact.magnitude)


def recorded(job: tuple[int, float]) -> tuple[dict[str, Outcome], list[float]]:
    """Whole-recording methods on one scenario, with the wrong and with the calibrated model."""
    seed, mismatch = job
    s, thickness = scenario(seed), THICKNESS[mismatch]
    by = ByFrequencies(thickness)
    unsure = whole(thickness, WEIGHTS[""])
    fit = calibrate(unsure, by, s.recording, by.start(), span=SPAN, points=POINTS)
    outcomes = {}
    for suffix, chosen in (("", model(thickness)), (CALIBRATED, fit.model)):
        made = whole(thickness, WEIGHTS[suffix])
        for method, selection in WHOLE.items():
            result = find_sparse_forces(made, chosen, s.recording, selection=selection)
            outcomes[method + suffix] = outcome(result["d_hat"].values, s.d)
    true = frequencies(THICKNESS[0.0])
    return outcomes, list(np.array(list(fit.values.values())) / true - 1)
