"""The weight lam against the error, alone and over a map of both covariances."""

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import xarray as xr

from backsight.engine.parallel import in_threads
from backsight.types import Array
from backsight_studies.beam.evaluate import window_mse
from backsight_studies.beam.plant import DT, THICKNESS, forces, model, struck
from backsight_studies.beam.tuning import EPS_R, Setting, estimator
from backsight_studies.beam.windows import Program, program

Job = TypeVar("Job")
Result = TypeVar("Result")

STEP = 0.5
"""Distance of the weights in the exponent of e."""

DECADES = 12.0
"""The weights reach from that which finds nothing down by this exponent of e."""

Q_EXPONENTS = (-1, 2, 5, 8, 11, 14)
R_EXPONENTS = (-1, 2, 5, 8, 11)
"""The map: eps_Q = e^j 1e-2 N2, eps_R = e^k 1e-10 m2."""


@dataclasses.dataclass(frozen=True)
class Curve:
    """Error over the weight.

    Parameters
    ----------
    lam, mse : (n,) arrays
        [1/N], [N2]
    """

    lam: Array
    mse: Array

    @property
    def best(self) -> float:
        """Weight with the least error."""
        return float(self.lam[self.mse.argmin()])


@dataclasses.dataclass(frozen=True)
class Map:
    """Least error and the weight for it, over both covariances.

    Parameters
    ----------
    mse, lam : (eps_Q, eps_R) arrays
    """

    mse: Array
    lam: Array


def built(thickness: float, setting: Setting) -> Program:
    """Compile the estimator without carryover."""
    return program(estimator(thickness, setting), model(thickness), DT)


def curve(made: Program, recording: xr.Dataset) -> Curve:
    """Error over weights that are powers of e, a multiple of `STEP` each, times 1e-10."""
    d = recording_forces(recording)
    nothing = made.run_with(recording, 1e6).lam_max.max()
    last = np.floor(np.log(nothing * 1e10) / STEP) * STEP
    exponents = np.arange(last - DECADES, last + STEP / 2, STEP)
    lam = np.exp(exponents) * 1e-10
    errors = [window_mse(made.run_with(recording, value).alpha, d).mean() for value in lam]
    return Curve(lam, np.array(errors))


def recording_forces(recording: xr.Dataset) -> Array:
    """Return the true forces of a recording (samples, nodes)."""
    names = [str(n) for n in recording["state"].values if str(n).startswith("F")]
    return recording["x_true"].sel(state=names).values


def maps(progress: Callable[[float], None]) -> dict[float, Map]:
    """Map of every mismatch, without noise.

    Cost times a constant has the same minimiser: only eps_Q / eps_R and lam * eps_R count. So
    every line of constant eps_Q / eps_R needs one curve.

    Parameters
    ----------
    progress : callable
        Told the share that is done.
    """
    ratios = sorted({j - k for j in Q_EXPONENTS for k in R_EXPONENTS})
    clean = struck(forces())

    def task(job: tuple[float, int]) -> Curve:
        mismatch, ratio = job
        thickness = THICKNESS[mismatch]
        setting = Setting(np.exp(ratio) * EPS_R * 1e8, np.exp(15) * 1e-10)
        found = curve(built(thickness, setting), clean)
        done.append(job)
        progress(len(done) / len(jobs))
        return found

    done: list[tuple[float, int]] = []
    jobs = [(mismatch, ratio) for mismatch in THICKNESS for ratio in ratios]
    curves = dict(zip(jobs, in_threads(task, jobs), strict=True))
    return {mismatch: _map(curves, mismatch) for mismatch in THICKNESS}


def _map(curves: dict[tuple[float, int], Curve], mismatch: float) -> Map:
    mse, lam = (np.zeros((len(Q_EXPONENTS), len(R_EXPONENTS))) for _ in range(2))
    for a, j in enumerate(Q_EXPONENTS):
        for b, k in enumerate(R_EXPONENTS):
            found = curves[mismatch, j - k]
            mse[a, b] = found.mse.min()
            lam[a, b] = found.best * EPS_R / (np.exp(k) * 1e-10)
    return Map(mse, lam)


def scaling(thickness: float, setting: Setting, factor: float) -> float:
    """Largest difference of the forces if all three weights of the cost change together [N]."""
    clean = struck(forces())
    scaled = Setting(setting.eps_Q * factor, setting.lam / factor, setting.eps_R * factor)
    a, b = (built(thickness, s).run(clean).alpha for s in (setting, scaled))
    return float(np.abs(a - b).max())
