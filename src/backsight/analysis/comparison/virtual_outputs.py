"""What a result says of the quantities that no sensor measures."""

import dataclasses
import math

import numpy as np
import xarray as xr

from backsight.analysis.comparison.error_measures import rmse
from backsight.analysis.consistency import shares_within
from backsight.description import Printed
from backsight.schema import VIRTUAL, VIRTUAL_STD, VIRTUAL_TRUE


@dataclasses.dataclass(frozen=True)
class VirtualOutput(Printed):
    """A virtual output over a recording [unit].

    Parameters
    ----------
    value, std : float
        At the last sample.
    rms, largest : float
        Root mean square and largest magnitude of the estimate.
    typical_std : float
        Median of its standard deviation.
    rms_error : float
        Against the truth; NaN if that is unknown.
    within : tuple of float
        Shares of the samples at which the truth lies within 1, 2 and 3 deviations; empty if it is
        unknown.
    unit : str
    """

    value: float
    std: float
    rms: float
    largest: float
    typical_std: float
    rms_error: float
    within: tuple[float, ...]
    unit: str


def virtual_outputs(result: xr.Dataset) -> dict[str, VirtualOutput]:
    """Sum up every virtual output of a result by its name; empty if there are none."""
    if VIRTUAL not in result:
        return {}
    z, std = result[VIRTUAL].values, result[VIRTUAL_STD].values
    truth = result[VIRTUAL_TRUE].values if VIRTUAL_TRUE in result else np.full(z.shape, np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        rms, error = np.sqrt(np.mean(z**2, axis=0)), rmse(z, truth)
        size = np.abs(truth - z) / np.where(std > 0, std, np.nan)
    shares = shares_within(size)
    units = result["virtual_unit"].values if "virtual_unit" in result.coords else [""] * z.shape[1]
    return {
        str(name): VirtualOutput(
            value=float(z[-1, i]),
            std=float(std[-1, i]),
            rms=float(rms[i]),
            largest=float(np.abs(z[:, i]).max()),
            typical_std=float(np.median(std[:, i])),
            rms_error=float(error[i]),
            within=() if math.isnan(shares[0, i]) else tuple(map(float, shares[:, i])),
            unit=str(units[i]),
        )
        for i, name in enumerate(result["virtual"].values)
    }
