"""The weight of sparse forces without truth: ``python -m benchmarks.force_weights``.

Beams that are hit at random (those of the study ``beam_random``), with the right model and with one
whose frequencies are too low. Every way to choose `lam` from a recording alone is judged by F1,
hits found at the right step and place, beside the best weight for all recordings, which only the
truth tells.
"""

import argparse
import time
from collections.abc import Callable, Sequence

import numpy as np

import backsight as bs
from backsight.analysis.forces import compare_forces
from backsight.sparse import refit
from backsight.tune._force_path import unweighted, whole_path
from backsight.tune.lambda_choice import LambdaChoice
from backsight.types import Array
from backsight_studies.beam.plant import THICKNESS, model
from backsight_studies.beam.tuning import THRESHOLD
from backsight_studies.beam_random.scenarios import Scenario, scenario, whole

GRID = np.geomspace(2.0, 100.0, 40)
"""Weights of which the best for all recordings is taken."""

LEAST = 1e-2
"""Weight down to which all solutions are computed, as a share of the largest."""

WAYS: dict[str, Callable[..., LambdaChoice]] = {
    "lambda_from_noise": bs.tune.lambda_from_noise,
    "lambda_from_whiteness": bs.tune.lambda_from_whiteness,
    "lambda_from_sensors": bs.tune.lambda_from_sensors,
    "lambda_from_pairs": bs.tune.lambda_from_pairs,
}
FIT = 'fit(free=["lam"])'
"""What a user gets who does not choose a way."""


def scores(seed: int, thickness: float) -> tuple[Array, dict[str, tuple[float, float, float]]]:
    """F1 of every weight of `GRID`, and by way F1, weight and seconds."""
    s, given, estimator = scenario(seed), model(thickness), whole(thickness, 10.0)
    search = unweighted(estimator, given, s.recording)
    path = whole_path(search, LEAST)

    def f1(lam: float) -> float:
        found = refit(search.regression, path.at(max(lam, path.lam[-1]))[0])
        return _f1(search.forces(found.which, found.values), s)

    ways: dict[str, tuple[float, float, float]] = {}
    for name, way in WAYS.items():
        began = time.process_time()
        lam = way(estimator, given, s.recording).lam
        ways[name] = f1(lam), lam, time.process_time() - began
    began = time.process_time()
    lam = bs.tune.fit(estimator, given, s.recording, free=["lam"]).values["lam"]
    ways[FIT] = f1(lam), lam, time.process_time() - began
    return np.array([f1(lam) for lam in GRID]), ways


def _f1(found: Array, s: Scenario) -> float:
    return compare_forces(found, s.d[: len(found)], least=THRESHOLD).f1


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.force_weights", description=__doc__)
    parser.add_argument("--recordings", type=int, default=50)
    given = parser.parse_args(arguments)
    print("| frequencies | way | F1 | below the best | weights | s |")
    print("|---|---|---|---|---|---|")
    for off, thickness in list(THICKNESS.items())[:2]:
        found = [scores(seed, thickness) for seed in range(given.recordings)]
        of_grid = np.mean([grid for grid, _ in found], axis=0)
        best = float(of_grid.max())
        print(f"| {off:g} % | best for all | {best:.3f} | | {GRID[of_grid.argmax()]:.1f} | |")
        for way in found[0][1]:
            f1, lam, seconds = np.array([ways[way] for _, ways in found]).T
            print(
                f"| {off:g} % | `{way}` | {f1.mean():.3f} | {best - f1.mean():.3f} | "
                f"{lam.min():.0f} to {lam.max():.0f} | {np.median(seconds):.2f} |"
            )


if __name__ == "__main__":
    main()
