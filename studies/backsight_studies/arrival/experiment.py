"""Every arrival cost on every plant, and on measured machines if their recordings are there."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.run.estimation import estimate_many
from backsight.types import Array
from backsight_studies.arrival import machines
from backsight_studies.arrival.evaluate import Measures, from_filter, measure, right, typical
from backsight_studies.arrival.machines import Convergence
from backsight_studies.arrival.methods import FREE, Variant, variants
from backsight_studies.arrival.plants import REACTOR, SPRING, Plant, plants
from backsight_studies.study import Progress

SHOWN = 10
"""Horizon of the figures over time."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One estimator on one recording; on the linear plant `distance` from the Kalman filter."""

    plant: str
    label: str
    N: int
    seed: int
    measures: Measures
    distance: float


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All rows, and what the figures show.

    Parameters
    ----------
    plants : tuple of Plant
    seeds : tuple of int
    rows : tuple of Row
    drawn : dict
        Estimator to time, estimates and deviations in the reactor, first recording.
    machines : tuple of Convergence
        On measured recordings; empty where they are missing.
    """

    plants: tuple[Plant, ...]
    seeds: tuple[int, ...]
    rows: tuple[Row, ...]
    drawn: dict[str, dict[str, Array]]
    machines: tuple[Convergence, ...]

    def of(self, plant: str, label: str, N: int) -> list[Measures]:
        """Measures of one estimator, one per seed."""
        return [r.measures for r in self._rows(plant, label, N)]

    def error(self, plant: str, label: str, N: int) -> float:
        """Median over the seeds of the judged state's error."""
        return typical([m.error for m in self.of(plant, label, N)])

    def covered(self, plant: str, label: str, N: int) -> float:
        """Mean over seeds and states of the coverage of the bands."""
        shares = [list(m.covered.values()) for m in self.of(plant, label, N)]
        return float(np.mean(shares))

    def found(self, label: str, N: int) -> int:
        """In how many recordings of the reactor the right optimum was found."""
        return sum(map(right, self.of(REACTOR, label, N)))

    def distance(self, label: str, N: int) -> float:
        """Largest distance from the Kalman filter on the linear plant [standard deviations]."""
        return max(r.distance for r in self._rows(SPRING, label, N))

    def _rows(self, plant: str, label: str, N: int) -> list[Row]:
        return [r for r in self.rows if (r.plant, r.label, r.N) == (plant, label, N)]


def carry_out(seeds: Sequence[int], progress: Progress) -> Experiment:
    """Run everything."""
    studied = plants()
    work = [(plant, variants(plant)) for plant in studied]
    tasks = machines.tasks()
    total = sum(len(listed) for _, listed in work) + len(tasks)
    rows: list[Row] = []
    drawn: dict[str, dict[str, Array]] = {}
    done = 0
    for plant, listed in work:
        recordings = [plant.record(seed) for seed in seeds]
        reference: list[xr.Dataset] = []
        for variant in listed:
            progress(f"{plant.name}: {_named(variant)}", done / total)
            results = _estimated(variant, recordings)
            reference = reference or results
            rows += _rows(plant, variant, seeds, results, reference)
            if plant.name == REACTOR and variant.N in (0, SHOWN) and variant.label != FREE:
                drawn[_named(variant)] = _series(results[0])
            done += 1
    measured = []
    for task in tasks:
        progress(task.what, done / total)
        measured.append(task.carry_out())
        done += 1
    return Experiment(studied, tuple(seeds), tuple(rows), drawn, tuple(measured))


def _named(variant: Variant) -> str:
    return variant.label if variant.N == 0 else f"{variant.label}, N = {variant.N}"


def _estimated(variant: Variant, recordings: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Results of all recordings, also of those on which the estimate was lost."""
    return estimate_many(variant.estimator, variant.model, recordings, throw=False)


def _rows(
    plant: Plant,
    variant: Variant,
    seeds: Sequence[int],
    results: Sequence[xr.Dataset],
    reference: Sequence[xr.Dataset],
) -> list[Row]:
    return [
        Row(
            plant.name,
            variant.label,
            variant.N,
            seed,
            measure(plant, result),
            from_filter(result, best) if plant.name == SPRING else np.nan,
        )
        for seed, result, best in zip(seeds, results, reference, strict=True)
    ]


def _series(result: xr.Dataset) -> dict[str, Array]:
    return {
        "time": result["time"].values,
        "truth": result["x_true"].sel(state=result["state"]).values,
        "x": result["x_hat"].values,
        "std": result["x_std"].values,
    }
