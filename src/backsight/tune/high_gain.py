r"""Gain and speed of adaptation of the adaptive high-gain observer.

Both come from a motion: `simulate` one with the nominal model, or `estimate` one from a recording.
"""

import casadi as ca
import numpy as np
import scipy
import xarray as xr

from backsight.description import Positive, checked
from backsight.discrete.runge_kutta import Hold
from backsight.errors import DataError, TuningError
from backsight.models.canonical.affine import AffineForm
from backsight.models.canonical.observer_form import gain_vector, moving_first, observer_form
from backsight.models.model import Model
from backsight.run.estimation import matched_inputs
from backsight.types import Array

SETTLING = 10.0
"""Time in 1/lambda after which Upsilon has forgotten its start."""

POINTS = 500
"""Samples of the motion at which the model is linearised."""


@checked()
def propose_gamma(
    model: Model,
    motion: xr.Dataset,
    *,
    gain: Positive,
    rate: Positive = 10.0,
    poles: complex | tuple[complex, ...] = -1.0,
    hold: Hold = "zoh",
    period: Positive | None = None,
    diagonal: bool = False,
) -> Array:
    r"""Gamma with which the errors of all combinations of parameters decay at one rate.

    With :math:`\Theta = \mathrm{diag}(\theta)` of the nominal parameters and the mean
    :math:`M = \overline{\Theta \Upsilon_1' \Upsilon_1 \Theta}` over the motion,

    .. math:: \Gamma = g\, \Theta M^{-1} \Theta

    makes the averaged equation of the parameters :math:`\dot{\tilde\theta} = -g \tilde\theta`,
    whatever lambda is. The rate g must stay well below lambda and below the frequency of the
    motion.

    Parameters
    ----------
    model : Model
        As for the observer; the values of the parameters are the nominal ones.
    motion : xarray.Dataset
        Inputs and states: a recording with ``x_true``, or a result with ``x_hat``.
    gain : float
        The observer's gain lambda [1/s]; lambda_max if it adapts.
    rate : float
        g [1/s].
    poles : number or n numbers
        As for the observer.
    hold : {"zoh", "foh"}
        Input between samples: held, or interpolated.
    period : float, optional
        Of the motion [s]: the mean is then taken over whole periods.
    diagonal : bool
        Leave out the off-diagonal entries of M: slower where parameters move the output alike.

    Returns
    -------
    (p, p) array
        In the order of `observer_form(model).combinations`.

    Raises
    ------
    ModelError
        If the model has no canonical form.
    TuningError
        If the motion does not excite a parameter, or lambda or the rate is not positive.
    DataError
        If the motion lacks a signal or is too short.

    Examples
    --------
    >>> joint = bs.augment(bs.sdof(k=40.0, b=0.8), parameters=["k"])
    >>> motion = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-4, seed=1)
    >>> bs.tune.propose_gamma(joint, motion, gain=20.0).shape
    (1, 1)
    """
    model, _ = moving_first(model)
    form = observer_form(model)
    theta = _nominal(model, form)
    x, u = trajectory(model, motion, form)
    psi = form.psi.map(len(x) - 1)
    ahead = u[:-1] if hold == "zoh" else u[1:]
    begins = np.asarray(psi(x[:-1].T, u[:-1].T)).T * theta
    ends = np.asarray(psi(x[1:].T, ahead.T)).T * theta
    dt = float(motion.attrs["dt"])
    count = _samples(len(begins), SETTLING / (gain * dt), None if period is None else period / dt)
    Y = _upsilon(begins, ends, gain * dt, gain_vector(poles, form.n))[-count:]
    M = Y.T @ Y / len(Y)
    _check_excited(M, form)
    inverse = np.diag(1 / np.diag(M)) if diagonal else np.linalg.inv(M)
    return rate * np.outer(theta, theta) * inverse


