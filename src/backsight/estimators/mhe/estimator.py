"""Moving horizon estimation: nonlinear least squares over a window with process noise."""

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np

from backsight.description import Called, Distinct, Horizon, Lag, Positive, Sound, alike
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError, nearest
from backsight.estimators._inspection import Inspection
from backsight.estimators.arrival import (
    ARRIVALS,
    ConstantArrival,
    EKFArrival,
    Fitting,
    NoArrival,
    SmoothedArrival,
    UKFArrival,
    arrival_name,
)
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman.ekf import EKF
from backsight.estimators.kalman.square_root import refuse_too_wide
from backsight.estimators.mhe._inspect import filled, inspection
from backsight.estimators.mhe._sample import Parts, recursion
from backsight.estimators.mhe._steady import steady_windows, window_limit
from backsight.estimators.mhe._window import transition_pattern
from backsight.estimators.parts.limits import Limit, hard_bounds, limits_of, names_used_twice
from backsight.estimators.parts.stages import chain_of
from backsight.estimators.parts.window import lag_faults
from backsight.estimators.scaled import setting
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Innovations
from backsight.solvers.box import GaussNewton


@dataclasses.dataclass(frozen=True)
class MHE(AbstractEstimator):
    r"""Moving horizon estimator with process noise.

    At every sample k it finds the trajectory through the window k - N ... k that minimises

    .. math:: \tfrac12 (x_{k-N} - \bar x)' \bar P^{-1} (x_{k-N} - \bar x)
        + \tfrac12 \sum_{i=k-N}^{k-1} w_i' Q^{-1} w_i
        + \tfrac12 \sum_{i=k-N}^{k} v_i' R^{-1} v_i,

    .. math:: x_{i+1} = f(x_i, u_i) + w_i, \qquad y_i = h(x_i, u_i) + v_i,

    subject to bounds on x, w and v. All states are unknowns (multiple shooting); a Gauss-Newton
    step is a Kalman filter forward and adjoints backward, so that the cost of a sample is linear in
    N, Q and the covariance of the arrival cost may be singular, and the covariances of all states
    come with it. Active bounds are exact measurements, found by an exact active set method.

    Parameters
    ----------
    noise : Noise
        The process noise enters once per sample, as for ``EKF(covariance="discrete")``.
    prior : Prior
        Used until the window is full.
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    arrival : AbstractArrival
        What is known from before the window, see `backsight.estimators.arrival`. With
        `SmoothedArrival`, `EKFArrival` and `UKFArrival` the estimate of a linear model is the
        Kalman filter's.
    integrator : Integrator
        For continuous-time models.
    optimiser : GaussNewton
        With ``tolerance = 0`` exactly `max_iterations` full steps from the shifted solution of the
        last sample (real-time iteration); else to convergence, with step control.
    limits : tuple of Limit
        Bounds on sums of states, residuals or process noise at every sample of the window, beside
        the bounds of the states in the model.
    soft : dict
        Name of a limit or of a bounded state to the weight c of its violation: instead of being
        imposed, it costs :math:`\tfrac12 c\,\text{violation}^2`, physical units.
    constant : tuple of str
        States without process noise inside the window; their random walk is added when the window
        moves. For parameters: one value per window. P counts the walk inside the window, too.
    lag : int or "N"
        The estimate of a sample is made when `lag` more have been measured: a fixed-lag smoother;
        with ``lag = "N"`` from the start of the window. Results are put to the sample that they are
        about; a stream gives at every step the estimate of the sample `lag` steps ago, and at
        first that of the first sample.
    gain : {"converged", "exact"}
        Of linear models with more than a dozen states, a filter as arrival cost and no `lag`:
        ``converged`` takes the same gains for all windows once their covariances have come to their
        limit, while all channels are measured and no limit is active, as `KalmanFilter` does and
        with its bound: the estimate changes by less than 1e-10 standard deviations. ``exact``
        solves every window.

    Notes
    -----
    ``e`` and ``S`` are innovation and covariance of the sample before it entered the window. P is
    without the bounds that happen to be active: that they are is known from the data only. Limits
    with the same lower and upper end are equations, and count as exact measurements.

    If limits contradict each other, the estimate is the one without limits, the status says
    *infeasible*, and the output ``infeasible`` names them. ``kkt`` is the residual of the last
    linear problem in standard deviations of the measurements. If the model overflows, so that there
    is no estimate, the next sample starts anew from the prior.

    References
    ----------
    Rao, Rawlings, Mayne, "Constrained state estimation for nonlinear discrete-time systems:
    stability and moving horizon approximations", 2003, doi:10.1109/TAC.2002.808470.
    Bell, "The iterated Kalman smoother as a Gauss-Newton method", 1994, doi:10.1137/0804035.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0)
    >>> mhe = bs.MHE(noise, prior, N=10, arrival=bs.settings.EKFArrival())
    >>> mhe.N, mhe.arrival
    (10, EKFArrival())
    """

    key: ClassVar[str] = "mhe"
    title: ClassVar[str] = "Moving horizon estimator"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q",)

    noise: Noise
    prior: Prior
    N: Horizon = 15
    arrival: Annotated[
        SmoothedArrival | EKFArrival | UKFArrival | ConstantArrival | NoArrival,
        Called("the arrival cost"),
    ] = dataclasses.field(default_factory=SmoothedArrival)
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    optimiser: GaussNewton = dataclasses.field(default_factory=GaussNewton)
    limits: tuple[Limit, ...] = ()
    soft: Mapping[str, Annotated[Positive, Called("soft: the weight")]] = dataclasses.field(
        default_factory=dict
    )
    constant: Annotated[tuple[str, ...], Distinct()] = ()
    lag: Lag = 0
    gain: Literal["converged", "exact"] = "converged"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("lag", "N"):
            yield from lag_faults(self.lag, self.N)
        if sound("limits"):
            yield from names_used_twice(self.limits)

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`; a walk that the window neglects colours them."""
        return "coloured" if self._neglects_walks() else self.arrival.innovations

    @property
    def forgets(self) -> bool:
        """See `AbstractEstimator.forgets`."""
        return isinstance(self.arrival, NoArrival | ConstantArrival)

    @property
    def judges_steps(self) -> bool:
        """See `AbstractEstimator.judges_steps`."""
        return self.optimiser.tolerance > 0

    @property
    def one_sided(self) -> bool:
        """See `AbstractEstimator.one_sided`."""
        return isinstance(self.arrival, EKFArrival)

    def _neglects_walks(self) -> bool:
        """Whether a state that is constant in the window may walk by the noise."""
        walk = self.noise.sigma_w
        if isinstance(walk, Mapping):
            return any(walk.get(name, 0.0) > 0 for name in self.constant)
        given = [k for k in (walk, self.noise.Q, self.noise.Qc) if k is not None]
        return bool(self.constant) and any(np.any(k) for k in given)

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        parts = self._parts(model, dt)
        plain = recursion(self.key, parts)
        limit = window_limit(parts, self.arrival) if self.gain == "converged" else None
        return plain if limit is None else steady_windows(plain, parts, limit)

    def variants(self) -> Mapping[str, AbstractEstimator]:
        """See `AbstractEstimator.variants`: the arrival costs in `ARRIVALS`."""
        others = {n: part for n, part in ARRIVALS.items() if not alike(part, self.arrival)}
        return {arrival_name(self.arrival): self} | {
            n: dataclasses.replace(self, arrival=part) for n, part in others.items()
        }

    def inspect(self, model: Model, dt: float) -> Inspection:
        """See `AbstractEstimator.inspect`."""
        parts = self._parts(model, dt)
        guess = EKF(self.noise, self.prior, self.integrator).build(model, dt)
        return Inspection(
            inspection(parts), parts.limits.names, functools.partial(filled, parts, guess)
        )

    def _parts(self, model: Model, dt: float) -> Parts:
        whole = setting(
            model,
            dt,
            noise=self.noise,
            prior=self.prior,
            integrator=self.integrator,
            noiseless=True,
        ).sampled()
        refuse_too_wide(whole, "MHE")
        s = hard_bounds(whole, self.soft)
        names = [x.name for x in s.model.states]
        for name in self.constant:
            if name not in names:
                raise TuningError(f"constant: there is no state '{name}': {nearest(name, names)}")
        moves = np.array([n not in self.constant for n in names], float)
        kept = np.outer(moves, moves)
        inside, parts = s.Q * kept, [part.Q for part in s.parts]
        limits = limits_of(whole, inside + sum(parts), self.limits, self.soft)
        if any((part * (1 - kept)).any() for part in parts):
            raise TuningError(
                "noise that inputs multiply does not go with walks of states that are constant in "
                "a window"
            )
        moved = transition_pattern(s, s.integrator)
        chain = chain_of(s, limits, moved, Q=inside, N=self.N, parts=parts)
        return Parts(
            s=s,
            walk=s.Q - inside,
            chain=chain,
            limits=limits,
            arrival=self.arrival.build(Fitting(s, s.integrator, s.Q, chain)),
            integrator=s.integrator,
            optimiser=self.optimiser,
            lag=self.delay,
        )
