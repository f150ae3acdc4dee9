"""How good an estimate of the stage is: the paper's error measures, and those against the truth."""

import dataclasses
import math

import numpy as np
import xarray as xr

from backsight.analysis.comparison import convergence_time, rmse, rse
from backsight.analysis.consistency import mean_nis
from backsight.errors import DataError
from backsight.run.estimation import estimate
from backsight.signals import central_difference
from backsight.types import Array
from backsight_studies.nanopositioner.tuning import Variant, joint_model
from backsight_studies.start import posterior_start

START_UP = 200
"""Samples after which the estimators have forgotten their wrong initial parameters."""

SETTLED = 1000
"""Samples from the removal on after which the parameters are taken as settled."""

TRANSIENT = 200
"""Samples from the removal on that count as transient."""

BAND, HOLD = 0.02, 100
"""k/m has converged when it stays within 2 % for 100 samples."""


@dataclasses.dataclass(frozen=True)
class Measures:
    """Errors of one estimator on one recording; samples 1 ... n - 2, "settled" from 201 on.

    Parameters
    ----------
    rse_x1, rse_x1_settled : float
        Root square error of the displacement against the *measurement*, eq. 44 [um].
    rse_x2, rse_x2_settled : float
        Root square error of the speed against the differentiated measurement, eq. 39, 44 [um/s].
    rms_q, rms_v : float
        Root mean square error of displacement [um] and speed [um/s] against the truth, settled.
    rms_v_transient : float
        The same for the speed, in the 20 ms after the removal.
    k_time : float
        Time from the removal until k/m stays within 2 % for 10 ms [ms]; NaN if it never does.
    std_k, std_b, std_c : float
        Relative standard deviation of the parameters, from 0.1 s after the removal on.
    step_k, step_b, step_c : float
        The same for their change from sample to sample.
    nis : float
        Mean normalised innovation squared; 1 if the covariance is honest.
    evaluations : float
        Mean number of evaluations of the window's cost per sample.
    us_per_sample : float
        Computing time [us].
    """

    rse_x1: float
    rse_x2: float
    rse_x1_settled: float
    rse_x2_settled: float
    rms_q: float
    rms_v: float
    rms_v_transient: float
    k_time: float
    std_k: float
    std_b: float
    std_c: float
    step_k: float
    step_b: float
    step_c: float
    nis: float
    evaluations: float
    us_per_sample: float


def run_variant(variant: Variant, stage: xr.Dataset) -> xr.Dataset:
    """Estimate; a diverged estimator gives NaN and does not end the study."""
    return estimate(variant.estimator, joint_model(), posterior_start(stage), throw=False)


def measure(result: xr.Dataset, stage: xr.Dataset) -> Measures:
    """Compare an estimate with the measurement and with the truth."""
    x = {str(n): result["x_hat"].sel(state=n).values for n in result["state"].values}
    true = {str(n): stage["x_true"].sel(state=n).values for n in stage["state"].values}
    y = stage["y"].values[:, 0]
    speed = measured_speed(stage)
    n = len(y)
    judged, settled = slice(1, n - 1), slice(START_UP + 1, n - 1)
    at = removal(stage)
    late = slice(at + SETTLED, n - 1)
    transient = slice(at, min(at + TRANSIENT, n - 1))
    relative = {p: x[p][late] / true[p][late] for p in ("k", "b", "c")}
    times = result["time"].values[at:] - result["time"].values[at]
    return Measures(
        rse_x1=float(rse(x["q"][judged], y[judged])),
        rse_x2=float(rse(x["v"][judged], speed[judged])),
        rse_x1_settled=float(rse(x["q"][settled], y[settled])),
        rse_x2_settled=float(rse(x["v"][settled], speed[settled])),
        rms_q=float(rmse(x["q"][settled], true["q"][settled])),
        rms_v=float(rmse(x["v"][settled], true["v"][settled])),
        rms_v_transient=float(rmse(x["v"][transient], true["v"][transient])),
        k_time=1e3
        * convergence_time(x["k"][at:], true["k"][at:], band=BAND, hold=HOLD, time=times),
        **{f"std_{p}": float(np.std(r)) for p, r in relative.items()},
        **{f"step_{p}": float(np.std(np.diff(r))) for p, r in relative.items()},
        nis=mean_nis(result),
        evaluations=float(result["iterations"].mean()) if "iterations" in result else math.nan,
        us_per_sample=float(result.attrs["us_per_sample"]),
    )


def check_length(stage: xr.Dataset, name: str) -> None:
    """Raise `DataError` if too little follows the removal for `measure`."""
    needed, n = removal(stage) + SETTLED + 100, stage.sizes["time"]
    if n < needed:
        raise DataError(
            f"recording '{name}' has {n} samples; the study needs {needed}, "
            f"{SETTLED + 100} from the removal of the payload on"
        )


def measured_speed(stage: xr.Dataset) -> Array:
    """Speed from the measured displacement by eq. 39 [um/s], (n,)."""
    return central_difference(stage["y"].values[:, 0], dt=float(stage.attrs["dt"]))


def speed_floor(stage: xr.Dataset) -> float:
    """RSE x2 that the *true* speed would get, settled [um/s]: the error of eq. 39 itself."""
    part = slice(START_UP + 1, -1)
    true = stage["x_true"].sel(state="v").values
    return float(rse(true[part], measured_speed(stage)[part]))


def removal(stage: xr.Dataset) -> int:
    """First sample with the new stiffness; the middle of the recording if it never changes."""
    changed = np.flatnonzero(np.diff(stage["x_true"].sel(state="k").values))
    return int(changed[0]) + 1 if len(changed) else stage.sizes["time"] // 2
