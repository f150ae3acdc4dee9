"""Unscented Kalman filter in square-root form, discrete or continuous-discrete."""

import dataclasses
from typing import ClassVar

import casadi as ca

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.update import masked, measured
from backsight.description import Positive
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import scaled_rows
from backsight.engine.recursion import ForwardBackward, Recursion
from backsight.estimators.base import AbstractEstimator, Setting, Spread, setting
from backsight.estimators.kalman.exact_sensors import with_exact_sensors
from backsight.estimators.kalman.sigma_points import (
    Outside,
    SigmaPoints,
    images_ahead,
    images_seen,
    points_of,
    unscented_looks,
)
from backsight.estimators.kalman.square_root import covariance_of_factor, opened_factor
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    matrix_product,
    scatter_and_noise,
)
from backsight.estimators.parts.factors import (
    Factor,
    cholesky,
    cholesky_factor,
    deviation_factor,
    joint_factor,
    mean_and_deviations,
    solve_lower,
    where_definite,
)
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.stages import noise_seen
from backsight.estimators.parts.substeps import within_bounds, within_bounds_of_many
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

    The model is never asked outside the bounds of the states, however wide their spread, so that a
    parameter that must be positive (a mass) is. See `outside`; the sample's status says *clipped*.
    A mean outside is set to the bound. If a covariance has no factor, which needs a negative weight
    (small alpha), the update is left out and the status says so.

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
    outside : {"moved", "clipped"}
        Of sigma points outside the bounds. ``moved``: pairs are moved inside and tell the slope of
        the model; the spread is that without bounds, as in the other filters, see
        `backsight.estimators.kalman.sigma_points`. ``clipped``: each is set to the bound; that
        draws the mean away from it in every prediction and makes the bands too narrow there, but
        may hold parameters in place that a strongly nonlinear model would lose with a wide prior.

    References
    ----------
    van der Merwe and Wan, "The square-root unscented Kalman filter for state and
    parameter-estimation", 2001, doi:10.1109/ICASSP.2001.940586.

    Examples
    --------
    >>> ukf = bs.UKF(bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0))
    >>> ukf.alpha, ukf.outside
    (1.0, 'moved')
    """

    key: ClassVar[str] = "ukf"
    title: ClassVar[str] = "Unscented Kalman filter"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    looks_back: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q",)

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    alpha: Positive = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    outside: Outside = "moved"

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s = self._setting(model, dt)
        halves = ukf_halves(s, s.integrator, self._points(s))
        return assemble(self.key, s, with_exact_sensors(s, halves))

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`."""
        s = self._setting(model, dt)
        points = self._points(s)
        parts = with_exact_sensors(s, ukf_halves(s, s.integrator, points))
        looks = unscented_looks(
            s,
            points.weights,
            opened=opened_factor(s),
            moved=images_ahead(s, points, s.integrator),
            shown=_shown(s, images_seen(s, points)),
            innovation=parts.innovation,
            Q=_noise_root(s),
        )
        return passes(self.key, s, parts, looks, covariance=covariance)

    def _setting(self, model: Model, dt: float) -> Setting:
        return setting(
            model,
            dt,
            noise=self.noise,
            prior=self.prior,
            integrator=self.integrator,
            noiseless=True,
        )

    def _points(self, s: Setting) -> SigmaPoints:
        return points_of(
            s, alpha=self.alpha, beta=self.beta, kappa=self.kappa, outside=self.outside
        )


def ukf_halves(s: Setting, integrator: Integrator, points: SigmaPoints) -> Halves:
    """Measurement update and time update, see `UKF`; the spread is that of `Factor`."""
    kept, looked = Factor(Covariance(s.model.nx)), images_seen(s, points)
    return Halves(
        spread_of=kept.spread,
        innovation=_innovation(s, points, looked),
        correct=_correct(s, points, looked),
        predict=_predict(s, points, integrator),
        covariance=covariance_of_factor(s),
        ramp=integrator.hold == "foh",
    )


def _innovation(s: Setting, points: SigmaPoints, looked: ca.Function) -> ca.Function:
    w, ny = points.weights, s.model.ny
    sizes = {"Y": looked.size_out(0), "y_mean": ny}

    def seen(y: ca.SX, y_mean: ca.SX, mask: ca.SX) -> Results:
        return {"e": measured(mask) * (y - y_mean)}

    missed = leaf("missed", {**notation(s), **sizes}, seen)

    def formula(Y: Term, y: Term, mask: Term) -> Results:
        y_mean, dY = mean_and_deviations(Y, w)
        S = scatter_and_noise(dY, w.covariance, s.R, mask)
        return {"e": missed(y, y_mean, mask), "S": S}

    told = half("innovation_seen", s, formula, sizes)
    x, spread, u, y, mask = given = _sample_of(s, looked)
    return ca.Function("innovation", given, list(told(looked(x, spread, u)[0], y, mask)))


