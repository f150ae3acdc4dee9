"""How well forces were found: per window, and over the recording."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backsight.types import Array
from backsight_studies.beam.plant import Hit
from backsight_studies.beam.tuning import THRESHOLD


@dataclasses.dataclass(frozen=True)
class Score:
    """How far estimated forces are from the true ones.

    Parameters
    ----------
    mse : float
        Mean square error over all forces of all windows [N2].
    relative : float
        Norm of the error of the output as a share of the norm of the true forces.
    false, false_large : int
        Outputs of at least 1 N and of at least 2 N where nothing struck.
    recovered : tuple of float
        Output at every true hit [N].
    """

    mse: float
    relative: float
    false: int
    false_large: int
    recovered: tuple[float, ...]


def by_window(d: Array, *, windows: int, steps: int) -> Array:
    """Forces (samples, nodes) as every window should find them: (windows, steps, nodes)."""
    return np.stack([d[i : i + steps] for i in range(windows)])


def score(alpha: Array, d: Array, hits: Sequence[Hit]) -> Score:
    """Compare all windows (windows, steps, nodes) with the true forces (samples, nodes)."""
    true, output = d[: len(alpha)], alpha[:, 0]
    elsewhere = np.abs(output[true == 0])
    return Score(
        mse=float(window_mse(alpha, d).mean()),
        relative=float(np.linalg.norm(output - true) / np.linalg.norm(true)),
        false=int((elsewhere >= THRESHOLD).sum()),
        false_large=int((elsewhere >= 2 * THRESHOLD).sum()),
        recovered=tuple(float(output[hit.step, hit.node]) for hit in hits),
    )


def window_mse(alpha: Array, d: Array) -> Array:
    """Mean square error of every window [N2]."""
    windows, steps, _ = alpha.shape
    error = alpha - by_window(d, windows=windows, steps=steps)
    return (error**2).mean(axis=(1, 2))


def counts(alpha: Array) -> Array:
    """Number of forces above the threshold in every window."""
    return (np.abs(alpha) >= THRESHOLD).sum(axis=(1, 2))


def kept(output: Array) -> Array:
    """Outputs above the threshold, 0 for the others."""
    return np.where(np.abs(output) >= THRESHOLD, output, 0.0)


def amplitude_rule(output: Array) -> Array:
    """Spread what is below the threshold over what is above it: the sum of magnitudes is kept."""
    large = kept(output)
    return large * np.abs(output).sum() / np.abs(large).sum()


def energy_rule(output: Array) -> Array:
    """Do the same, and keep the sum of squares."""
    large = kept(output)
    return large * np.sqrt((output**2).sum() / (large**2).sum())


def output_mse(output: Array, d: Array) -> float:
    """Mean square error of the output (windows, nodes) [N2]."""
    return float(((output - d[: len(output)]) ** 2).mean())
