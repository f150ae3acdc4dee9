"""Moving horizon observer: nonlinear least squares over a window, between two Kalman filters."""

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite, solve_spd
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.update import masked, measured
from backsight.description import Horizon, NonNegative
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator, Setting, setting
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, packed, physical
from backsight.estimators.parts.gaussian import (
    FLAGS,
    Covariance,
    correct,
    flow,
    innovation,
    predict,
    substep_inputs,
)
from backsight.estimators.parts.window import advance, as_columns, empty_window
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.affine import moving_states
from backsight.models.model import Model
from backsight.solvers.box import GaussNewton, QuasiNewton


@dataclasses.dataclass(frozen=True)
class MHO(AbstractEstimator):
    r"""Moving horizon observer.

    Every sample t it estimates the state at the start of the window t - N ... t:

    1. pre-filter: an EKF step at t - N gives :math:`\bar x` and P (eq. 29-31);
    2. optimiser: with exact sensitivities and the bounds of the model it minimises

       .. math:: J(x) = (x - \bar x)' P^{-1} (x - \bar x)
          + \alpha \sum_{i=0}^{N} e_i' R^{-1} e_i, \qquad e_i = y_{t-N+i} - h(x_i, u_{t-N+i}),

       where :math:`x_i` is the model's response from x without process noise (eq. 26-28);
    3. post-filter: an EKF runs from there through the window to the present (eq. 32).

    For one output J is the cost of eq. 26 with S = R P^-1 (eq. 43), divided by R: with alpha = 1
    prior and measurements have their statistical weights, with alpha = 0 the result is exactly the
    extended Kalman filter. Until the window is full it is the extended Kalman filter, too; the
    window begins at the first sample in which anything was measured.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    alpha : float
        Weight of the measurements in the window.
    integrator : Integrator
    covariance : {"transition", "ode", "discrete"}
        See `EKF`.
    optimiser : GaussNewton
        When the iterations end.

    Notes
    -----
    The covariance P of the estimate is the one of the filters, as in the paper: it counts every
    measurement once. ``x_start`` and ``P_start`` are the optimiser's estimate at the start of the
    window and its covariance, active bounds included.

    References
    ----------
    Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics with
    plant uncertainties in nanopositioning system estimation", ACC 2012, section IV.
    """

    key: ClassVar[str] = "mho"
    title: ClassVar[str] = "Moving horizon observer"
    weighs: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    N: Horizon = 15
    alpha: NonNegative = 1.0
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: Covariance = "transition"
    optimiser: GaussNewton | QuasiNewton = dataclasses.field(default_factory=GaussNewton)

    def compile(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.compile`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior)
        nx, N = s.model.nx, self.N
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        memory = {
            "x_start": s.x0,
            "P_start": packed(s.P0),
            "x_last": s.x0,
            "P_last": packed(s.P0),
            **empty_window(s, N + 1),
            "present": np.zeros(N + 1),
            "called": np.zeros(1),
        }
        symbol, (x_start, P_start, x_last, P_last, *windows, called) = carry_inputs(
            list(memory.values())
        )
        U, Y, M, present = as_columns(windows, N + 1)
        began = present[N]
        here = _begins(s.model.ny)(began, mask)
        U, Y, M, present = advance((U, Y, M, present), (u, y, mask, here))
        full = present[0]

        time_update = predict(s, self.integrator, self.covariance)
        update = correct(s, check=self.covariance == "ode")
        prior = choose(called, time_update.call([x_last, P_last, U[:, N - 1], u]), [x_last, P_last])
        x_start, P_start = choose(began, [x_start, P_start], prior)
        e, S = innovation(s)(*prior, u, y, mask)

        x_bar, P_bar, flags = update(x_start, P_start, U[:, 0], Y[:, 0], full * M[:, 0])
        cost = window_cost(s, self.integrator, N=N, alpha=self.alpha)
        x, Sigma, iterations, limit, rejected = self.optimiser.minimiser(
            cost,
            lower=s.lower,
            upper=s.upper,
            cost_unit=float(np.mean(np.diag(s.R))),
        )(full, x_bar, _factor(nx)(P_bar), U, Y, M)

        post, _ = scan(
            _post_filter(s, time_update, update),
            N,
            carry=[x, P_bar, flags],
            xs=[U[:, :-1], U[:, 1:], Y[:, 1:], M[:, 1:], present[:, :-1], present[:, 1:]],
        )
        x_now, P_now, flags = post
        flags = ca.vertcat(flags[0], limit, rejected, flags[3])
        ahead = time_update.call([x, P_bar, U[:, 0], U[:, 1]])
        x_start, P_start = choose(full, ahead, [x_start, P_start])
        carry = [x_start, P_start, x_now, P_now, *(ca.vec(w) for w in (U, Y, M, present)), 1]
        start = _physical_start(s)(x, Sigma)
        outputs = [*physical(s)(x_now, P_now, u, e, S, flags), iterations, *start]
        return Recursion(
            step=ca.Function(self.key, [symbol, *data], [ca.vertcat(*carry), *outputs]),
            carry0=np.concatenate(list(memory.values())),
            channels=CHANNELS,
            dt=dt,
        )


CHANNELS = (
    *ESTIMATE_CHANNELS,
    Channel("iterations"),
    Channel("x_start", ("state",)),
    Channel("P_start", ("state", "state_"), symmetric=True),
)
"""Beside the estimate: iterations of the optimiser, and its result at the start of the window."""


def _begins(ny: int) -> ca.Function:
    """1 from the first sample in which anything was measured."""
    started, mask = ca.SX.sym("started"), ca.SX.sym("mask", ny)
    return ca.Function("begins", [started, mask], [ca.fmax(started, ca.mmax(measured(mask)))])


def _factor(nx: int) -> ca.Function:
    vP = ca.SX.sym("P", nx * (nx + 1) // 2)
    return ca.Function("factor", [vP], [ca.densify(cholesky_semidefinite(unvech(vP)))])


def _post_filter(s: Setting, predict: ca.Function, correct: ca.Function) -> ca.Function:
    """Step i of the post-filter, eq. 32; samples before the start of the data change nothing."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, P, flags = (
        ca.MX.sym("x", nx),
        ca.MX.sym("P", nx * (nx + 1) // 2),
        ca.MX.sym("flags", len(FLAGS)),
    )
    u_last, u = ca.MX.sym("u_last", nu), ca.MX.sym("u", nu)
    y, mask = ca.MX.sym("y", ny), ca.MX.sym("mask", ny)
    before, here = ca.MX.sym("before"), ca.MX.sym("here")
    prior = choose(before, predict.call([x, P, u_last, u]), [x, P])
    x_post, P_post, raised = correct(*prior, u, y, here * mask)
    a, b = ca.SX.sym("a", len(FLAGS)), ca.SX.sym("b", len(FLAGS))
    # Clipping is reported of the present sample only, a covariance that fails of the whole window.
    together = ca.vertcat(b[:-1], ca.fmax(a[-1], b[-1]))
    merge = ca.Function("merge_flags", [a, b], [together])
    return ca.Function(
        "post_filter",
        [x, P, flags, u_last, u, y, mask, before, here],
        [x_post, P_post, merge(flags, raised)],
    )


def window_cost(s: Setting, integrator: Integrator, *, N: int, alpha: float) -> ca.Function:
    """Cost of the measurements in the window, eq. 26 and 28, with gradient and Hessian.

    ``(x, U, Y, M) -> (cost, c, G)`` for `minimise`. The sensitivities dx_i/dx_0 go along with the
    response; rows of states that are constant in the model are known and not computed.
    """
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    moving = moving_states(s.model)
    start = np.eye(nx)[moving, :]
    x, rows = ca.MX.sym("x", nx), ca.MX.sym("S", len(moving), nx)
    cost, c, G = ca.MX.sym("J"), ca.MX.sym("c", nx), ca.MX.sym("G", nx * (nx + 1) // 2)
    u, u_next = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    y, mask = ca.MX.sym("y", ny), ca.MX.sym("m", ny)
    accumulate = _accumulate(s, moving, alpha)
    added = accumulate(x, rows, cost, c, G, u, y, mask)
    if s.model.continuous:
        n = integrator.substeps
        columns, held = substep_inputs(integrator, u, u_next)
        leaf = _variation(s, integrator, moving, s.dt / n)
        advanced, _ = scan(leaf, n, carry=[x, rows], xs=columns, constants=held)
    else:
        advanced = _variation(s, integrator, moving, 1.0)(x, rows, u, u_next)
    sample = ca.Function("sample", [x, rows, cost, c, G, u, u_next, y, mask], [*advanced, *added])
    U, Y, M = (ca.MX.sym(k, m, N + 1) for k, m in (("U", nu), ("Y", ny), ("M", ny)))
    x0 = ca.MX.sym("x0", nx)
    end, _ = scan(
        sample,
        N,
        carry=[x0, ca.MX(start), ca.MX(0), ca.MX.zeros(nx), ca.MX.zeros(G.numel())],
        xs=[U[:, :-1], U[:, 1:], Y[:, :-1], M[:, :-1]],
    )
    total = accumulate(*end, U[:, N], Y[:, N], M[:, N])
    return ca.Function(
        "window_cost", [x0, U, Y, M], list(total), ["x", "U", "Y", "M"], ["J", "c", "G"]
    )


def _full(rows: ca.SX, moving: list[int], nx: int) -> ca.SX:
    full = ca.SX.eye(nx)
    full[moving, :] = rows
    return full


def _variation(s: Setting, integrator: Integrator, moving: list[int], h: float) -> ca.Function:
    """One sub-step of the state and of the moving rows of its sensitivities."""
    nx, nu = s.model.nx, s.model.nu
    x, rows = ca.SX.sym("x", nx), ca.SX.sym("S", len(moving), nx)
    ua, ub = ca.SX.sym("ua", nu), ca.SX.sym("ub", nu)
    x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h) if s.model.continuous else s.model.rhs(x, ua)
    Phi = ca.jacobian(x_next, x)[moving, :]
    return ca.Function(
        "variation", [x, rows, ua, ub], [x_next, ca.densify(Phi @ _full(rows, moving, nx))]
    )


def _accumulate(s: Setting, moving: list[int], alpha: float) -> ca.Function:
    """Add one sample's residual to cost, minus gradient and Hessian."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, rows = ca.SX.sym("x", nx), ca.SX.sym("S", len(moving), nx)
    cost, c, G = ca.SX.sym("J"), ca.SX.sym("c", nx), ca.SX.sym("G", nx * (nx + 1) // 2)
    u, y, mask = ca.SX.sym("u", nu), ca.SX.sym("y", ny), ca.SX.sym("m", ny)
    y_model = s.model.output(x, u)
    H, e, R = masked(ca.jacobian(y_model, x), y - y_model, ca.SX(s.R), mask)
    HS = H @ _full(rows, moving, nx)
    weighted = alpha * solve_spd(R, ca.horzcat(e, HS))
    return ca.Function(
        "accumulate",
        [x, rows, cost, c, G, u, y, mask],
        [
            cost + ca.dot(e, weighted[:, 0]) / 2,
            c + HS.T @ weighted[:, 0],
            G + vech(HS.T @ weighted[:, 1:]),
        ],
    )


def _physical_start(s: Setting) -> ca.Function:
    x, vP = ca.SX.sym("x", s.model.nx), ca.SX.sym("P", s.model.nx * (s.model.nx + 1) // 2)
    return ca.Function("physical_start", [x, vP], list(s.physical(x, vP)))
