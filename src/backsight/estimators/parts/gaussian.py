"""The two halves of an extended Kalman filter, as functions that estimators put together.

Numbers are the equations of Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer
for vibration dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012.
"""

from collections.abc import Callable
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np

from backsight.algebra import bounds
from backsight.algebra.factor import smallest_pivot
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.update import gain, joseph, masked, measured, noise_of
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.estimators.base import Setting
from backsight.schema import Status

FLAGS = (
    Status.CLIPPED,
    Status.ITERATION_LIMIT,
    Status.STEP_REJECTED,
    Status.NOT_POSITIVE_DEFINITE,
)
"""Meaning of the flags (each 0 or 1) that functions of estimators hand on."""

Covariance: TypeAlias = Literal["transition", "ode", "discrete"]
"""Ways to carry a covariance over a sampling period, see `predict`."""

COVARIANCES: tuple[Covariance, ...] = get_args(Covariance)
"""How the covariance goes from sample to sample, see `predict`."""


def innovation(s: Setting) -> ca.Function:
    """Innovation, 0 where not measured, and its covariance: ``(x, P, u, y, mask) -> (e, S)``."""
    x, vP, u, y, mask = _update_symbols(s)
    y_prior = s.model.output(x, u)
    H = ca.jacobian(y_prior, x)
    S = H @ unvech(vP) @ H.T + noise_of(ca.SX(s.R), mask)
    e = measured(mask) * (y - y_prior)
    return ca.Function("innovation", [x, vP, u, y, mask], [e, vech(S)])


def correct(s: Setting, *, check: bool = False) -> ca.Function:
    r"""Measurement update with clipping, eq. 17-21: ``(x, P, u, y, mask) -> (x, P, flags)``.

    P is stored as its lower triangle. Only measured rows are used. States outside their bounds are
    set to them and P stays as it is (section VI.C). The flags are those of `FLAGS`. With `check`
    the pivots of P are looked at, where the time update does not keep P positive by itself.
    """
    x, vP, u, y, mask = _update_symbols(s)
    x_post, P_post, flags = updated(s, x, unvech(vP), u, y, mask, ca.SX(s.R))
    if check:
        indefinite = smallest_pivot(unvech(vP)) < -1e-10
        flags[FLAGS.index(Status.NOT_POSITIVE_DEFINITE)] += ca.if_else(indefinite, 1, 0)
        flags = ca.fmin(flags, 1)
    return ca.Function("correct", [x, vP, u, y, mask], [x_post, vech(P_post), flags])


