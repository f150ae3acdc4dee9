"""The weight of sparse forces without truth: ``python -m backsight_studies.beam_random.weights``.

Beams that are hit at random, with the right model and with one whose frequencies are too low. Ways
to choose `lam` from a recording alone are judged by F1, hits found at the right step and place,
beside the best weight for all recordings, which only the truth tells.
"""

import argparse
import time
from collections.abc import Callable, Sequence

import numpy as np

import backsight as bs
from backsight.run.sparse_forces import find_sparse_forces
from backsight.sparse import L1
from backsight.tune.lambda_choice import LambdaChoice
from backsight.types import Array
from backsight_studies.beam.plant import THICKNESS, model
from backsight_studies.beam_random.experiment import outcome
from backsight_studies.beam_random.scenarios import scenario, whole

GRID = np.geomspace(4.0, 40.0, 12)
"""Weights of which the best for all recordings is taken."""

WAYS: dict[str, Callable[..., LambdaChoice]] = {
    "lambda_from_noise": bs.tune.lambda_from_noise,
    "lambda_from_whiteness": bs.tune.lambda_from_whiteness,
    "lambda_from_sensors": bs.tune.lambda_from_sensors,
    "lambda_from_pairs": bs.tune.lambda_from_pairs,
    "lambda_from_scaled_noise": bs.tune.lambda_from_scaled_noise,
}


def scores(seed: int, thickness: float) -> tuple[Array, dict[str, tuple[float, float, float]]]:
    """F1 of every weight of `GRID`, and by way F1, weight and seconds."""
    s, given = scenario(seed), model(thickness)

    def f1(lam: float) -> float:
        found = find_sparse_forces(whole(thickness, lam), given, s.recording, selection=L1())
        return outcome(found["d_hat"].values, s.d).f1

    ways: dict[str, tuple[float, float, float]] = {}
    for name, way in WAYS.items():
        began = time.process_time()
        lam = way(whole(thickness, 10.0), given, s.recording).lam
        ways[name] = f1(lam), lam, time.process_time() - began
    return np.array([f1(lam) for lam in GRID]), ways


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m backsight_studies.beam_random.weights", description=__doc__
    )
    parser.add_argument("--recordings", type=int, default=50)
    given = parser.parse_args(arguments)
    print("| frequencies | way | F1 | below the best | weights | s |")
    print("|---|---|---|---|---|---|")
    for off, thickness in list(THICKNESS.items())[:2]:
        found = [scores(seed, thickness) for seed in range(given.recordings)]
        of_grid = np.mean([grid for grid, _ in found], axis=0)
        best = float(of_grid.max())
        print(f"| {off:g} % | best for all | {best:.3f} | | {GRID[of_grid.argmax()]:.1f} | |")
        for way in WAYS:
            f1, lam, seconds = np.array([ways[way] for _, ways in found]).T
            print(
                f"| {off:g} % | `{way}` | {f1.mean():.3f} | {best - f1.mean():.3f} | "
                f"{lam.min():.0f} to {lam.max():.0f} | {np.median(seconds):.2f} |"
            )


if __name__ == "__main__":
    main()
