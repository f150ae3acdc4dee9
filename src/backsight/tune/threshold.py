"""Threshold of the adaptive gain: what noise alone does to the innovation."""

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.errors import DataError, TuningError
from backsight.estimators.adaptive_observer import AbstractAdaptiveObserver
from backsight.models.model import Model
from backsight.run.estimation import estimate, match
from backsight.types import Array

MOST_WINDOWS = 2000
"""Windows that are evaluated, evenly spread."""


@checked(only=("observer",))
def propose_threshold(
    observer: AbstractAdaptiveObserver,
    model: Model,
    recording: xr.Dataset,
    *,
    window: float = 0.04,
    quantile: float = 0.99,
    margin: float = 1.8,
    settle: float | None = None,
) -> float:
    r"""Propose `AdaptiveGain.gamma` from a recording in which no parameter changes.

    With a threshold below the innovation that noise alone causes at lambda_max, the gain never
    comes down: the larger gain lets more noise into the estimates, which keeps the innovation up.
    So the innovation (eq. 19) is measured at lambda_max, and gamma is a quantile of it with a
    margin.

    Parameters
    ----------
    observer : AbstractAdaptiveObserver
        An `AHG` at lambda_max; its adaptive gain is not used.
    model : Model
    recording : xarray.Dataset
        Of the converged observer, apart from the beginning.
    window : float
        T of the adaptive gain [s].
    quantile, margin : float
        The threshold is `margin` times this quantile.
    settle : float, optional
        Time from which on the observer has converged [s]; half the recording if not given.

    Returns
    -------
    float
        gamma [output unit * s].

    Raises
    ------
    DataError
        If less than ten windows fit behind `settle`.
    TuningError
        If the window, the quantile or the margin is not possible.
    EstimationError
        If the observer fails on the recording.

    Examples
    --------
    >>> import numpy as np
    >>> joint = bs.augment(bs.sdof(k=40.0, b=0.8), parameters=["k"])
    >>> recording = bs.simulate(
    ...     bs.sdof(k=40.0, b=0.8), [[1.0]] * 200, dt=0.01, sigma_y=1e-4, seed=1
    ... )
    >>> ahg = bs.AHG(
    ...     bs.Noise(sigma_y=1e-4),
    ...     bs.Prior(sigma_x0=1.0, x0={"k": 40.0}),
    ...     gain=20.0,
    ...     Gamma=np.eye(1),
    ... )
    >>> bs.tune.propose_threshold(ahg, joint, recording) > 0
    True
    """
    if not (window > 0 and 0 < quantile < 1 and margin > 0):
        raise TuningError(
            f"window = {window}, quantile = {quantile}, margin = {margin}: window and margin must "
            "be positive, the quantile between 0 and 1"
        )
    found = innovations(observer, model, recording, window=window, settle=settle)
    return margin * float(np.quantile(found, quantile))


def innovations(
    observer: AbstractAdaptiveObserver,
    model: Model,
    recording: xr.Dataset,
    *,
    window: float = 0.04,
    settle: float | None = None,
) -> Array:
    """Innovation of eq. 19 in evenly spread windows [output unit * s]; see `propose_threshold`."""
    dt, n = float(recording.attrs["dt"]), recording.sizes["time"]
    length = max(1, round(window / dt))
    first = n // 2 if settle is None else round(settle / dt)
    if n - first < 10 * length:
        raise DataError(
            f"the window is {window:g} s; ten of them must fit behind the first {first * dt:g} s, "
            f"but the recording ends at {(n - 1) * dt:g} s"
        )
    result = estimate(observer.fixed(), model, recording)
    count = min(MOST_WINDOWS, n - first - length)
    starts = np.unique(np.linspace(first, n - 1 - length, count).astype(int))
    measure = observer.window_innovation(model, dt, length).map(len(starts))
    data = match(model, recording)
    windows = [np.hstack([d[k : k + length + 1].T for k in starts]) for d in data]
    return np.asarray(measure(result["x_hat"].values[starts].T, *windows))[0]
