"""From sample to sample: state and covariance of the extended Kalman filter."""

from collections.abc import Callable
from typing import Literal, TypeAlias, get_args

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.noise import discretise_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.errors import TuningError
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    plus_known,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.substeps import flow, moved_state, substep_inputs
from backsight.estimators.scaled import Setting
from backsight.estimators.varied_noise import noise_at
from backsight.models.lti import state_equation
from backsight.types import Array

Propagation: TypeAlias = Literal["transition", "ode", "discrete"]
"""Ways to carry a covariance over a sampling period, see `predict`."""

COVARIANCES: tuple[Propagation, ...] = get_args(Propagation)
"""How the covariance goes from sample to sample, see `predict`."""


def predict(s: Setting, integrator: Integrator, covariance: Propagation) -> ca.Function:
    r"""Time update over one sampling period, eq. 13-16: ``(x, P, u, u_next) -> (x, P)``.

    ``transition``
        After every sub-step of length h, with the exact Jacobian :math:`\Phi` of the sub-step,
        :math:`P \leftarrow \Phi P \Phi' + \tfrac h2 (Q_c + \Phi Q_c \Phi')`: second-order accurate
        (the trapezoidal rule on Van Loan's integral) and positive semidefinite for every h. With
        the matrix exponential the integral itself.
    ``ode``
        Eq. 14-16: :math:`\dot P = Z P + P Z' + Q_c` by the integrator's own method, with Z taken
        at the estimate at the start of the period. Can lose positive definiteness; for few states.
    ``discrete``
        :math:`P \leftarrow F P F' + Q_d` with the Jacobian F of the whole period and Van Loan's
        integral at the prior's mean, see `Setting.sampled`. The only choice for discrete-time
        models.

    The covariance Q per sample is added at the end of the period.
    """
    kept = Covariance(s.model.nx)
    if kept.whole and covariance == "ode":
        raise TuningError(
            f"covariance 'ode' is not offered for {s.model.nx} states; use 'transition'"
        )
    if not s.model.continuous:
        return _mapped(s)
    nx, nu, n = s.model.nx, s.model.nu, integrator.steps
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", kept.size)
    u, u_next = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    xs, held = substep_inputs(integrator, u, u_next)
    if covariance == "discrete" and integrator.scheme != "exact":
        start = [x, ca.MX(ca.DM.eye(nx).full())]
        final, _ = scan(sensitivity(s, integrator), n, carry=start, xs=xs, constants=held)
        ends = [final[0], _carried(s)(final[1], P, u)]
    else:
        by_ode = covariance == "ode" and integrator.scheme != "exact"
        step = _ode(s, integrator) if by_ode else transition(s, integrator)
        ends, _ = scan(step, n, carry=[x, P], xs=xs, constants=[*held, *([x] if by_ode else [])])
        if walks(s):
            walk = half("walk", s, lambda P, u: {"P_next": P + per_sample(s, u)})
            ends = [ends[0], walk(ends[1], u)]
    return ca.Function("predict", [x, P, u, u_next], ends)


def walks(s: Setting) -> bool:
    """Whether any process noise is added per sample."""
    return bool(s.Q.any() or any(part.Q.any() for part in s.parts))


def per_sample(s: Setting, u: Term) -> Term:
    """Covariance of the process noise per sample at inputs u."""
    return noise_at(s.Q, [(part.index, part.Q) for part in s.parts], u)


def moved_by(s: Setting, integrator: Integrator) -> ca.Function:
    """State one sub-step later, eq. 13, and its Jacobian: ``(x, ua, ub) -> (x, Phi)``."""
    if Covariance(s.model.nx).whole:
        return moved_state(s, integrator)

    def formula(x: ca.SX, ua: ca.SX, ub: ca.SX) -> Results:
        if not s.model.continuous:
            x_next = s.model.rhs(x, ua)
            return {"x_next": x_next, "Phi": ca.jacobian(x_next, x)}
        h = s.dt / integrator.steps
        x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
        return {"x_next": x_next, "Phi": ca.jacobian(x_next, x)}

    return leaf("moved", notation(s), formula)


