"""The two halves of an extended Kalman filter for models with many states.

Straight-line code for a covariance grows with the cube of the number of states; from about a dozen
on, loops over matrices take its place. Here P is a full matrix, stored as a vector of ``nx * nx``
numbers; otherwise everything is as in `backsight.estimators.parts.gaussian`.

With F the Jacobian of a sub-step, F P F' = (P F')' F': both products run over the nonzeros of F
only, so that a model of many weakly coupled modes costs little more than its modes.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.symmetric import vech
from backsight.algebra.triangular import forward
from backsight.algebra.update import masked, measured, noise_of
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import add_product, symmetrise, transpose
from backsight.engine.loops import scan
from backsight.errors import TuningError
from backsight.estimators.base import Setting
from backsight.estimators.parts.gaussian import clip, flow, substep_inputs
from backsight.types import Array

COVARIANCES = ("transition", "discrete")
"""The covariance ODE is offered for small models only."""


def covariance(nx: int) -> ca.Function:
    """Full matrix as a vector to its lower triangle."""
    P = ca.SX.sym("P", nx * nx)
    return ca.Function("triangle", [P], [vech(ca.reshape(P, nx, nx))])


def innovation(s: Setting) -> ca.Function:
    """Innovation, 0 where not measured, and its covariance: ``(x, P, u, y, mask) -> (e, S)``."""
    nx, ny = s.model.nx, s.model.ny
    x, P, u, y, mask = _mx(s)
    sx, _, su, sy, sm = _sx(s)
    y_prior = s.model.output(sx, su)
    R = ca.densify(noise_of(ca.SX(s.R), sm))
    seen = [measured(sm) * (sy - y_prior), ca.jacobian(y_prior, sx), R]
    e, H, R_now = ca.Function("residual", [sx, su, sy, sm], seen)(x, u, y, mask)
    PHt = add_product(ca.MX.zeros(nx, ny), ca.reshape(P, nx, nx), H)
    S = add_product(R_now, transpose(PHt), H)
    M = ca.SX.sym("S", ny, ny)
    lower = ca.Function("lower_S", [M], [vech(M)])
    return ca.Function("innovation", [x, P, u, y, mask], [e, lower(S)])


def correct(s: Setting) -> ca.Function:
    """Measurement update with clipping: ``(x, P, u, y, mask) -> (x, P, flags)``.

    One decorrelated channel after the other, each in Joseph form: (I - K h) P (I - K h)' + K K' is
    two products with a vector and two outer products.
    """
    nx, ny = s.model.nx, s.model.ny
    x, P, u, y, mask = _mx(s)
    rows, residuals = _decorrelated(s)(x, u, y, mask)
    (dx, full, bad), _ = scan(
        _channel(nx),
        ny,
        carry=[ca.MX.zeros(nx), ca.reshape(P, nx, nx), ca.MX(0)],
        xs=[rows, residuals],
    )
    free, step, flag = ca.SX.sym("x", nx), ca.SX.sym("dx", nx), ca.SX.sym("bad")
    inside = clip(s, free + step)
    clipped = ca.if_else(ca.norm_1(inside - (free + step)) > 0, 1, 0)
    finish = ca.Function("moved", [free, step, flag], [inside, ca.vertcat(clipped, 0, 0, flag)])
    x_post, flags = finish(x, dx, bad)
    return ca.Function("correct", [x, P, u, y, mask], [x_post, ca.vec(symmetrise(full)), flags])


def predict(s: Setting, integrator: Integrator, way: str) -> ca.Function:
    """Time update over one sampling period: ``(x, P, u, u_next) -> (x, P)``.

    See `gaussian.predict`. With P + h/2 Q in the place of P, a sub-step of
    the trapezoidal rule is one congruence and one addition.
    """
    if way not in COVARIANCES:
        raise TuningError(
            f"covariance '{way}' is not offered for {s.model.nx} states; use 'transition'"
        )
    nx = s.model.nx
    x, P, u, u_next = (
        ca.MX.sym(n, k)
        for n, k in (("x", nx), ("P", nx * nx), ("u", s.model.nu), ("u_next", s.model.nu))
    )
    full = ca.reshape(P, nx, nx)
    if not s.model.continuous or way == "discrete":
        per_sample = s.Q * (s.dt if s.model.continuous else 1.0)
        return _predict_whole(s, integrator, [x, P, u, u_next], per_sample)
    n = integrator.substeps
    h = s.dt / n
    root = ca.MX(ca.sparsify(ca.DM(_root(h / 2 * s.Q))))
    xs, held = substep_inputs(integrator, u, u_next)
    (x_next, shifted), _ = scan(
        _substep(s, integrator, h),
        n,
        carry=[x, add_product(full, ca.densify(root), root)],
        xs=xs,
        constants=held,
    )
    P_next = symmetrise(add_product(shifted, -ca.densify(root), root))
    return ca.Function("predict", [x, P, u, u_next], [x_next, ca.vec(P_next)])


def _sizes(s: Setting) -> dict[str, int]:
    m = s.model
    return {"x": m.nx, "P": m.nx * m.nx, "u": m.nu, "y": m.ny, "mask": m.ny}


def _mx(s: Setting) -> tuple[ca.MX, ...]:
    return tuple(ca.MX.sym(name, size) for name, size in _sizes(s).items())


def _sx(s: Setting) -> tuple[ca.SX, ...]:
    return tuple(ca.SX.sym(name, size) for name, size in _sizes(s).items())


def _decorrelated(s: Setting) -> ca.Function:
    """Rows of the Jacobian as columns, and residuals, both with unit noise."""
    x, _, u, y, mask = _sx(s)
    y_prior = s.model.output(x, u)
    H, e, R = masked(ca.jacobian(y_prior, x), y - y_prior, ca.SX(ca.sparsify(ca.DM(s.R))), mask)
    L = cholesky_semidefinite(R)
    white = [forward(L, column) for column in ca.horzsplit(ca.densify(ca.horzcat(e, H)))]
    return ca.Function(
        "decorrelated",
        [x, u, y, mask],
        [ca.densify(ca.horzcat(*white[1:]).T), ca.densify(white[0].T)],
    )


def _channel(nx: int) -> ca.Function:
    """One scalar update, ``(dx, P, bad, h', r) -> (dx, P, bad)``."""
    dx, P, bad = ca.MX.sym("dx", nx), ca.MX.sym("P", nx, nx), ca.MX.sym("bad")
    row, r = ca.MX.sym("row", nx), ca.MX.sym("r")
    h, v, d = ca.SX.sym("h", nx), ca.SX.sym("v", nx), ca.SX.sym("d", nx)
    e, flag = ca.SX.sym("e"), ca.SX.sym("flag")
    S = ca.dot(h, v) + 1
    K = v / S
    negative = ca.if_else(S >= 1, flag, 1)
    gain = ca.Function("gain", [h, v, d, e, flag], [K, d + K * (e - ca.dot(h, d)), negative])
    second = ca.Function("second", [v, d], [d - v])
    Ph = add_product(ca.MX.zeros(nx, 1), P, row.T)
    K_, dx_next, bad_next = gain(row, Ph, dx, r, bad)
    left = add_product(P, -K_, Ph)
    rest = second(add_product(ca.MX.zeros(nx, 1), left, row.T), K_)
    return ca.Function(
        "channel", [dx, P, bad, row, r], [dx_next, add_product(left, rest, K_), bad_next]
    )


def _substep(s: Setting, integrator: Integrator, h: float) -> ca.Function:
    """``(x, P + h/2 Q, ua, ub) -> (x, P + h/2 Q)`` one sub-step later."""
    nx, nu = s.model.nx, s.model.nu
    sx, sa, sb = ca.SX.sym("x", nx), ca.SX.sym("ua", nu), ca.SX.sym("ub", nu)
    flowed = flow(s, integrator, sx, ua=sa, ub=sb, h=h)
    leaf = ca.Function("flow", [sx, sa, sb], [flowed, ca.jacobian(flowed, sx)])
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", nx, nx)
    ua, ub = ca.MX.sym("ua", nu), ca.MX.sym("ub", nu)
    x_next, Phi = leaf(x, ua, ub)
    return ca.Function(
        "large_substep", [x, P, ua, ub], [x_next, _congruence(P, Phi, ca.DM(h * s.Q))]
    )


def _congruence(P: ca.MX, F: ca.MX, Q: ca.DM) -> ca.MX:
    """F P F' + Q."""
    nx = P.shape[0]
    PFt = add_product(ca.MX.zeros(nx, nx), P, F)
    return add_product(ca.MX(ca.densify(Q)), transpose(PFt), F)


def _predict_whole(
    s: Setting, integrator: Integrator, symbols: list[ca.MX], Q: Array
) -> ca.Function:
    """One congruence per sample with the Jacobian of the whole period."""
    nx = s.model.nx
    x, P, u, u_next = symbols
    sx, sa, sb = (ca.SX.sym(n, k.numel()) for n, k in (("x", x), ("ua", u), ("ub", u)))
    if s.model.continuous:
        n = integrator.substeps
        flowed = flow(s, integrator, sx, ua=sa, ub=sb, h=s.dt / n)
        leaf = ca.Function("flow", [sx, sa, sb], [flowed, ca.jacobian(flowed, sx)])
        end, F = _chained(leaf, integrator, x, u, u_next)
    else:
        whole = s.model.rhs(sx, sa)
        end, F = ca.Function("map", [sx, sa], [whole, ca.jacobian(whole, sx)])(x, u)
    P_next = symmetrise(_congruence(ca.reshape(P, nx, nx), F, ca.DM(Q)))
    return ca.Function("predict", [x, P, u, u_next], [end, ca.vec(P_next)])


def _chained(
    leaf: ca.Function, integrator: Integrator, x: ca.MX, u: ca.MX, u_next: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """State and Jacobian after all sub-steps; the product runs as G' <- G' Phi'."""
    nx = x.numel()
    state, G = ca.MX.sym("x", nx), ca.MX.sym("G", nx, nx)
    ua, ub = ca.MX.sym("ua", u.numel()), ca.MX.sym("ub", u.numel())
    moved, Phi = leaf(state, ua, ub)
    body = ca.Function(
        "chained",
        [state, G, ua, ub],
        [moved, add_product(ca.MX.zeros(nx, nx), G, Phi)],
    )
    xs, held = substep_inputs(integrator, u, u_next)
    (end, Gt), _ = scan(
        body,
        integrator.substeps,
        carry=[x, ca.MX(ca.DM.eye(nx).full())],
        xs=xs,
        constants=held,
    )
    return end, transpose(Gt)


def _root(Q: Array) -> Array:
    """A with A A' = Q for positive semidefinite Q; diagonal if Q is."""
    if np.count_nonzero(Q - np.diag(np.diag(Q))) == 0:
        return np.sqrt(Q)
    values, vectors = np.linalg.eigh(Q)
    return vectors * np.sqrt(np.maximum(values, 0.0))
