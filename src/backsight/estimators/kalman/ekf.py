"""Extended Kalman filter, discrete or continuous-discrete."""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar, Literal, TypeAlias, get_args

import casadi as ca

from backsight.algebra.factor import smallest_pivot
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.update import masked, measured, noise_of
from backsight.description import Sound
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Setting, setting
from backsight.estimators.kalman._bucy import assemble_continuous
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    joseph_form,
    kalman_gain,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.substeps import flow, substep_inputs, within_bounds
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model

Propagation: TypeAlias = Literal["transition", "ode", "discrete"]
"""Ways to carry a covariance over a sampling period, see `predict`."""

COVARIANCES: tuple[Propagation, ...] = get_args(Propagation)


@dataclasses.dataclass(frozen=True)
class EKF(AbstractEstimator):
    r"""Extended Kalman filter.

    At every sample k it first corrects the prior with the measurement (eq. 17-20),

    .. math::
        e_k = y_k - h(\hat x_k^-, u_k), \quad S_k = H_k P_k^- H_k' + R, \quad
        K_k = P_k^- H_k' S_k^{-1}, \quad \hat x_k^+ = \hat x_k^- + K_k e_k,

        P_k^+ = (I - K_k H_k) P_k^- (I - K_k H_k)' + K_k R K_k',

    sets states outside their bounds to them, and then carries the estimate to the next sample by
    the model (eq. 13) and the covariance by one of three ways.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    integrator : Integrator
        For continuous-time models.
    covariance : {"transition", "ode", "discrete"}
        ``transition`` (default) keeps P positive semidefinite at every step size; ``ode`` is the
        paper's (eq. 14-16), which may not; ``discrete`` adds Q once per sample. See
        `backsight.estimators.kalman.ekf.predict`.
    measurement : {"sampled", "continuous"}
        ``continuous`` takes the measurement as a signal that goes on between the samples
        (Kalman-Bucy, eq. 13-14 of Riva et al.): it is interpolated, and its noise has the spectral
        density :math:`R_c = R\,\Delta t`. More sub-steps come closer to the continuous filter;
        with short sampling periods there is next to no difference. See
        `backsight.estimators.kalman._bucy`.

    References
    ----------
    Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics with
    plant uncertainties in nanopositioning system estimation", ACC 2012, section III.
    Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter estimation: a
    comparison to extended and unscented Kalman filter".
    Simon, "Optimal State Estimation", 2006, doi:10.1002/0470045345, section 13.2.
    """

    key: ClassVar[str] = "ekf"
    title: ClassVar[str] = "Extended Kalman filter"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: Propagation = "transition"
    measurement: Literal["sampled", "continuous"] = "sampled"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if (
            sound("measurement", "covariance")
            and self.measurement == "continuous"
            and self.covariance != "transition"
        ):
            yield "measurement='continuous' goes with covariance='transition' only"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior)
        parts = ekf_halves(s, self.integrator, self.covariance)
        if self.measurement == "sampled":
            return assemble(self.key, s, parts)
        step = transition(s, self.integrator)
        return assemble_continuous(self.key, s, parts, transition=step, integrator=self.integrator)


def ekf_halves(s: Setting, integrator: Integrator, covariance: Propagation) -> Halves:
    """Measurement update and time update, see `EKF`."""
    kept = Covariance(s.model.nx)
    return Halves(
        spread0=kept.kept(s.P0),
        innovation=innovation(s),
        correct=correct(s, check=covariance == "ode"),
        predict=predict(s, integrator, covariance),
        covariance=kept.triangle(),
        ramp=integrator.hold == "foh",
    )


