"""statsmodels: the likelihood of its state space models, maximised by L-BFGS."""

import warnings
from typing import Any

import numpy as np
from statsmodels.tsa.statespace.mlemodel import MLEModel

from backsight.types import Array
from benchmarks import fit_noise
from benchmarks.contest import Contender


class Oscillator(MLEModel):
    """The oscillator with logarithms of three standard deviations as its parameters."""

    def __init__(self) -> None:
        recording = fit_noise.recording()
        super().__init__(endog=recording["y"].values, k_states=2, k_posdef=2)
        A, B = fit_noise.transition()
        self["design"], self["selection"] = np.array([[1.0, 0.0]]), np.eye(2)
        self["transition"], self["state_intercept"] = A, B @ recording["u"].values.T
        self.ssm.initialize_known(np.zeros(2), fit_noise.SIGMA_X0**2 * np.eye(2))

    @property
    def start_params(self) -> Array:
        """See `MLEModel`."""
        return np.log(list(fit_noise.START.values()))

    def update(self, params: Array, **given: Any) -> None:
        """See `MLEModel`."""
        values = np.exp(super().update(params, **given))
        self["obs_cov", 0, 0] = values[0] ** 2
        self["state_cov"] = np.diag(values[1:] ** 2)


def values() -> Array:
    """The standard deviations, (1, 3), to the last digit that L-BFGS gives."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitted: Any = Oscillator().fit(disp=False, maxiter=500, pgtol=1e-9, factr=10)
    return np.exp(fitted.params)[None]


def build() -> Contender:
    """Three standard deviations."""
    return Contender(values, fit_noise.PER_FIT)