def substep_noise(s: Setting, integrator: Integrator) -> tuple[Array, Array]:
    """Covariances that the density adds before and after the transition of a sub-step.

    By the trapezoidal rule, or, with the matrix exponential, all of Van Loan's integral after it.
    """
    return _added(s, integrator, s.Qc)


def _added(s: Setting, integrator: Integrator, Qc: Array) -> tuple[Array, Array]:
    """See `substep_noise`; linear in the density."""
    if not s.model.continuous:
        return 0 * Qc, 0 * Qc
    h = s.dt / integrator.steps
    found = state_equation(s.model) if integrator.scheme == "exact" else None
    if found is None:
        return h / 2 * Qc, h / 2 * Qc
    return 0 * Qc, discretise_noise(found[0], Qc, dt=h)[1]


def noise_between(
    s: Setting, integrator: Integrator
) -> Callable[[Term], tuple[ca.DM | Term, ca.DM | Term]]:
    """The covariances of `substep_noise` at inputs."""
    before, after = substep_noise(s, integrator)
    added = [(part.index, *_added(s, integrator, part.Qc)) for part in s.parts]
    firsts = [(index, first) for index, first, _ in added]
    lasts = [(index, last) for index, _, last in added]
    return lambda u: (noise_at(before, firsts, u), noise_at(after, lasts, u))


def transition(s: Setting, integrator: Integrator) -> ca.Function:
    """One sub-step, see `predict`: ``(x, P, ua, ub) -> (x, P)``."""
    moved, noise = moved_by(s, integrator), noise_between(s, integrator)

    def formula(x: Term, P: Term, ua: Term, ub: Term) -> Results:
        x_next, Phi = moved(x, ua, ub)
        first, last = noise(ua)
        start = plus_known(P, first) if integrator.scheme != "exact" else P
        return {"x_next": x_next, "P_next": congruence(Phi, start, last)}

    return half("transition", s, formula)


def _ode(s: Setting, integrator: Integrator) -> ca.Function:
    """One sub-step of eq. 14, see `predict`: ``(x, P, ua, ub, frozen) -> (x, P)``."""
    h = s.dt / integrator.steps

    def formula(x: ca.SX, P: ca.SX, ua: ca.SX, ub: ca.SX, frozen: ca.SX) -> Results:
        x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
        Z = ca.substitute(ca.jacobian(s.model.rhs(x, ua), x), x, frozen)

        def rhs(v: ca.SX, _: ca.SX) -> ca.SX:
            ZP = Z @ unvech(v)
            return vech(ZP + ZP.T + noise_at(s.Qc, [(p.index, p.Qc) for p in s.parts], ua))

        v_next = integrator.substep(rhs, vech(P), ua=ua, ub=ub, h=h)
        return {"x_next": x_next, "P_next": unvech(v_next)}

    return leaf("ode", {**notation(s), "frozen": s.model.nx}, formula)


def sensitivity(s: Setting, integrator: Integrator) -> ca.Function:
    """One sub-step of the state and of F', see `predict`: ``(x, F', ua, ub) -> (x, F')``."""
    moved, nx = moved_by(s, integrator), s.model.nx

    def formula(x: Term, Ft: Term, ua: Term, ub: Term) -> Results:
        x_next, Phi = moved(x, ua, ub)
        return {"x_next": x_next, "Ft_next": ca.densify(times_transposed(Ft, Phi))}

    return half("sensitivity", s, formula, {"Ft": (nx, nx)})


def _carried(s: Setting) -> ca.Function:
    """``(F', P, u) -> F P F' + Q``, Q per sample."""
    nx, sampled = s.model.nx, s.sampled()
    return half(
        "carried",
        s,
        lambda Ft, P, u: {"P_next": congruence(transposed(Ft), P, per_sample(sampled, u))},
        {"Ft": (nx, nx)},
    )


def _mapped(s: Setting) -> ca.Function:
    """Time update of a discrete-time model, see `predict`."""
    mapped = moved_by(s, s.integrator)

    def formula(x: Term, P: Term, u: Term, u_next: Term) -> Results:
        x_next, F = mapped(x, u, u_next)
        return {"x_next": x_next, "P_next": congruence(F, P, per_sample(s, u))}

    return half("predict", s, formula)
