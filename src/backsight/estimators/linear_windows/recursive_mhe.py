"""The least-squares window as an observer: one sample in, one sample out of the sum."""

import dataclasses
import warnings
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from backsight.description import Count, Horizon, Share, Sound, Whole
from backsight.discrete.runge_kutta import Hold
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman.exact_sensors import exact_sensors
from backsight.estimators.kalman.kf import fixed_gain_halves
from backsight.estimators.linear_windows._sliding import Sliding, sliding_window
from backsight.estimators.linear_windows.stacked import gains, newest_exact_gain, newest_gain
from backsight.estimators.outliers import AbstractOutlierRule
from backsight.estimators.parts.filtering import assemble
from backsight.estimators.parts.linear import Linear, linear, require_observable
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class RecursiveMHE(AbstractEstimator):
    r"""Least-squares moving horizon estimator in its recursive form.

    .. math:: \hat x_k = \hat x_k^- + L_N\,(y_k - C \hat x_k^-)
        - \alpha \tilde L_N\,(y_{k-N-1} - C \hat x_{k-N-1|k-1}), \qquad
        \hat x_k^- = A \hat x_{k-1} + B u_{k-1},

    where :math:`\hat x_{k-N-1|k-1}` is the estimate carried backwards through the model. The new
    sample enters the sum of squares, the one that leaves the window goes out of it. With P the
    covariance of the batch estimate over N + 1 samples,

    .. math:: L_N = P\,C' R^{-1}, \qquad \tilde L_N = P\,(C A^{-(N+1)})' R^{-1} .

    alpha = 0 never takes anything out: an observer with the gain of the window, stable, the steady
    Kalman filter for a certain process noise. alpha = 1 is exactly the batch estimator, but its
    error evolves with the eigenvalues :math:`1 / \lambda(A)`: rounding errors grow in every stable
    plant. Use `reinitialise` there, or `LinearMHE`.

    Parameters
    ----------
    noise : Noise
    prior : Prior
        With alpha > 0 used until the first full window, from which the recursion starts.
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    alpha : float
        Share in which the oldest sample is taken out, 0 to 1.
    every : int
        Only every m-th sample is measured, the others are missing in the recording. N must be a
        multiple of it.
    reinitialise : int
        With alpha > 0, start again from the batch estimate after so many measured samples; 0 for
        never.
    hold : {"zoh", "foh"}
        Input between the samples of a continuous model: held, or interpolated.

    Notes
    -----
    Other missing samples leave the estimate as the model predicts it; with alpha > 0 it is then
    not the least-squares estimate until it is initialised again, so that rules for outliers need
    alpha = 0. The covariance is that of the
    estimate which the recursion makes, rounding errors apart. With alpha = 0 sensors may have no
    noise, if the process noise lets all readings of a window differ.

    References
    ----------
    Ling, Lim, "Receding horizon recursive state estimation", IEEE Transactions on Automatic
    Control, 1999.
    Ling, Wu, Lim, "State observers for single rate and multirate controllers", 1996,
    doi:10.1016/S1474-6670(17)57849-0.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0)
    >>> bs.RecursiveMHE(noise, prior, N=10).N
    10
    """

    key: ClassVar[str] = "rmhe"
    title: ClassVar[str] = "Recursive least-squares estimator"

    noise: Noise
    prior: Prior
    N: Horizon = 20
    alpha: Share = 0.0
    every: Count = 1
    reinitialise: Whole = 0
    hold: Hold = "zoh"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if not sound("N", "every"):
            return
        if self.every > self.N:
            yield (
                f"every = {self.every} is more than the horizon N = {self.N}: the window would "
                "hold one sample; lengthen it"
            )
        elif self.N % self.every:
            below = self.N - self.N % self.every
            yield (
                f"N = {self.N} is no multiple of every = {self.every}; use {below} or "
                f"{below + self.every}"
            )

    @property
    def forgets(self) -> bool:
        """See `AbstractEstimator.forgets`."""
        return True

    @property
    def constant_gain(self) -> bool:
        """See `Compilable.constant_gain`."""
        return self.alpha == 0

    def unfit_for(self, rule: AbstractOutlierRule) -> str:
        """See `Compilable.unfit_for`: what never was in the window must not be taken out of it."""
        if self.alpha == 0:
            return super().unfit_for(rule)
        return (
            f"{self.title} is not right after a sample that outliers = {type(rule).__name__}() "
            "leaves out; use alpha = 0, LinearMHE or an EKF"
        )

    def gains(self, model: Model, dt: float) -> tuple[Array, Array]:
        """Gains L and L tilde, (nx, ny) each, physical units, without the factor alpha.

        Raises
        ------
        TuningError
            If the window does not determine the state or the transition matrix is singular.
        """
        system = self._system(model, dt)
        s = system.s
        factor = s.sx[:, None] / s.sy
        L, L_out, _ = _observer(system, self.N, self.every)
        return L * factor, L_out * factor

    def eigenvalues(self, model: Model, dt: float) -> NDArray[np.complex128]:
        """Eigenvalues of the estimation error from one measured sample to the next, (nx,)."""
        system = self._system(model, dt, noiseless=self.alpha == 0)
        return _eigenvalues(system, self._gain(system), self.N, self.every, self.alpha)

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`.

        Warns
        -----
        UserWarning
            If the recursion is unstable and never starts again.
        """
        system = self._system(model, dt, noiseless=self.alpha == 0)
        gain = self._gain(system)
        found = _eigenvalues(system, gain, self.N, self.every, self.alpha)
        if np.abs(found).max() >= 1 and not self.reinitialise:
            listed = ", ".join(f"{v:.4g}" for v in found)
            warnings.warn(
                f"the recursion with alpha = {self.alpha:g} is unstable: eigenvalues {listed}; "
                "rounding errors will grow without bound. Set reinitialise, lower alpha, or use "
                "LinearMHE",
                stacklevel=2,
            )
        if self.alpha == 0:
            return assemble(self.key, system.s, fixed_gain_halves(system, gain))
        if system.s.Q.any():
            raise TuningError(
                "with alpha > 0 the recursive form has no process noise; give none, or use "
                "alpha = 0 or LinearMHE"
            )
        L, L_out, back = _observer(system, self.N, self.every)
        window = Sliding(
            system, self.N, self.every, self.reinitialise, L=L, L_out=self.alpha * L_out, back=back
        )
        return sliding_window(self.key, window)

    def _gain(self, system: Linear) -> Array:
        """What the newest sample does to the estimate, (nx, ny)."""
        gain_of = newest_exact_gain if exact_sensors(system.s) else newest_gain
        return gain_of(system, self.N, every=self.every)

    def _system(self, model: Model, dt: float, *, noiseless: bool = False) -> Linear:
        system = linear(
            model,
            dt,
            noise=self.noise,
            prior=self.prior,
            hold=self.hold,
            noiseless=noiseless,
        )
        require_observable(model, samples=self.N // self.every + 1)
        return system


def _observer(system: Linear, N: int, every: int) -> tuple[Array, Array, Array]:
    """Return L, L tilde, and C A^-(N + m), the row of the sample that leaves."""
    A, C = system.A, system.C
    if np.linalg.cond(A) > 1e12:
        raise TuningError(
            "the transition matrix is singular, so that the model cannot be run backwards to the "
            "sample that leaves the window; use alpha = 0 or LinearMHE"
        )
    fixed = gains(system, N, every=every)
    back = C @ np.linalg.matrix_power(np.linalg.inv(A), N + every)
    L_out = np.asarray(np.linalg.solve(system.s.R, back @ fixed.P).T, float)
    return fixed.M[:, -len(C) :], L_out, back


def _eigenvalues(
    system: Linear, gain: Array, N: int, every: int, alpha: float
) -> NDArray[np.complex128]:
    A, C = system.A, system.C
    if alpha:
        L, L_out, back = _observer(system, N, every)
        remaining = np.eye(len(A)) - L @ C + alpha * L_out @ back
    else:
        remaining = np.eye(len(A)) - gain @ C
    return np.linalg.eigvals(remaining @ np.linalg.matrix_power(A, every)).astype(complex)
