"""Unscented Kalman filter in square-root form, discrete or continuous-discrete."""

import dataclasses
from typing import ClassVar

import casadi as ca

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.sigma import Weights, weights
from backsight.algebra.triangular import forward
from backsight.algebra.update import masked, measured, noise_of
from backsight.description import Positive
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import ForwardBackward, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Setting, Spread, setting
from backsight.estimators.kalman._unscented import unscented_looks
from backsight.estimators.kalman.square_root import covariance_of_factor
from backsight.estimators.parts.covariance import Covariance, Term, times_transposed
from backsight.estimators.parts.factors import (
    Factor,
    cholesky_factor,
    deviation_factor,
    each_column,
    joint_factor,
    minus,
    sigma_columns,
)
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.substeps import flow, substep_inputs, within_bounds
from backsight.estimators.smoothing import passes
from backsight.estimators.uncertainty import Noise, Prior
from backsight.estimators.varied_noise import columns_at
from backsight.models.model import Model
from backsight.schema import Innovations
from backsight.types import Array


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
    noise_states: ClassVar[bool] = True
    varies_noise: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    alpha: Positive = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior, integrator=self.integrator)
        points = points_of(s, alpha=self.alpha, beta=self.beta, kappa=self.kappa)
        return assemble(self.key, s, ukf_halves(s, s.integrator, points))

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior, integrator=self.integrator)
        w = points_of(s, alpha=self.alpha, beta=self.beta, kappa=self.kappa)
        looks = unscented_looks(
            s,
            w,
            opened=_opened(s),
            moved=_images(s, w, s.integrator),
            shown=_shown(s, w),
            Q=_noise_root(s),
        )
        parts = ukf_halves(s, s.integrator, w)
        return passes(self.key, s, parts, looks, covariance=covariance)


def points_of(s: Setting, *, alpha: float, beta: float, kappa: float) -> Weights:
    """Spread and weights of the sigma points for a model; raises `TuningError`, see `UKF`."""
    n = s.model.nx
    if not n + kappa > 0:
        raise TuningError(f"kappa is {kappa}; it must be above -{n} for {n} states")
    return weights(n, alpha=alpha, beta=beta, kappa=kappa)


def ukf_halves(s: Setting, integrator: Integrator, w: Weights) -> Halves:
    """Measurement update and time update, see `UKF`; the spread is that of `Factor`."""
    kept = Factor(Covariance(s.model.nx))
    return Halves(
        spread_of=kept.spread,
        innovation=_innovation(s, w),
        correct=_correct(s, w),
        predict=_predict(s, w, integrator),
        covariance=covariance_of_factor(s),
        ramp=integrator.hold == "foh",
    )


def _points(s: Setting, w: Weights, x: Term, spread: Term) -> tuple[Term, Term]:
    """Sigma points inside the bounds of the states, and how far that moved them."""
    L = Factor(Covariance(s.model.nx)).opened(spread)
    within = leaf(
        "within",
        notation(s),
        lambda x: {"x_in": within_bounds(s, x), "off": within_bounds(s, x) - x},
    )
    points, off = each_column(within, sigma_columns(x, L, w.spread))
    return points, off


def _outputs(s: Setting, w: Weights, points: Term, u: Term) -> tuple[Term, Term]:
    """Mean output (ny,) and deviations from it (ny, 2 n + 1)."""
    (Y,) = each_column(
        leaf("output", notation(s), lambda x, u: {"y": s.model.output(x, u)}), points, u
    )
    mean = Y @ w.mean
    return mean, minus(Y, mean)


def _innovation(s: Setting, w: Weights) -> ca.Function:
    def seen(y: ca.SX, dY: ca.SX, y_mean: ca.SX, mask: ca.SX) -> Results:
        S = dY @ ca.diag(ca.SX(w.covariance)) @ dY.T + noise_of(ca.SX(s.R), mask)
        return {"e": measured(mask) * (y - y_mean), "covariance": S}

    sizes = {"dY": (s.model.ny, len(w.mean)), "spread": Factor(Covariance(s.model.nx)).size}
    compare = leaf("compare", {**notation(s), **sizes}, seen)

    def formula(x: Term, spread: Term, u: Term, y: Term, mask: Term) -> Results:
        y_mean, dY = _outputs(s, w, _points(s, w, x, spread)[0], u)
        e, S = compare(y, dY, y_mean, mask)
        return {"e": e, "S": S}

    return half("innovation", s, formula, sizes)


