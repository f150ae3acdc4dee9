"""How well a recording is explained for each of several values of a parameter."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from backsight.analysis.consistency import log_likelihood
from backsight.description import checked
from backsight.errors import BacksightError, DataError, TuningError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Prior
from backsight.models.model import Model
from backsight.run.estimation import estimate
from backsight.types import Array

BELOW = 1.92
"""Of a log-likelihood below its top at the ends of a 95 % interval (chi-squared, one value)."""


@checked()
def profile(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    name: str,
    values: ArrayLike | Sequence[float] | None = None,
) -> xr.Dataset:
    r"""Profile the likelihood over a parameter: fixed at each value, all else estimated.

    A curve with one narrow top says that the recording tells the parameter; a flat one that it does
    not; several tops that the start value decides, and which one to take.

    Parameters
    ----------
    estimator : AbstractEstimator
        Its noise and prior are used, by the (extended) Kalman filter that believes in the same.
    model : Model
        With the parameter among its states.
    recording : xarray.Dataset
    name : str
        The state.
    values : (n,) array, optional
        By default 21 values over three standard deviations of the prior to either side, those
        inside the bounds; of positive states those of the logarithm.

    Returns
    -------
    xarray.Dataset
        ``log_likelihood (value)``, the sum over the recording; the other states at its end and
        their standard deviations, ``x_hat, x_std (value, state)``; NaN where the filter diverged.
        The attribute ``best`` is the value with the largest likelihood, ``interval`` the
        next values to both sides at which the curve is 1.92 below it: they hold a 95 % interval by
        the likelihood ratio, and are infinite to a side on which the curve does not come down.

    Raises
    ------
    ModelError, TuningError, DataError
        If the state is unknown, estimator, model and recording do not fit, or no value is possible.

    References
    ----------
    Raue et al., "Structural and practical identifiability analysis of partially observed dynamical
    models by exploiting the profile likelihood", 2009, doi:10.1093/bioinformatics/btp358.

    Examples
    --------
    >>> import numpy as np
    >>> spring, u = bs.sdof(k=40.0, b=0.8), np.random.default_rng(0).standard_normal((60, 1))
    >>> joint = bs.augment(spring, parameters=["k"])
    >>> recording = bs.simulate(spring, u, dt=0.05, sigma_y=1e-4, seed=1)
    >>> ekf = bs.EKF(
    ...     bs.Noise(sigma_y=1e-4, sigma_w=1e-6), bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 5.0})
    ... )
    >>> found = bs.check.profile(ekf, joint, recording, "k", [35.0, 40.0, 45.0])
    >>> found.log_likelihood.idxmax().item()
    40.0
    """
    i, judge = model.index(name), yardstick(estimator, model)
    noise, prior = judge.assumed
    x0, P0 = prior.mean(model), prior.covariance(model)
    state = model.states[i]
    if values is None:
        values = _over_prior(float(x0[i]), float(P0[i, i]), positive=state.positive)
    grid = np.unique(np.atleast_1d(np.asarray(values, float)))
    least = max(state.lower, np.nextafter(0, 1)) if state.positive else state.lower
    grid = grid[np.isfinite(grid) & (grid >= least) & (grid <= state.upper)]
    if not len(grid):
        raise TuningError(f"{name}: none of the values is possible; give others")
    fixed = np.ones(model.nx)
    fixed[i] = 0.0
    keep = np.outer(fixed, fixed)
    still = dataclasses.replace(
        noise,
        sigma_w=None,
        Q=None if noise.Qc is not None else noise.stated_process(model) * keep,
        Qc=None if noise.Qc is None else noise.stated_density(model) * keep,
    )
    rows = []
    for value in grid:
        start = x0.copy()
        start[i] = value
        one = dataclasses.replace(judge, noise=still, prior=Prior(x0=start, P0=P0 * keep))
        rows.append(_tried(one, model, recording))
    logs, x, std = (np.array(k) for k in zip(*rows, strict=True))
    if not np.isfinite(logs).any():
        raise DataError(f"the filter diverged at every value of {name}; give values nearer to it")
    best = int(np.nanargmax(logs))
    others = [s.name for s in model.states]
    return xr.Dataset(
        {
            "log_likelihood": ("value", logs),
            "x_hat": (("value", "state"), x),
            "x_std": (("value", "state"), std),
        },
        coords={"value": grid, "state": others},
        attrs={
            "parameter": name,
            "unit": state.unit,
            "best": float(grid[best]),
            "interval": [_end(grid, logs, best, by) for by in (-1, 1)],
        },
    )


def _over_prior(start: float, variance: float, *, positive: bool) -> Array:
    """Values over three standard deviations of the prior; of a logarithm if the state is one."""
    steps = np.linspace(-3, 3, 21)
    if not (positive and start > 0):
        return start + np.sqrt(variance) * steps
    return start * np.exp(np.sqrt(np.log1p(variance / start**2)) * steps)


def _end(grid: Array, logs: Array, best: int, by: int) -> float:
    """First value to one side at which the curve is `BELOW` its top."""
    for k in range(best + by, len(grid) if by > 0 else -1, by):
        if logs[k] < logs[best] - BELOW:
            return float(grid[k])
    return by * math.inf


def _tried(
    judge: AbstractEstimator, model: Model, recording: xr.Dataset
) -> tuple[float, np.ndarray, np.ndarray]:
    lost = np.full(model.nx, np.nan)
    try:
        result = estimate(judge, model, recording)
    except BacksightError:
        return np.nan, lost, lost
    last = result.isel(time=-1)
    return float(log_likelihood(result).sum()), last["x_hat"].values, last["x_std"].values
