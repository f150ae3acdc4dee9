"""What a rule for outliers did to the samples of a recording."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.description import Printed
from backsight.rounding import grouped
from backsight.schema import WEIGHT
from backsight.types import Array

RULE, THRESHOLD, DOUBTED = "outliers", "outlier_threshold", "outlier_weight"
"""Attributes of a result: name of the rule, standard deviations of the innovation beyond which a
sample counts as an outlier, and the weight below which it does."""


@dataclasses.dataclass(frozen=True)
class Outliers(Printed):
    """Samples of one output that a rule took for outliers.

    Parameters
    ----------
    output : str
    count : int
        Samples that were left out or weighed down.
    samples : int
        Samples that were measured.
    left_out : bool
        Whether they were left out; else they were weighed down.
    opened : int
        Samples that looked like outliers but were taken in, because most samples did.
    useless : bool
        Whether the rule can never act: wherever its prediction is, all values lie within.
    """

    output: str
    count: int
    samples: int
    left_out: bool
    opened: int = 0
    useless: bool = False

    def sentences(self) -> list[str]:
        """What is to be said of it; empty if there were no outliers."""
        found = []
        if self.count:
            how = "left out" if self.left_out else "weighed down"
            found.append(
                f"{grouped(self.count)} of {grouped(self.samples)} samples of {self.output} were "
                f"{how} as outliers"
            )
        if self.opened:
            found.append(
                f"{grouped(self.opened)} samples of {self.output} looked like outliers but were "
                "taken in, because most samples did: its noise, the model or the prior is wrong, "
                "or the sensor failed for longer than `patience`"
            )
        if self.useless:
            found.append(
                f"the rule for outliers of {self.output} can never act: the whole range of its "
                "values is smaller than the deviation that it allows; is sigma_y too large?"
            )
        return found


def taken(result: xr.Dataset) -> xr.DataArray:
    """Whether a sample of an output was measured and not doubted as an outlier."""
    measured = result["y"].notnull()
    if WEIGHT not in result:
        return measured
    return measured & ~(result[WEIGHT] < float(result.attrs[DOUBTED]))


def weighed(result: xr.Dataset) -> bool:
    """Whether samples were weighed down, so that their noise is not the nominal one."""
    return WEIGHT in result and bool(((result[WEIGHT] > 0) & (result[WEIGHT] < 1)).any())


def outliers(result: xr.Dataset) -> tuple[Outliers, ...]:
    """Per output; empty if the estimator had no rule for outliers.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> recording.y[30] += 1.0
    >>> noise = bs.Noise(sigma_y=1e-3, sigma_w=1e-6, outliers=bs.settings.Gate())
    >>> kf = bs.KalmanFilter(noise, bs.Prior(sigma_x0=0.1))
    >>> result = bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> [(o.output, o.count) for o in bs.check.outliers(result)]
    [('y', 1)]
    """
    if WEIGHT not in result:
        return ()
    weight, y, e = (result[k].values for k in (WEIGHT, "y", "e"))
    threshold, doubted = float(result.attrs[THRESHOLD]), float(result.attrs[DOUBTED])
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", result["S"].values), 0.0))
    far = np.abs(e) > threshold * deviation
    return tuple(
        Outliers(
            output=str(name),
            count=int(np.sum(weight[:, i] < doubted)),
            samples=int(np.sum(np.isfinite(y[:, i]))),
            left_out=str(result.attrs[RULE]) == "Gate",
            opened=int(np.sum(far[:, i] & (weight[:, i] == 1))),
            useless=_useless(y[:, i], threshold * deviation[:, i]),
        )
        for i, name in enumerate(result["output"].values)
    )


def sentences(found: Sequence[Outliers]) -> list[str]:
    """What is to be said of all outputs."""
    return [text for one in found for text in one.sentences()]


def _useless(y: Array, allowed: Array) -> bool:
    """Whether the range of the values is below every deviation that is allowed."""
    known = np.isfinite(y) & np.isfinite(allowed)
    return bool(known.sum() > 1 and np.ptp(y[known]) < allowed[known].min())