def _correct(s: Setting, w: Weights) -> ca.Function:
    """Measurement update from one triangular factor.

    The joint factor of outputs and states, [[Sy, 0], [K Sy, L+]], holds the gain and the factor of
    the posterior, so that nothing is ever subtracted from a covariance.
    """
    nx, ny, kept = s.model.nx, s.model.ny, Factor(Covariance(s.model.nx))
    sizes = {
        **notation(s), "dY": (ny, len(w.mean)), "KSy": (nx, ny), "Sy": (ny, ny), "held": 1,
        "definite": 1, "failed": 1, "spread": kept.size,
    }  # fmt: skip

    def rows(y: ca.SX, dY: ca.SX, y_mean: ca.SX, mask: ca.SX) -> Results:
        dY, e, R = masked(dY, y - y_mean, ca.SX(s.R), mask)
        noise = ca.densify(cholesky_semidefinite(R))
        return {"dY_seen": ca.densify(dY), "e": e, "noise": noise}

    def settled(
        x: ca.SX, KSy: ca.SX, Sy: ca.SX, e: ca.SX, held: ca.SX, definite: ca.SX, failed: ca.SX
    ) -> Results:
        free = ca.if_else(definite, x + KSy @ forward(Sy, e), x)
        x_post = within_bounds(s, free)
        clipped = ca.if_else(ca.norm_1(x_post - free) > 0, 1, held)
        flags = Flags(clipped=clipped, not_positive_definite=ca.fmax(1 - definite, failed))
        return {"x_post": x_post, "flags": flags.vector()}

    weigh, settle = leaf("weigh", sizes, rows), leaf("settle", sizes, settled)

    def formula(x: Term, spread: Term, u: Term, y: Term, mask: Term) -> Results:
        points, off = _points(s, w, x, spread)
        held = ca.if_else(ca.norm_1(ca.vec(off)) > 0, 1, 0)
        y_mean, dY = _outputs(s, w, points, u)
        dY, e, noise = weigh(y, dY, y_mean, mask)
        # The outputs see points inside the bounds, the spread is that of the state: or else every
        # sample would make it smaller next to a bound, whatever was measured.
        joint, definite = joint_factor(dY, kept.opened(spread), w, noise)
        Sy, KSy, L_post = joint[:ny, :ny], joint[ny:, :ny], joint[ny:, ny:]
        x_post, flags = settle(x, KSy, Sy, e, held, definite, spread[-1])
        L_next = ca.if_else(definite, kept.closed(L_post), spread[:-1])
        return {"x_post": x_post, "spread_post": ca.vertcat(L_next, 0), "flags": flags}

    return half("correct", s, formula, {"spread": kept.size})


def _images(s: Setting, w: Weights, integrator: Integrator) -> ca.Function:
    """Sigma points one sample later, ``(x, spread, u, u_next) -> X``."""
    size, h = Factor(Covariance(s.model.nx)).size, s.dt / integrator.steps
    sizes = {"spread": size, "X": (s.model.nx, len(w.mean))}

    def advance(x: ca.SX, ua: ca.SX, ub: ca.SX) -> Results:
        if not s.model.continuous:
            return {"x_next": s.model.rhs(x, ua)}
        return {"x_next": flow(s, integrator, x, ua=ua, ub=ub, h=h)}

    one = leaf("advance_point", notation(s), advance)
    all_points = half(
        "advance_points",
        s,
        lambda X, ua, ub: {"X_next": each_column(one, X, ua, ub)[0]},
        sizes,
    )
    start = half("sigma_points", s, lambda x, spread: {"X": _points(s, w, x, spread)[0]}, sizes)
    x, spread = ca.MX.sym("x", s.model.nx), ca.MX.sym("L", size)
    u, u_next = ca.MX.sym("u", s.model.nu), ca.MX.sym("u_next", s.model.nu)
    xs, held = substep_inputs(integrator, u, u_next)
    steps = integrator.steps if s.model.continuous else 1
    (end,), _ = scan(all_points, steps, carry=[start(x, spread)], xs=xs, constants=held)
    return ca.Function("images", [x, spread, u, u_next], [end])


def _predict(s: Setting, w: Weights, integrator: Integrator) -> ca.Function:
    """Sigma points through the model, ``(x, L, u, u_next) -> (x, L)``; Q is added per sample."""
    kept, noise, sampled = Factor(Covariance(s.model.nx)), _noise_root(s), s.sampled()
    roots = [(part.index, cholesky_factor(part.Q)) for part in sampled.parts]

    def gathered(X: Term, spread: Term, u: Term) -> Results:
        mean = times_transposed(X, ca.DM(w.mean).T)
        added = columns_at(noise, roots, u) if roots else type(X)(ca.DM(noise))
        L, definite = deviation_factor(minus(X, mean), w, added)
        L_next = ca.if_else(definite, kept.closed(L), spread[:-1])
        return {"x_next": mean, "spread_next": ca.vertcat(L_next, 1 - definite)}

    gather = half("gather", s, gathered, {"spread": kept.size, "X": (s.model.nx, len(w.mean))})
    images = _images(s, w, integrator)
    given = [ca.MX.sym(images.name_in(i), images.numel_in(i)) for i in range(4)]
    return ca.Function("predict", given, gather.call([images(*given), given[1], given[2]]))


def _noise_root(s: Setting) -> Array:
    """Factor of the process noise of a sample."""
    return cholesky_factor(s.sampled().Q)


def _opened(s: Setting) -> ca.Function:
    """Spread to the lower factor (nx, nx)."""
    kept = Factor(Covariance(s.model.nx))
    sizes = {"spread": kept.size}
    return half("opened", s, lambda spread: {"L": ca.densify(kept.opened(spread))}, sizes)


def _shown(s: Setting, w: Weights) -> ca.Function:
    """Outputs at the sigma points, ``(x, spread, u) -> Y``."""

    def formula(x: Term, spread: Term, u: Term) -> Results:
        output = leaf("output", notation(s), lambda x, u: {"y": s.model.output(x, u)})
        return {"Y": each_column(output, _points(s, w, x, spread)[0], u)[0]}

    sizes = {"spread": Factor(Covariance(s.model.nx)).size, "Y": (s.model.ny, len(w.mean))}
    return half("shown", s, formula, sizes)