def innovation(s: Setting) -> ca.Function:
    """Innovation, 0 where not measured, and its covariance: ``(x, P, u, y, mask) -> (e, S)``."""

    def seen(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_prior = s.model.output(x, u)
        e, noise = measured(mask) * (y - y_prior), noise_of(ca.SX(s.R), mask)
        return {"e": e, "H": ca.jacobian(y_prior, x), "noise": noise}

    expected = leaf("expected", notation(s), seen)

    def formula(x: Term, P: Term, u: Term, y: Term, mask: Term) -> Results:
        e, H, R = expected(x, u, y, mask)
        return {"e": e, "S": congruence(H, P, R)}

    return half("innovation", s, formula)


def correct(s: Setting, *, check: bool = False) -> ca.Function:
    r"""Measurement update with clipping, eq. 17-20: ``(x, P, u, y, mask) -> (x, P, flags)``.

    Only measured rows are used. States outside their bounds are set to them and P stays as it is
    (section VI.C). With `check` the pivots of P are looked at, where the time update does not keep
    P positive by itself.
    """

    def formula(x: Term, P: Term, u: Term, y: Term, mask: Term) -> Results:
        x_post, P_post, flags = updated(s, x, P, u, y, mask)
        if check:
            indefinite = ca.if_else(smallest_pivot(P) < -1e-10, 1, 0)
            known = ca.fmin(flags.not_positive_definite + indefinite, 1)
            flags = dataclasses.replace(flags, not_positive_definite=known)
        return {"x_post": x_post, "P_post": P_post, "flags": flags.vector()}

    return half("correct", s, formula)


def updated(s: Setting, x: Term, P: Term, u: Term, y: Term, mask: Term) -> tuple[Term, Term, Flags]:
    """State, covariance (nx, nx) and flags after a measurement, in the formula of a `half`."""

    def seen(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_prior = s.model.output(x, u)
        H, e, R = masked(ca.jacobian(y_prior, x), y - y_prior, ca.SX(s.R), mask)  # eq. 20
        return {"e": e, "H": H, "noise": R}

    e, H, R = leaf("residual", notation(s), seen)(x, u, y, mask)
    K, S = kalman_gain(P, H, R)  # eq. 17
    P_post = joseph_form(P, K, H, R)  # eq. 19
    x_post, flags = settled(s)(x + K @ e, ca.diag(P_post), ca.diag(S))  # eq. 18
    return x_post, P_post, Flags.of(flags)


def settled(s: Setting) -> ca.Function:
    """State within its bounds, and flags: ``(x, variances, of the innovation) -> (x, flags)``."""

    def formula(x: ca.SX, variance: ca.SX, y: ca.SX) -> Results:
        inside = within_bounds(s, x)
        clipped = ca.if_else(ca.norm_1(inside - x) > 0, 1, 0)
        definite = ca.mmin(ca.vertcat(variance, y)) >= 0
        flags = Flags(clipped=clipped, not_positive_definite=ca.if_else(definite, 0, 1))
        return {"x_inside": inside, "flags": flags.vector()}

    return leaf("settled", {**notation(s), "variance": s.model.nx}, formula)


def predict(s: Setting, integrator: Integrator, covariance: Propagation) -> ca.Function:
    r"""Time update over one sampling period, eq. 13-16: ``(x, P, u, u_next) -> (x, P)``.

    ``transition``
        After every sub-step of length h, with the exact Jacobian :math:`\Phi` of the sub-step,
        :math:`P \leftarrow \Phi P \Phi' + \tfrac h2 (Q + \Phi Q \Phi')`: second-order accurate
        (the trapezoidal rule on Van Loan's integral) and positive semidefinite for every h.
    ``ode``
        Eq. 14-16: :math:`\dot P = Z P + P Z' + Q` by the integrator's own method, with Z taken at
        the estimate at the start of the period. Can lose positive definiteness; for few states.
    ``discrete``
        :math:`P \leftarrow F P F' + Q_d` with the Jacobian F of the whole period and
        :math:`Q_d = Q\,\Delta t`. The only choice for discrete-time models.
    """
    kept = Covariance(s.model.nx)
    if kept.whole and covariance == "ode":
        raise TuningError(
            f"covariance 'ode' is not offered for {s.model.nx} states; use 'transition'"
        )
    if not s.model.continuous:
        return _mapped(s)
    nx, nu, n = s.model.nx, s.model.nu, integrator.substeps
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", kept.size)
    u, u_next = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    xs, held = substep_inputs(integrator, u, u_next)
    if covariance == "discrete":
        start = [x, ca.MX(ca.DM.eye(nx).full())]
        final, _ = scan(_sensitivity(s, integrator), n, carry=start, xs=xs, constants=held)
        ends = [final[0], _carried(s)(final[1], P)]
    else:
        step = transition(s, integrator) if covariance == "transition" else _ode(s, integrator)
        frozen = [x] if covariance == "ode" else []
        ends, _ = scan(step, n, carry=[x, P], xs=xs, constants=[*held, *frozen])
    return ca.Function("predict", [x, P, u, u_next], ends)


def _moved(s: Setting, integrator: Integrator) -> ca.Function:
    """State one sub-step later, eq. 13, and its Jacobian: ``(x, ua, ub) -> (x, Phi)``."""
    h = s.dt / integrator.substeps

    def formula(x: ca.SX, ua: ca.SX, ub: ca.SX) -> Results:
        x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
        return {"x_next": x_next, "Phi": ca.jacobian(x_next, x)}

    return leaf("moved", notation(s), formula)


def transition(s: Setting, integrator: Integrator) -> ca.Function:
    """One sub-step, see `predict`: ``(x, P, ua, ub) -> (x, P)``."""
    moved, noise = _moved(s, integrator), ca.DM(s.dt / integrator.substeps / 2 * s.Q)

    def formula(x: Term, P: Term, ua: Term, ub: Term) -> Results:
        x_next, Phi = moved(x, ua, ub)
        return {"x_next": x_next, "P_next": congruence(Phi, P + noise, noise)}

    return half("transition", s, formula)


def _ode(s: Setting, integrator: Integrator) -> ca.Function:
    """One sub-step of eq. 14, see `predict`: ``(x, P, ua, ub, frozen) -> (x, P)``."""
    h = s.dt / integrator.substeps

    def formula(x: ca.SX, P: ca.SX, ua: ca.SX, ub: ca.SX, frozen: ca.SX) -> Results:
        x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
        Z = ca.substitute(ca.jacobian(s.model.rhs(x, ua), x), x, frozen)

        def rhs(v: ca.SX, _: ca.SX) -> ca.SX:
            ZP = Z @ unvech(v)
            return vech(ZP + ZP.T + s.Q)

        v_next = integrator.substep(rhs, vech(P), ua=ua, ub=ub, h=h)
        return {"x_next": x_next, "P_next": unvech(v_next)}

    return leaf("ode", {**notation(s), "frozen": s.model.nx}, formula)


def _sensitivity(s: Setting, integrator: Integrator) -> ca.Function:
    """One sub-step of the state and of F', see `predict`: ``(x, F', ua, ub) -> (x, F')``."""
    moved, nx = _moved(s, integrator), s.model.nx

    def formula(x: Term, Ft: Term, ua: Term, ub: Term) -> Results:
        x_next, Phi = moved(x, ua, ub)
        return {"x_next": x_next, "Ft_next": ca.densify(times_transposed(Ft, Phi))}

    return half("sensitivity", s, formula, {"Ft": (nx, nx)})


def _carried(s: Setting) -> ca.Function:
    """``(F', P) -> F P F' + Q dt``."""
    nx, noise = s.model.nx, ca.DM(s.Q * s.dt)
    return half(
        "carried",
        s,
        lambda Ft, P: {"P_next": congruence(transposed(Ft), P, noise)},
        {"Ft": (nx, nx)},
    )


def _mapped(s: Setting) -> ca.Function:
    """Time update of a discrete-time model, see `predict`."""

    def ahead(x: ca.SX, u: ca.SX) -> Results:
        x_next = s.model.rhs(x, u)
        return {"x_next": x_next, "F": ca.jacobian(x_next, x)}

    mapped = leaf("mapped", notation(s), ahead)

    def formula(x: Term, P: Term, u: Term, u_next: Term) -> Results:  # noqa: ARG001 - it is held
        x_next, F = mapped(x, u)
        return {"x_next": x_next, "P_next": congruence(F, P, ca.DM(s.Q))}

    return half("predict", s, formula)