def propose_gain(model: Model, motion: xr.Dataset, *, factor: float = 2.5) -> float:
    r"""Gain lambda [1/s] that is well above the frequencies of model and motion.

    The larger of the fastest eigenvalue of the linearised model (for one mass on a spring
    :math:`\sqrt{c/m}`) and the mean frequency of the motion, the ratio of the root mean squares of
    the last state's derivative and of the last state, times `factor`. Smaller gains do not converge
    from afar, larger ones let more noise through.

    Parameters
    ----------
    model, motion
        As in `propose_gamma`.
    factor : float

    Raises
    ------
    ModelError, DataError
        As in `propose_gamma`.
    TuningError
        If the motion is at rest.

    Examples
    --------
    >>> motion = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-4, seed=1)
    >>> print(f"{bs.tune.propose_gain(bs.sdof(k=40.0, b=0.8), motion):.1f} 1/s")
    16.2 1/s
    """
    model, _ = moving_first(model)
    form = observer_form(model)
    x, u = trajectory(model, motion, form)
    theta = _nominal(model, form)
    symbol, v = ca.SX.sym("x", form.n), ca.SX.sym("u", form.nu)
    dx = form.rhs(symbol, ca.SX(theta), v)
    slopes = ca.Function("slopes", [symbol, v], [dx[form.n - 1], ca.jacobian(dx, symbol)])
    last = np.asarray(slopes.map(len(x))(x.T, u.T)[0])[0]
    if not np.ptp(x[:, -1]) > 0:
        raise TuningError(f"the motion is at rest: '{form.states[-1]}' does not change")
    of_motion = float(np.std(last) / np.std(x[:, -1]))
    chosen = np.unique(np.linspace(0, len(x) - 1, POINTS).astype(int))
    matrices = np.asarray(slopes.map(len(chosen))(x[chosen].T, u[chosen].T)[1])
    stacked = matrices.reshape(form.n, len(chosen), form.n).transpose(1, 0, 2)
    of_model = float(np.abs(np.linalg.eigvals(stacked)).max())
    return factor * max(of_motion, of_model)


def trajectory(model: Model, motion: xr.Dataset, form: AffineForm) -> tuple[Array, Array]:
    """The chain (time, n) and inputs (time, nu) of a recording or result."""
    variable = next((v for v in ("x_true", "x_hat") if v in motion), None)
    if variable is None:
        raise DataError(
            "the motion has neither 'x_true' nor 'x_hat': simulate it, or estimate it first"
        )
    known = [str(n) for n in motion["state"].values]
    lacking = [name for name in form.states if name not in known]
    if lacking:
        raise DataError(f"the motion has no state {', '.join(lacking)}")
    x = motion[variable].sel(state=list(form.states)).values
    if not np.isfinite(x).all():
        raise DataError(f"the motion's '{variable}' is not finite at every sample")
    return form.chain(x), matched_inputs(model, motion)


def _nominal(model: Model, form: AffineForm) -> Array:
    values = np.array([s.value for s in model.states[form.n :]])
    theta = np.asarray(form.theta(values)).ravel()
    if not (np.isfinite(theta).all() and (theta != 0).all()):
        raise TuningError(
            f"the nominal values {values.tolist()} of {', '.join(form.parameters)} do not define "
            f"{', '.join(form.combinations)}: none of them may be zero"
        )
    return theta


def _samples(n: int, settling: float, period: float | None) -> int:
    """Samples at the end of the motion over which the mean is taken."""
    left = n - int(np.ceil(settling))
    if left < max(settling, period or 0.0):
        raise DataError(
            f"the motion has {n} samples; {settling:.0f} are needed to settle, and "
            f"{max(settling, period or 0.0):.0f} more"
        )
    return left if period is None else round(left // period * period)


def _upsilon(begins: Array, ends: Array, step: float, k0: Array) -> Array:
    """First row of Upsilon at the samples, (time, p): eq. 8 from zero.

    Exact for psi that goes linearly from `begins` to `ends` in every sampling period of length
    `step` / lambda.
    """
    n = len(k0)
    A = np.diag(np.ones(n - 1), 1)
    A[:, 0] -= k0
    # The exponential of this matrix holds the responses to a constant and to a ramp.
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[n - 1, n], block[n, n + 1] = step * A, step, 1.0
    response = np.asarray(scipy.linalg.expm(block))
    constant, ramp = response[:n, n], response[:n, n + 1]
    inputs = np.column_stack([constant - ramp, ramp])
    system = (response[:n, :n], inputs, np.eye(n)[:1], np.zeros((1, 2)), 1.0)
    columns = [np.column_stack(pair) for pair in zip(begins.T, ends.T, strict=True)]
    return np.column_stack([scipy.signal.dlsim(system, column)[1][:, 0] for column in columns])


def _check_excited(M: Array, form: AffineForm) -> None:
    size = np.sqrt(np.diag(M))
    still = [c for c, s in zip(form.combinations, size, strict=True) if not s > 0]
    if still:
        raise TuningError(f"the motion does not excite {', '.join(still)}")
    correlation = M / np.outer(size, size)
    values, vectors = np.linalg.eigh(correlation)
    if values[0] < 1e-9:
        alike = [c for c, w in zip(form.combinations, vectors[:, 0], strict=True) if abs(w) > 0.1]
        raise TuningError(
            f"in this motion {', '.join(alike)} move the output alike and cannot be told apart; "
            "add other frequencies or amplitudes"
        )
