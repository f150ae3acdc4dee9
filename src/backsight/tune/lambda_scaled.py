"""Weight of the l1 norm by what noise can do, with the size of the noise from the recording."""

import dataclasses

import numpy as np
import xarray as xr

from backsight.description import Whole, checked
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.sparse import ForceSearch, L1Path
from backsight.tune._force_path import check_draws, unweighted, weights_of_noise, whole_path
from backsight.tune.lambda_choice import LEAST, LambdaChoice

AS_LIKELY_AS_NOT = 0.5
"""Probability of a force in a recording of noise alone."""

ROUNDS, SETTLED = 30, 1e-3
"""Rounds at most, and the change of the weight, as a share, at which there are no more."""


@checked()
def lambda_from_scaled_noise(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    draws: int = 400,
    seed: Whole = 0,
) -> LambdaChoice:
    r"""Weight at which noise alone makes a force as likely as not, whatever its size is.

    .. math:: \lambda = \hat\sigma\,\lambda_1, \qquad
        \hat\sigma^2 = \frac1n \|\eta - H \hat\alpha(\lambda)\|^2 :

    :math:`\lambda_1` is that of `lambda_from_noise` for the noise as it is stated, and
    :math:`\hat\sigma` by how much larger the noise is than stated: from the n white innovations
    :math:`\eta` that remain of a Kalman filter without forces when those found at this weight are
    taken away. So the size of the noise need not be known, nor the error of a model that is a
    little wrong; one sensor is enough.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `lam` is not used.
    model : Model
    recording : xarray.Dataset
    draws, seed : int
        Recordings of noise that are drawn.

    Returns
    -------
    LambdaChoice
        ``table`` has ``scale (lam)``, the :math:`\hat\sigma` found at the weights of all rounds.
        `reached` is false if the rounds do not settle.

    Raises
    ------
    TuningError, ModelError, DataError
        As `find_sparse_forces`.

    References
    ----------
    Sun, Zhang, "Scaled sparse linear regression", 2012, Biometrika 99(4) 879-898,
    doi:10.1093/biomet/ass043.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.lambda_from_scaled_noise(finder, rod, recording, draws=20).lam > 0
    True
    """
    return scaled_noise(estimator, model, recording, draws=draws, seed=seed).choice()


@dataclasses.dataclass(frozen=True)
class ScaledNoise:
    r"""What the weight by scaled noise rests on: the minimum of a function of forces and noise.

    .. math:: J(\alpha, \sigma) = \frac{1}{2\sigma} \|\eta - H \alpha\|^2 + \frac{n \sigma}{2}
        + \frac{\lambda_1}{2} \|\alpha\|_1

    Parameters
    ----------
    search : ForceSearch
    path : L1Path
    unit : float
        The weight :math:`\lambda_1` for noise as it is stated.
    doubt : float
        Standard deviation of the logarithm of `unit`, by the number of draws.
    """

    search: ForceSearch
    path: L1Path
    unit: float
    doubt: float

    @property
    def measured(self) -> int:
        """Number n of measurements."""
        return int((self.search.filter.mask > 0).sum())

    def left(self, lam: float) -> tuple[float, float]:
        """Squares that are left with a weight, and the sum of the sizes of the forces."""
        which, values = self.path.at(max(lam, self.path.lam[-1]))
        regression = self.search.regression
        rest = regression.target - regression.columns[:, which] @ values
        return float(rest @ rest), float(np.abs(values).sum())

    def choice(self) -> LambdaChoice:
        """Forces and size of the noise in turn, until neither changes."""
        weights, scales = [self.unit], list[float]()
        settled = False
        while not settled and len(scales) < ROUNDS:
            scales.append(float(np.sqrt(self.left(weights[-1])[0] / self.measured)))
            weights.append(self.unit * scales[-1])
            settled = abs(weights[-1] - weights[-2]) <= SETTLED * weights[-2]
        table = xr.Dataset({"scale": ("lam", scales)}, coords={"lam": weights[:-1]})
        return LambdaChoice(weights[-1], table, settled)

    def cost(self, lam: float) -> float:
        """J with a weight, which says the size of the noise and with it the forces."""
        sigma, (squares, size) = lam / self.unit, self.left(lam)
        return 0.5 * (squares / sigma + self.measured * sigma + self.unit * size)


def scaled_noise(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    draws: int,
    seed: int,
) -> ScaledNoise:
    """Draw noise, and follow the forces over all weights; see `lambda_from_scaled_noise`."""
    check_draws(AS_LIKELY_AS_NOT, draws)
    search = unweighted(estimator, model, recording)
    noise = weights_of_noise(search, draws=draws, seed=seed)
    middle = 1 - AS_LIKELY_AS_NOT
    apart = np.sqrt(AS_LIKELY_AS_NOT * middle / draws)
    low, unit, high = np.quantile(noise, np.clip([middle - apart, middle, middle + apart], 0, 1))
    doubt = float(np.log(high / low)) / 2
    return ScaledNoise(search, whole_path(search, LEAST), float(unit), doubt)
