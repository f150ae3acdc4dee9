"""Threshold of sparse forces: below what noise alone makes of a recording."""

import dataclasses

import numpy as np
import xarray as xr

from backsight.description import Level, Printed, Whole, checked
from backsight.errors import TuningError
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.sparse import Regression, l1_path
from backsight.tune._force_path import unweighted
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class ThresholdChoice(Printed):
    """A threshold of sparse forces, and what noise alone would do to it.

    Parameters
    ----------
    threshold : float
        For `CompressiveSensingMHE.threshold`; 0 if the weight keeps noise out by itself.
    largest : (draws,) array
        Largest factor of an atom that noise alone makes of the recording, rising.
    """

    threshold: float
    largest: Array

    def false_alarm(self, threshold: float) -> float:
        """Share of the recordings of noise in which a force is shown with a threshold."""
        return float(np.mean(self.largest > threshold))


@checked()
def threshold_from_noise(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    false_alarm: Level = 0.05,
    draws: int = 100,
    seed: Whole = 0,
) -> ThresholdChoice:
    r"""Threshold above which noise alone seldom shows a force, with the weight that is given.

    With a weight below that of `lambda_from_noise` the l1 norm makes forces of noise, and some of
    them are small. Recordings of noise with the stated deviations, and of background forces, are
    drawn in the white innovations v of a Kalman filter, and

    .. math:: \min_\alpha \|v - H \alpha\|^2 + \lambda |\alpha|_1

    is solved exactly for each. The threshold is the quantile of the largest :math:`|\alpha_i|`. If
    the model is wrong, what it does not explain is larger than noise.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `threshold` is not used.
    model : Model
    recording : xarray.Dataset
        Only its length, and where it was not measured, matter.
    false_alarm : float
        Probability of one or more forces in a recording in which none acts.
    draws, seed : int
        Recordings of noise that are drawn.

    Returns
    -------
    ThresholdChoice

    Raises
    ------
    TuningError, ModelError, DataError
        As `find_sparse_forces`, or if there are too few draws for such a probability.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.threshold_from_noise(finder, rod, recording, draws=20).threshold >= 0
    True
    """
    if draws < 1 / false_alarm:
        raise TuningError(
            f"false_alarm = {false_alarm}, draws = {draws}: draw {int(np.ceil(1 / false_alarm))} "
            "or more, for one to be expected"
        )
    search = unweighted(estimator, model, recording)
    measured = search.filter.mask.ravel() > 0
    given, rng = search.regression, np.random.default_rng(seed)
    largest = np.empty(draws)
    for i in range(draws):
        v = np.where(measured, rng.standard_normal(measured.size), 0.0)
        largest[i] = _largest(Regression(given.columns, v, given.side), estimator.lam)
    largest.sort()
    return ThresholdChoice(float(np.quantile(largest, 1 - false_alarm)), largest)


def _largest(noise: Regression, lam: float) -> float:
    """Largest factor at a weight."""
    if not np.isfinite(lam) or 2 * np.abs(noise.correlation).max(initial=0.0) <= lam:
        return 0.0
    path = l1_path(noise, lam)
    return float(np.abs(path.at(max(lam, path.lam[-1]))[1]).max(initial=0.0))
