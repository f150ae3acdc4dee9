"""Every estimator on every recording."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from backsight.errors import DataError
from backsight_studies.nanopositioner.evaluate import (
    Measures,
    check_length,
    measure,
    run_variant,
)
from backsight_studies.nanopositioner.plant import read_recording, simulate_stage
from backsight_studies.nanopositioner.tuning import (
    ALPHA,
    CONVERGED,
    PAPER_RULE,
    PAPER_RULE_NEWTON,
    Variant,
    ekf,
    ekf_retuned,
    ekf_trusting,
    mho,
    mho_weighted,
)
from backsight_studies.study import Progress, Recordings

SCENARIOS = {"nominal": 0.0, "mode2": 0.3}
"""Name to the gain of the second mode, of which the estimators do not know."""

SWEEP = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
"""Weights of the measurements in the window."""


@dataclasses.dataclass(frozen=True, eq=False)
class Trial:
    """A recording.

    Parameters
    ----------
    scenario : str
        One of `SCENARIOS`, or the name of the file.
    seed : int or None
        None for a file.
    stage : xarray.Dataset
    """

    scenario: str
    seed: int | None
    stage: xr.Dataset

    @property
    def label(self) -> str:
        """Scenario and seed."""
        return self.scenario if self.seed is None else f"{self.scenario}, seed {self.seed}"


@dataclasses.dataclass(frozen=True)
class Row:
    """What one estimator reached on one recording."""

    trial: Trial
    variant: Variant
    measures: Measures


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All rows, and the results on one recording for the figures.

    Parameters
    ----------
    rows : tuple of Row
    shown : Trial
        The recording of the figures.
    results : dict
        Label of the variant to its result on `shown`.
    """

    rows: tuple[Row, ...]
    shown: Trial
    results: dict[str, xr.Dataset]

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of the scenarios and files, in order."""
        return tuple(dict.fromkeys(r.trial.scenario for r in self.rows))

    def trials(self, scenario: str) -> list[dict[str, Measures]]:
        """For every seed, the measures by the label of the variant."""
        found: dict[str, dict[str, Measures]] = {}
        for r in self.rows:
            if r.trial.scenario == scenario:
                found.setdefault(r.trial.label, {})[r.variant.label] = r.measures
        return list(found.values())


def compared() -> list[Variant]:
    """The estimators that are run on every recording."""
    return [ekf(), *(mho(method, solver) for solver in (CONVERGED, PAPER_RULE) for method in ALPHA)]


def swept() -> list[Variant]:
    """Other weights than the two of the paper."""
    return [mho_weighted(alpha) for alpha in SWEEP if alpha not in ALPHA.values()]


def explored() -> list[Variant]:
    """The estimators that are run on the first recording of a scenario only."""
    return [ekf_trusting(), ekf_retuned(), *(mho(m, PAPER_RULE_NEWTON) for m in ALPHA), *swept()]


def carry_out(seeds: Sequence[int], recordings: Recordings, progress: Progress) -> Experiment:
    """Run everything.

    Raises
    ------
    DataError
        If there is nothing to do, or a recording does not have the right form.
    """
    if not seeds and not recordings:
        raise DataError("the study has neither seeds nor recordings: give at least one")
    simulated = [
        Trial(scenario, seed, simulate_stage(seed, mode2=gain))
        for scenario, gain in SCENARIOS.items()
        for seed in dict.fromkeys(seeds)
    ]
    trials = simulated + _read(recordings)
    firsts = [t for t in simulated if t.seed == seeds[0]]
    shown = firsts[-1] if firsts else trials[0]
    jobs = [(t, v) for t in trials for v in compared() + (explored() if t in firsts else [])]
    rows, results = [], {}
    for i, (trial, variant) in enumerate(jobs):
        progress(f"{trial.label}: {variant.label}", i / len(jobs))
        result = run_variant(variant, trial.stage)
        rows.append(Row(trial, variant, measure(result, trial.stage)))
        if trial is shown:
            results[variant.label] = result
    return Experiment(tuple(rows), shown, results)


def _read(recordings: Recordings) -> list[Trial]:
    paths = [Path(p) for p in recordings]
    count = Counter(p.stem for p in paths)
    found = []
    for path in paths:
        stage = read_recording(path)
        check_length(stage, str(path))
        found.append(Trial(path.stem if count[path.stem] == 1 else str(path), None, stage))
    return found