def updated(
    s: Setting, x: ca.SX, P: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX, R: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """State, covariance and flags after a measurement with covariance R (ny, ny), see `correct`."""
    y_prior = s.model.output(x, u)
    H, e, R = masked(ca.jacobian(y_prior, x), y - y_prior, R, mask)
    K, S = gain(P, H, R)
    free = x + K @ e
    P_post = joseph(P, K, H, R)
    x_post = clip(s, free)
    clipped = ca.if_else(ca.norm_1(x_post - free) > 0, 1, 0)
    definite = ca.mmin(ca.vertcat(ca.diag(P_post), ca.diag(S))) >= 0
    return x_post, P_post, ca.vertcat(clipped, 0, 0, ca.if_else(definite, 0, 1))


def _update_symbols(s: Setting) -> tuple[ca.SX, ...]:
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    sizes = {"x": nx, "P": nx * (nx + 1) // 2, "u": nu, "y": ny, "mask": ny}
    return tuple(ca.SX.sym(name, size) for name, size in sizes.items())


def clip(s: Setting, x: ca.SX) -> ca.SX:
    """Set states outside their bounds to the bounds."""
    return bounds.clip(x, s.lower, s.upper)


def predict(s: Setting, integrator: Integrator, covariance: Covariance) -> ca.Function:
    r"""Time update over one sampling period: ``(x, P, u, u_next) -> (x, P)``.

    ``transition``
        After every sub-step of length h, with the exact Jacobian :math:`\Phi` of the sub-step,
        :math:`P \leftarrow \Phi P \Phi' + \tfrac h2 (Q + \Phi Q \Phi')`: second-order accurate
        (the trapezoidal rule on Van Loan's integral) and positive semidefinite for every h.
    ``ode``
        Eq. 14-16: :math:`\dot P = Z P + P Z' + Q` by the integrator's own method, with Z taken at
        the estimate at the start of the period. Can lose positive definiteness.
    ``discrete``
        :math:`P \leftarrow F P F' + Q_d` with the Jacobian F of the whole period and
        :math:`Q_d = Q\,\Delta t`. The only choice for discrete-time models.
    """
    nx, nu = s.model.nx, s.model.nu
    x, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    u, u_next = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    if not s.model.continuous:
        return _predict_discrete(s)
    h = s.dt / integrator.substeps
    leaf = {"transition": transition, "ode": _ode, "discrete": _sensitivity}[covariance](
        s, integrator, h
    )
    carry = [x, vP]
    constants = []
    if covariance == "ode":
        constants = [x]
    if covariance == "discrete":
        carry = [x, ca.MX.eye(nx)]
    inputs, held = substep_inputs(integrator, u, u_next)
    final, _ = scan(
        leaf, integrator.substeps, carry=carry, xs=inputs, constants=[*held, *constants]
    )
    if covariance == "discrete":
        final = [final[0], _congruence(nx, s.Q * s.dt)(final[1], vP)]
    return ca.Function("predict", [x, vP, u, u_next], final)


def flow(s: Setting, integrator: Integrator, x: ca.SX, *, ua: ca.SX, ub: ca.SX, h: float) -> ca.SX:
    """One sub-step of the state, eq. 33-34 for Heun's method."""
    return integrator.substep(s.model.rhs, x, ua=ua, ub=ub, h=h)


def substep_inputs(
    integrator: Integrator, u: ca.MX, u_next: ca.MX
) -> tuple[list[ca.MX], list[ca.MX]]:
    """Inputs at both ends of the sub-steps: as columns (ramp), or once for all (held)."""
    if integrator.hold == "zoh":
        return [], [u, u]
    return ramp(integrator.substeps, u, u_next), []


def ramp(n: int, a: ca.MX, b: ca.MX) -> list[ca.MX]:
    """Values at the beginning and at the end of n sub-steps from a to b, side by side."""
    first, last = ca.SX.sym("a", a.numel()), ca.SX.sym("b", b.numel())
    grid = [first + (k / n) * (last - first) for k in range(n + 1)]
    name = f"ramp_{n}_of_{a.numel()}"
    columns = [ca.horzcat(*grid[:-1]), ca.horzcat(*grid[1:])]
    return list(ca.Function(name, [first, last], columns)(a, b))


Leaf = Callable[[Setting, Integrator, float], ca.Function]


def _symbols(s: Setting) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    nx, nu = s.model.nx, s.model.nu
    return (
        ca.SX.sym("x", nx),
        ca.SX.sym("P", nx * (nx + 1) // 2),
        ca.SX.sym("ua", nu),
        ca.SX.sym("ub", nu),
    )


def transition(s: Setting, integrator: Integrator, h: float) -> ca.Function:
    """One sub-step of length h, see `predict`: ``(x, P, ua, ub) -> (x, P)``."""
    x, vP, ua, ub = _symbols(s)
    x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
    Phi = ca.jacobian(x_next, x)
    half = ca.SX(ca.sparsify(ca.DM(h / 2 * s.Q)))
    P_next = Phi @ (unvech(vP) + half) @ Phi.T + half
    return ca.Function("transition", [x, vP, ua, ub], [x_next, vech(P_next)])


def _ode(s: Setting, integrator: Integrator, h: float) -> ca.Function:
    x, vP, ua, ub = _symbols(s)
    frozen = ca.SX.sym("frozen", s.model.nx)
    x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
    Z = ca.substitute(ca.jacobian(s.model.rhs(x, ua), x), x, frozen)

    def rhs(v: ca.SX, _: ca.SX) -> ca.SX:
        ZP = Z @ unvech(v)
        return vech(ZP + ZP.T + s.Q)

    v_next = integrator.substep(rhs, vP, ua=ua, ub=ub, h=h)
    return ca.Function("ode", [x, vP, ua, ub, frozen], [x_next, v_next])


def _sensitivity(s: Setting, integrator: Integrator, h: float) -> ca.Function:
    x, _, ua, ub = _symbols(s)
    F = ca.SX.sym("F", s.model.nx, s.model.nx)
    x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
    return ca.Function("sensitivity", [x, F, ua, ub], [x_next, ca.jacobian(x_next, x) @ F])


def _congruence(nx: int, Q: np.ndarray) -> ca.Function:
    F, vP = ca.SX.sym("F", nx, nx), ca.SX.sym("P", nx * (nx + 1) // 2)
    return ca.Function("congruence", [F, vP], [vech(F @ unvech(vP) @ F.T + Q)])


def _predict_discrete(s: Setting) -> ca.Function:
    x, vP, u, u_next = _symbols(s)
    x_next = s.model.rhs(x, u)
    F = ca.jacobian(x_next, x)
    P_next = F @ unvech(vP) @ F.T + s.Q
    return ca.Function("predict", [x, vP, u, u_next], [x_next, vech(P_next)])