def _correct(s: Setting, points: SigmaPoints, looked: ca.Function) -> ca.Function:
    """Measurement update from one triangular factor.

    The joint factor of outputs and states, [[Sy, 0], [K Sy, L+]], holds the gain and the factor of
    the posterior, so that nothing is ever subtracted from a covariance.
    """
    nx, ny, kept, w = s.model.nx, s.model.ny, Factor(Covariance(s.model.nx)), points.weights
    sizes = {
        **notation(s), "moved": nx, "held": 1, "definite": 1, "failed": 1, "spread": kept.size,
        "Y": looked.size_out(0),
    }  # fmt: skip

    def settled(x: ca.SX, moved: ca.SX, held: ca.SX, definite: ca.SX, failed: ca.SX) -> Results:
        free = ca.if_else(definite, x + moved, x)
        x_post = within_bounds(s, free)
        clipped = ca.if_else(ca.norm_1(x_post - free) > 0, 1, held)
        flags = Flags(clipped=clipped, not_positive_definite=ca.fmax(1 - definite, failed))
        return {"x_post": x_post, "flags": flags.vector()}

    weigh, settle = _weighed(s, len(w.mean)), leaf("settle", sizes, settled)

    def formula(x: Term, spread: Term, Y: Term, held: Term, y: Term, mask: Term) -> Results:
        y_mean, dY = mean_and_deviations(Y, w)
        dY, e, noise = weigh(y, dY, y_mean, mask)
        # The outputs see points inside the bounds, the spread is that of the state: or else every
        # sample would make it smaller next to a bound, whatever was measured.
        joint, definite = joint_factor(dY, kept.opened(spread), w, noise)
        Sy, KSy, L_post = joint[:ny, :ny], joint[ny:, :ny], joint[ny:, ny:]
        moved = matrix_product(KSy, solve_lower(Sy, e))
        x_post, flags = settle(x, moved, held, definite, spread[-1])
        L_next = where_definite(definite, kept.closed(L_post), spread[:-1])
        return {"x_post": x_post, "spread_post": ca.vertcat(L_next, 0), "flags": flags}

    corrected = half("corrected", s, formula, sizes)
    x, spread, u, y, mask = given = _sample_of(s, looked)
    return ca.Function("correct", given, list(corrected(x, spread, *looked(x, spread, u), y, mask)))


def _weighed(s: Setting, count: int) -> ca.Function:
    """Rows that were measured: ``(y, dY, y_mean, mask) -> (dY, e, factor of the noise)``."""
    ny = s.model.ny
    if not Covariance(s.model.nx).whole:

        def rows(y: ca.SX, dY: ca.SX, y_mean: ca.SX, mask: ca.SX) -> Results:
            dY, e, R = masked(dY, y - y_mean, ca.SX(s.R), mask)
            noise = ca.densify(cholesky_semidefinite(R))
            return {"dY_seen": ca.densify(dY), "e": e, "noise": noise}

        return leaf("weigh", {**notation(s), "dY": (ny, count)}, rows)
    sizes = {"y": (ny, 1), "dY": (ny, count), "y_mean": (ny, 1), "mask": (ny, 1)}
    y, dY, y_mean, mask = given = [ca.MX.sym(k, *n) for k, n in sizes.items()]
    factor = cholesky(noise_seen(s)(mask))
    return ca.Function("weigh", given, [scaled_rows(dY, mask), mask * (y - y_mean), factor])


def _sample_of(s: Setting, looked: ca.Function) -> list[ca.MX]:
    """Symbols of x, spread, u, y and mask."""
    sizes = {"x": s.model.nx, "spread": looked.numel_in(1), "u": s.model.nu}
    sizes |= {"y": s.model.ny, "mask": s.model.ny}
    return [ca.MX.sym(k, n) for k, n in sizes.items()]


def _predict(s: Setting, points: SigmaPoints, integrator: Integrator) -> ca.Function:
    """Sigma points through the model, ``(x, L, u, u_next) -> (x, L)``; Q is added per sample."""
    kept, noise, w = Factor(Covariance(s.model.nx)), _noise_root(s), points.weights
    roots = [(part.factor, cholesky_factor(part.Q)) for part in s.sampled().parts]
    few = leaf("within", notation(s), lambda x: {"x_in": within_bounds(s, x)})

    def inside(x: Term) -> Term:
        return within_bounds_of_many(s, x) if Covariance(s.model.nx).whole else few(x)

    def gathered(X: Term, spread: Term, u: Term) -> Results:
        mean, d = mean_and_deviations(X, w)
        added = columns_at(noise, roots, u) if roots else type(X)(ca.DM(noise))
        L, definite = deviation_factor(d, w, added)
        L_next = where_definite(definite, kept.closed(L), spread[:-1])
        return {"x_next": inside(mean), "spread_next": ca.vertcat(L_next, 1 - definite)}

    gather = half("gather", s, gathered, {"spread": kept.size, "X": (s.model.nx, len(w.mean))})
    images = images_ahead(s, points, integrator)
    given = [ca.MX.sym(images.name_in(i), images.numel_in(i)) for i in range(4)]
    return ca.Function("predict", given, gather.call([images(*given), given[1], given[2]]))


def _noise_root(s: Setting) -> Array:
    """Factor of the process noise of a sample."""
    return cholesky_factor(s.sampled().Q)


def _shown(s: Setting, looked: ca.Function) -> ca.Function:
    """Outputs at the sigma points, ``(x, spread, u) -> Y``."""
    x, spread, u, _, _ = _sample_of(s, looked)
    return ca.Function("shown", [x, spread, u], [looked(x, spread, u)[0]])
