"""The window of a moving horizon estimator at one moment of a recording."""

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.engine import vm
from backsight.engine.recursion import Channel
from backsight.errors import DataError, TuningError
from backsight.estimators.around.robust import entering
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation._match import match
from backsight.types import Array


@checked()
def solve_window(
    estimator: AbstractEstimator, model: Model, recording: xr.Dataset, *, at: int = -1
) -> xr.Dataset:
    """Everything that the estimator knows of its window after a sample.

    Parameters
    ----------
    estimator : AbstractEstimator
        One with a window whose states can be looked at: `MHE`.
    model : Model
    recording : xarray.Dataset
    at : int
        Index of the newest sample of the window; negative ones count from the end.

    Returns
    -------
    xarray.Dataset
        With one entry along ``time`` for every sample of the window: states ``x``, their standard
        deviations ``x_std`` and covariances ``P`` given the whole window, the process noise ``w``
        that led to the sample, residuals ``v`` (NaN where not measured), and, with limits,
        ``multiplier`` and ``side`` (1 at a lower, -1 at an upper limit, else 0).

        Attributes: ``iterations`` of the optimiser and its ``status``, bits of `schema.Status`.

    Notes
    -----
    A window that begins with the recording (``at`` up to N) is solved by itself, from where an
    extended Kalman filter puts it: time and memory grow with its length. For one that begins
    later, or with a rule for outliers, the windows of all samples before are solved on the way. A
    whole recording without limits is smoothed faster by `smooth`.

    Raises
    ------
    TuningError
        If the estimator has no such window.
    DataError
        If the recording has no such sample, or does not fit the model.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 20, dt=0.05, sigma_y=1e-3, seed=1)
    >>> mhe = bs.MHE(bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0), N=5)
    >>> bs.solve_window(mhe, spring, recording, at=12).sizes["time"]
    6
    """
    u, y, mask = match(model, recording, estimator=estimator)
    k = at + len(u) if at < 0 else at
    if not 0 <= k < len(u):
        raise DataError(f"there is no sample {at} in a recording of {len(u)} samples")
    dt = float(recording.attrs["dt"])
    if any(s.positive for s in model.states):
        raise TuningError("a window of states that are positive cannot be looked at; use estimate")
    method, wide = estimator.widened(model, dt)
    window, nx = method.inspect(wide, dt), model.nx
    step_by_step = estimator.outliers is not None or any(s.wrap for s in model.outputs)
    if 0 < k <= method.horizon and not step_by_step:
        inside, weighed = window.filled(u[:k], y[:k], mask[:k]), mask[k]
    else:
        recursion = estimator.compile(model, dt)
        carry, _ = vm.run(recursion, [u[:k], y[:k], mask[:k]], carry=recursion.carry0)
        inside, weighed = _entered(estimator, model, dt, carry, [u[k], y[k], mask[k]])
    inside = inside[: window.solve.numel_in(0)]  # inputs for virtual outputs wait behind it
    *shown, course = window.solve(inside, u[k], y[k], weighed)
    iterations, status = np.asarray(course).ravel()
    present, *columns = (np.asarray(c).T for c in shown)
    here = present[:, 0] > 0
    x, P, w, v, multiplier, side = (c[here] for c in columns)
    first = k + 1 - int(here.sum())
    names, outputs = [s.name for s in model.states], [s.name for s in model.outputs]
    P = Channel("P", ("state", "state_"), symmetric=True).unpack(P)
    x, P, w = x[:, :nx], P[:, :nx, :nx], w[:, :nx]
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))
    found = xr.Dataset(
        {
            "x": (("time", "state"), x),
            "x_std": (("time", "state"), deviation),
            "P": (("time", "state", "state_"), P),
            "w": (("time", "state"), w),
            "v": (("time", "output"), np.where(mask[first : k + 1] > 0, v, np.nan)),
        },
        coords={
            "time": recording["time"][first : k + 1],
            "state": names,
            "state_": names,
            "output": outputs,
        },
        attrs={
            "estimator": estimator.key,
            "model": model.name,
            "dt": dt,
            "iterations": int(iterations),
            "status": int(status),
        },
    )
    if window.limits:
        found["multiplier"], found["side"] = (
            (("time", "limit"), multiplier),
            (("time", "limit"), side),
        )
        found["limit"] = list(window.limits)
    return found


def _entered(
    estimator: AbstractEstimator, model: Model, dt: float, carry: Array, data: list[Array]
) -> tuple[Array, Array]:
    """Memory of the method itself, and the mask of a sample as the rule for outliers weighs it."""
    if estimator.outliers is None:
        return carry, data[2]
    plain = estimator.plain(model, dt)
    weight = np.asarray(entering(plain, estimator.outliers)(carry, *data)[0]).ravel()
    return carry[: len(plain.carry0)], data[2] * weight
