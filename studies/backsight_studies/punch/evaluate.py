"""How fast and how well the parameters are found."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from backsight.analysis.comparison import convergence_time
from backsight.run.estimation import estimate
from backsight.schema import Status
from backsight.types import Array
from backsight_studies.punch.plant import DT
from backsight_studies.punch.tuning import Variant
from backsight_studies.start import posterior_start

PARAMETERS = ("m", "c", "d")

BAND, HOLD = 0.05, 3000
"""A parameter has converged when it stays within 5 % for 0.3 s."""

JUDGED = 8.0
"""Time at which the error is taken [s]."""

SETTLED = 2.0
"""The last seconds of a recording, in which bias and noise are measured."""

ByParameter = Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class Measures:
    """What an observer reached from a wrong start; everything but times is relative to the truth.

    Parameters
    ----------
    time : dict
        Time until the parameter stays within 5 % for 0.3 s [s]; NaN if it never does.
    error : dict
        Error at 8 s.
    bias, std : dict
        Mean and standard deviation of the error in the last 2 s.
    us_per_sample : float
        Computing time [us].
    """

    time: ByParameter
    error: ByParameter
    bias: ByParameter
    std: ByParameter
    us_per_sample: float


@dataclasses.dataclass(frozen=True)
class Response:
    """What an observer did after one parameter had jumped, until the next one did.

    Parameters
    ----------
    time : dict
        Time until each parameter is back within 5 % for 0.3 s [s]; NaN if it is not.
    excursion : dict
        Largest relative error of each.
    error : dict
        Mean relative error of the last 0.5 s.
    """

    time: ByParameter
    excursion: ByParameter
    error: ByParameter


@dataclasses.dataclass(frozen=True)
class Gain:
    """Noise before and response after a jump of the stiffness.

    Parameters
    ----------
    std : dict
        Relative standard deviation in the second before the jump.
    time : float
        Time until the stiffness is within 5 % for 0.3 s [s].
    before : float
        Gain lambda just before the jump [1/s].
    rise : float
        Time until lambda is at 90 % of its upper limit [s].
    us_per_sample : float
        Computing time [us].
    """

    std: ByParameter
    time: float
    before: float
    rise: float
    us_per_sample: float


def run_variant(variant: Variant, recording: xr.Dataset) -> xr.Dataset:
    """Estimate; a diverged observer gives NaN and does not end the study.

    The filters start from a posterior, as in the paper. The adaptive observer does not: it needs
    the first sample to interpolate.
    """
    filters = variant.estimator.key in ("ekf", "ukf")
    given = posterior_start(recording) if filters else recording
    return estimate(variant.estimator, variant.model, given, throw=False)


def parameters_of(result: xr.Dataset) -> dict[str, Array]:
    """Estimates of m, c, d over time; NaN where a parameter is undefined."""
    x = result["x_hat"].where((result["status"] & int(Status.UNDEFINED)) == 0)
    names = [str(n) for n in result["state"].values]
    mass = 1 / x.sel(state="inverse") if "inverse" in names else x.sel(state="m")
    return {"m": mass.values, "c": x.sel(state="c").values, "d": x.sel(state="d").values}


def truth_of(recording: xr.Dataset) -> dict[str, Array]:
    """True m, c, d over time."""
    return {p: recording["x_true"].sel(state=p).values for p in PARAMETERS}


def measure(result: xr.Dataset, recording: xr.Dataset) -> Measures:
    """Compare an estimate from a wrong start with the truth."""
    relative = _relative(result, recording)
    late = slice(-round(SETTLED / DT), None)
    return Measures(
        time={p: _settling(r) for p, r in relative.items()},
        error={p: float(r[round(JUDGED / DT)] - 1) for p, r in relative.items()},
        bias={p: float(np.mean(r[late]) - 1) for p, r in relative.items()},
        std={p: float(np.std(r[late])) for p, r in relative.items()},
        us_per_sample=float(result.attrs["us_per_sample"]),
    )


def respond(result: xr.Dataset, recording: xr.Dataset, *, at: float, until: float) -> Response:
    """Compare with the truth between two times [s]."""
    part = slice(round(at / DT), round(until / DT))
    relative = {p: r[part] for p, r in _relative(result, recording).items()}
    return Response(
        time={p: _settling(r) for p, r in relative.items()},
        excursion={p: float(np.max(np.abs(r - 1))) for p, r in relative.items()},
        error={p: float(np.mean(r[-round(0.5 / DT) :]) - 1) for p, r in relative.items()},
    )


def judge_gain(result: xr.Dataset, recording: xr.Dataset, *, at: float, upper: float) -> Gain:
    """Noise before and response after the jump at a time [s]."""
    k = round(at / DT)
    relative = _relative(result, recording)
    lam = result["lam"].values
    high = lam[k:] > 0.9 * upper
    return Gain(
        std={p: float(np.std(r[k - round(1.0 / DT) : k])) for p, r in relative.items()},
        time=_settling(relative["c"][k:]),
        before=float(lam[k - 1]),
        rise=float(np.argmax(high)) * DT if high.any() else math.nan,
        us_per_sample=float(result.attrs["us_per_sample"]),
    )


def _relative(result: xr.Dataset, recording: xr.Dataset) -> dict[str, Array]:
    true = truth_of(recording)
    return {p: v / true[p] for p, v in parameters_of(result).items()}


def _settling(relative: Array) -> float:
    time = np.arange(len(relative)) * DT
    return convergence_time(relative, 1.0, band=BAND, hold=HOLD, time=time)
