"""Unscented Kalman filter in square-root form, discrete or continuous-discrete."""

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.sigma import Weights, factor, sigma_points, weights
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.triangular import forward
from backsight.algebra.update import masked, measured, noise_of
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Setting, setting
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.gaussian import clip, flow, substep_inputs
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model


@dataclasses.dataclass(frozen=True)
class UKF(AbstractEstimator):
    r"""Unscented Kalman filter.

    Mean and covariance go through model and output equation by 2 n + 1 sigma points, without a
    derivative; process and measurement noise are additive. The covariance is kept as its lower
    factor, :math:`P = L L'`, and is therefore positive semidefinite always.

    Sigma points outside the bounds of the states are set to them before they are used, so that a
    parameter that must be positive (a mass) never becomes negative in the model, however wide its
    spread; in the prediction this also moves the mean away from the bound, and the sample's status
    says that it was clipped. A measurement takes the whole spread, also what is outside the bound.
    If a covariance has no factor, which needs a negative weight (small alpha), the update is left
    out and the status says so.

    Parameters
    ----------
    noise : Noise
        The process noise is added once per sample.
    prior : Prior
    integrator : Integrator
        For continuous-time models.
    alpha, beta, kappa : float
        Spread of the sigma points: alpha > 0 scales it, beta = 2 is best for Gaussians, kappa
        fine-tunes it. With the defaults no weight of the covariance is negative.

    References
    ----------
    van der Merwe and Wan, "The square-root unscented Kalman filter for state and
    parameter-estimation", 2001, doi:10.1109/ICASSP.2001.940586.
    """

    key: ClassVar[str] = "ukf"
    title: ClassVar[str] = "Unscented Kalman filter"
    weighs: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if not self.alpha > 0:
            raise TuningError(f"alpha is {self.alpha}; the spread of sigma points must be positive")

    def compile(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.compile`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior)
        return assemble(self.key, s, self.halves(s))

    def halves(self, s: Setting) -> Halves:
        """Measurement update and time update."""
        n = s.model.nx
        if not n + self.kappa > 0:
            raise TuningError(f"kappa is {self.kappa}; it must be above -{n} for {n} states")
        w = weights(n, alpha=self.alpha, beta=self.beta, kappa=self.kappa)
        start = cholesky_semidefinite(ca.SX(ca.DM(s.P0)))
        return Halves(
            spread0=np.append(np.asarray(ca.evalf(vech(start))), 0.0),
            innovation=_innovation(s, w),
            correct=_correct(s, w),
            predict=_predict(s, w, self.integrator),
            covariance=_covariance(n),
            ramp=self.integrator.hold == "foh",
        )


def _symbols(s: Setting) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    """State, spread, u, y, mask; the spread is the factor and 1 if a prediction had none."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    sizes = {"x": nx, "spread": nx * (nx + 1) // 2 + 1, "u": nu, "y": ny, "mask": ny}
    x, spread, u, y, mask = (ca.SX.sym(name, size) for name, size in sizes.items())
    return x, spread, u, y, mask


def _points(s: Setting, w: Weights, x: ca.SX, spread: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Sigma points inside the bounds of the states, and how far outside they were."""
    free = sigma_points(x, ca.tril(unvech(spread[:-1])), w.spread)
    points = ca.horzcat(*(clip(s, free[:, i]) for i in range(free.shape[1])))
    return points, free - points


def _outputs(s: Setting, w: Weights, points: ca.SX, u: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mean output (ny,) and deviations from it (ny, 2 n + 1)."""
    Y = ca.horzcat(*(s.model.output(points[:, i], u) for i in range(points.shape[1])))
    mean = Y @ w.mean
    return mean, Y - mean


def _innovation(s: Setting, w: Weights) -> ca.Function:
    x, spread, u, y, mask = _symbols(s)
    y_mean, dY = _outputs(s, w, _points(s, w, x, spread)[0], u)
    S = dY @ ca.diag(ca.SX(w.covariance)) @ dY.T + noise_of(ca.SX(s.R), mask)
    e = measured(mask) * (y - y_mean)
    return ca.Function("innovation", [x, spread, u, y, mask], [e, vech(S)])


def _correct(s: Setting, w: Weights) -> ca.Function:
    """Measurement update from one triangular factor.

    The joint factor of outputs and states, [[Sy, 0], [K Sy, L+]], holds the gain and the factor of
    the posterior, so that nothing is ever subtracted from a covariance.
    """
    x, spread, u, y, mask = _symbols(s)
    nx, ny = s.model.nx, s.model.ny
    points, outside = _points(s, w, x, spread)
    held = ca.if_else(ca.norm_1(ca.vec(outside)) > 0, 1, 0)
    y_mean, dY = _outputs(s, w, points, u)
    dY, e, R = masked(dY, y - y_mean, ca.SX(s.R), mask)
    noise = ca.vertcat(cholesky_semidefinite(R), ca.SX.zeros(nx, ny))
    # The outputs see points inside the bounds, the spread is that of the state: or else every
    # sample would make it smaller next to a bound, whatever was measured.
    joint, definite = factor(ca.vertcat(dY, points + outside - x), w, noise)
    Sy, KSy, L_post = joint[:ny, :ny], joint[ny:, :ny], joint[ny:, ny:]
    moved = x + KSy @ forward(Sy, e)
    free = ca.if_else(definite, moved, x)
    x_post = clip(s, free)
    clipped = ca.if_else(ca.norm_1(x_post - free) > 0, 1, held)
    L_next = ca.if_else(definite, vech(ca.densify(L_post)), spread[:-1])
    flags = ca.vertcat(clipped, 0, 0, ca.fmax(1 - definite, spread[-1]))
    after = ca.vertcat(L_next, 0)
    return ca.Function("correct", [x, spread, u, y, mask], [x_post, after, flags])


def _predict(s: Setting, w: Weights, integrator: Integrator) -> ca.Function:
    """Sigma points through the model, ``(x, L, u, u_next) -> (x, L)``; Q is added per sample."""
    x, before, u, _, _ = _symbols(s)
    start = ca.Function("sigma_points", [x, before], _points(s, w, x, before)[:1])
    nx, n_points = start.size_out(0)
    X, ub = ca.SX.sym("X", nx, n_points), ca.SX.sym("ub", s.model.nu)
    h = s.dt / integrator.substeps

    def advance(point: ca.SX) -> ca.SX:
        if not s.model.continuous:
            return s.model.rhs(point, u)
        return flow(s, integrator, point, ua=u, ub=ub, h=h)

    columns = [advance(X[:, i]) for i in range(n_points)]
    leaf = ca.Function("advance_points", [X, u, ub], [ca.horzcat(*columns)])
    mean = X @ w.mean
    per_sample = s.Q * s.dt if s.model.continuous else s.Q
    noise = cholesky_semidefinite(ca.SX(ca.DM(per_sample)))
    L_next, definite = factor(X - mean, w, noise)
    last = ca.SX.sym("last", before.numel())
    kept = ca.if_else(definite, vech(ca.densify(L_next)), last[:-1])
    spread = ca.vertcat(kept, 1 - definite)
    gather = ca.Function("gather", [X, last], [mean, spread])

    m_x, m_L, m_u, m_next = (
        ca.MX.sym(n, k.numel()) for n, k in (("x", x), ("L", before), ("u", u), ("u_next", u))
    )
    xs, held = substep_inputs(integrator, m_u, m_next)
    steps = integrator.substeps if s.model.continuous else 1
    (end,), _ = scan(leaf, steps, carry=[start(m_x, m_L)], xs=xs, constants=held)
    return ca.Function("predict", [m_x, m_L, m_u, m_next], gather.call([end, m_L]))


def _covariance(n: int) -> ca.Function:
    spread = ca.SX.sym("spread", n * (n + 1) // 2 + 1)
    L = ca.tril(unvech(spread[:-1]))
    return ca.Function("covariance", [spread], [vech(L @ L.T)])
