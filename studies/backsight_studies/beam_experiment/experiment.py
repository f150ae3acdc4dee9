"""Everything that the study computes."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from backsight.engine.parallel import in_threads
from backsight.run.sparse_forces import find_sparse_forces
from backsight.sparse import Greedy
from backsight.types import Array
from backsight_studies.beam.evaluate import counts, window_mse
from backsight_studies.beam.plant import DT, THICKNESS, N, frequencies, model
from backsight_studies.beam.tuning import (
    CARRYOVERS,
    NO_CARRYOVER,
    READING_1,
    READING_3,
    TABLE,
    THRESHOLD,
    Setting,
    estimator,
)
from backsight_studies.beam.windows import Windows, program
from backsight_studies.beam_experiment.plant import FREQUENCIES, NODE, reference, struck
from backsight_studies.study import Progress

EXACT = "no model error"
BEAMS = {**FREQUENCIES, EXACT: tuple(float(f) for f in frequencies(THICKNESS[0.0]))}
"""Name to the frequencies of the true beam [Hz]."""

NOISE = 1e-5
"""Standard deviation of the sensors, where there is noise [m]."""

WEIGHTS = {
    (NO_CARRYOVER, 0.0): (11, 16),
    (READING_1, 0.0): (8, 18),
    (READING_3, 0.0): (8, 18),
    (NO_CARRYOVER, NOISE): (5, 22),
    (READING_1, NOISE): (5, 22),
    (READING_3, NOISE): (5, 20),
}
"""(reading, noise) to the exponents of eps_Q = e^j 1e-2 and lam = e^l 1e-10 with the least MSE."""

STEPS = (17, 18)
"""Steps in whose middle the reference is not zero."""


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All results.

    Parameters
    ----------
    windows : dict
        (beam, noise, reading) to the windows of every recording: one per seed, or one in all
        without noise.
    l0 : dict
        (beam, noise) to the forces that the l0 norm finds in every recording (samples, nodes) [N].
    """

    windows: dict[tuple[str, float, str], list[Windows]]
    l0: dict[tuple[str, float], list[Array]]

    def output(self, beam: str, noise: float, reading: str) -> Array:
        """Outputs of every recording (recordings, windows, nodes) [N]."""
        return np.array([w.output for w in self.windows[beam, noise, reading]])

    def mse(self, beam: str, noise: float, reading: str) -> Array:
        """MSE of every window (recordings, windows) [N2]."""
        d = reference()
        return np.array([window_mse(w.alpha, d) for w in self.windows[beam, noise, reading]])

    def number(self, beam: str, noise: float, reading: str) -> Array:
        """Forces above the threshold in every window (recordings, windows)."""
        return np.array([counts(w.alpha) for w in self.windows[beam, noise, reading]])


def carry_out(seeds: Sequence[int], progress: Progress) -> Experiment:
    """Compute everything; the noise is that of the seeds."""
    progress("simulating", 0.0)
    recordings = {
        (beam, sigma): [
            struck(found, sigma=sigma, seed=seed) for seed in (seeds if sigma else seeds[:1])
        ]
        for beam, found in BEAMS.items()
        for sigma in (0.0, NOISE)
    }
    progress("window by window", 0.2)

    def solved(key: tuple[str, float]) -> dict[tuple[str, float, str], list[Windows]]:
        reading, sigma = key
        j, k = WEIGHTS[key]
        setting = Setting(math.exp(j) * 1e-2, math.exp(k) * 1e-10)
        made = estimator(THICKNESS[0.0], setting, carryover=CARRYOVERS[reading])
        ready = program(made, model(THICKNESS[0.0]), DT)
        return {
            (beam, sigma, reading): [ready.run(r) for r in recordings[beam, sigma]]
            for beam in BEAMS
        }

    windows = {}
    for found in in_threads(solved, list(WEIGHTS)):
        windows |= found
    progress("whole recordings", 0.6)
    l0 = {}
    setting = Setting(TABLE[0.0].eps_Q, 12.0)
    made = dataclasses.replace(estimator(THICKNESS[0.0], setting), threshold=0.0)
    for key, found in recordings.items():
        results = [
            find_sparse_forces(made, model(THICKNESS[0.0]), r, selection=Greedy()) for r in found
        ]
        l0[key] = [result["d_hat"].values for result in results]
    return Experiment(windows, l0)


def elsewhere(output: Array) -> Array:
    """Number of outputs above the threshold off the hammer, by recording; (recordings, ...)."""
    large = np.abs(output) >= THRESHOLD
    for step in STEPS:
        large[:, step, NODE] = False
    return large.sum(axis=(1, 2))


def neighbour(output: Array) -> Array:
    """Whether a recording has an output above the threshold on the next node, while it is hit."""
    return np.any(np.abs(output[:, list(STEPS), NODE + 1]) >= THRESHOLD, axis=1)


def delay(found: Windows) -> int:
    """Samples from the first that all of the force has moved until a window shows all of it."""
    first = STEPS[-1] + 1 - N
    for i in range(first, STEPS[0] + 1):
        here = [found.alpha[i, step - i, NODE] for step in STEPS]
        if min(np.abs(here)) >= THRESHOLD:
            return i - first
    return N
