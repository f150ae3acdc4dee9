"""Beams that are hit at random, the methods that look for the hits, and their settings."""

import dataclasses
import functools
import math

import numpy as np
import xarray as xr

from backsight.estimators.cs_mhe import Carryover, CompressiveSensingMHE
from backsight.estimators.uncertainty import Noise
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures.modal import modal
from backsight.sparse import L1, AbstractSelection, Greedy, Reweighted
from backsight.types import Array
from backsight_studies.beam import tuning
from backsight_studies.beam.plant import (
    DAMPING,
    FORCES,
    NODES,
    SAMPLES,
    SENSORS,
    Hit,
    N,
    forces,
    frequencies,
    model,
    struck,
)
from backsight_studies.beam.tuning import Setting

NOISE = 1e-5
"""Standard deviation of the sensors [m]."""

HITS, APART = 4, 4
"""Number of hits of a scenario, and steps between them at least."""

SIZES = (3.0, 12.0)
"""Range of the sizes [N]; the sign is random."""

FIRST = 3
"""First step at which the beam may be hit; the last is that of the last full window."""


@dataclasses.dataclass(frozen=True)
class Scenario:
    """One beam that was hit.

    Parameters
    ----------
    d : (samples, nodes) array
        True forces [N].
    recording : xarray.Dataset
    """

    d: Array
    recording: xr.Dataset


def scenario(seed: int) -> Scenario:
    """Places, moments, sizes and noise of a seed."""
    rng = np.random.default_rng([seed, 0])
    steps: list[int] = []
    while len(steps) < HITS:
        step = int(rng.integers(FIRST, SAMPLES - N))
        if all(abs(step - other) >= APART for other in steps):
            steps.append(step)
    hits = [
        Hit(step, int(rng.integers(len(NODES))), float(rng.uniform(*SIZES) * rng.choice([-1, 1])))
        for step in sorted(steps)
    ]
    d = forces(tuple(hits))
    return Scenario(d, struck(d, sigma=NOISE, seed=seed))


PAPER = "Algorithm 1, reading I"
L1_WINDOW = "l1, no carryover"
READING_3 = "reading III"
GATED = "reading III, age gate"


def _exponents(Q: float, lam: float) -> Setting:
    return Setting(math.exp(Q) * 1e-2, math.exp(lam) * 1e-10)


WINDOWED: dict[str, tuple[Setting, Carryover | None]] = {
    PAPER: (_exponents(8, 19), tuning.CARRYOVERS[tuning.READING_1]),
    L1_WINDOW: (_exponents(5, 21), None),
    READING_3: (_exponents(5, 21), tuning.CARRYOVERS[tuning.READING_3]),
    GATED: (_exponents(5, 21), Carryover((100.0, 1000.0), "separate", age=4)),
}
"""Methods that decide window by window; each with the best weights of a coarse search."""

REFITTED, REWEIGHTED, L0 = "l1 with refit", "reweighted l1 with refit", "l0"

WHOLE: dict[str, AbstractSelection] = {
    REFITTED: L1(),
    REWEIGHTED: Reweighted(),
    L0: Greedy(),
}
"""Methods that decide after the recording has ended."""

CALIBRATED = ", calibrated"
"""Added to the name of a method that was given the calibrated model."""


WEIGHTS = {"": 12.0, CALIBRATED: 5.0}
"""Of the l1 norm over whole recordings; with a wrong model small ones find too much [1/N]."""


def whole(thickness: float, lam: float) -> CompressiveSensingMHE:
    """Settings of the methods that see the whole recording: the noise as it is, few forces."""
    setting = Setting(tuning.TABLE[0.0].eps_Q, lam, NOISE**2)
    return dataclasses.replace(
        tuning.estimator(thickness, setting), noise=Noise(sigma_y=NOISE), threshold=0.0
    )


@functools.cache
def response_shapes(thickness: float) -> tuple[Array, Array]:
    """Columns of the forces, and rows of the sensors, in continuous time."""
    _, B, C, _ = state_space(forces_as_inputs(model(thickness), FORCES))
    return B, C


@dataclasses.dataclass(frozen=True)
class ByFrequencies:
    """The thin beam with other natural frequencies: shapes and masses stay wrong."""

    thickness: float

    def __call__(self, values: dict[str, float]) -> Model:
        """Build the model of frequencies ``f1, f2, f3`` [Hz]."""
        B, C = response_shapes(self.thickness)
        modes = len(values)
        return modal(
            list(values.values()),
            damping=DAMPING,
            sensors={s: ("displacement", C[i, :modes]) for i, s in enumerate(SENSORS)},
            forces={name: B[modes:, i] for i, name in enumerate(FORCES)},
        )

    def start(self) -> dict[str, float]:
        """Frequencies of the thin beam."""
        return {f"f{i}": float(f) for i, f in enumerate(frequencies(self.thickness), 1)}
