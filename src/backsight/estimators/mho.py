"""Moving horizon observer: nonlinear least squares over a window, between two Kalman filters."""

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.algebra.factor import solve_spd
from backsight.algebra.update import masked
from backsight.description import Horizon, NonNegative
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator, Setting, setting
from backsight.estimators.kalman.ekf import Propagation, correct, innovation, predict
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.factors import cholesky
from backsight.estimators.parts.filtering import choose, data_inputs, physical
from backsight.estimators.parts.flags import FLAGS, Flags
from backsight.estimators.parts.leaf import Results, Symmetric, half, leaf, notation
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import flow, substep_inputs
from backsight.estimators.parts.window import moved_on, no_window
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
    noise_states: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    N: Horizon = 15
    alpha: NonNegative = 1.0
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: Propagation = "transition"
    optimiser: GaussNewton | QuasiNewton = dataclasses.field(default_factory=GaussNewton)

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s, N = setting(model, dt, noise=self.noise, prior=self.prior), self.N
        kept = Covariance(s.model.nx)
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        m = Memory(
            x_start=s.x0,
            P_start=kept.kept(s.P0),
            x_last=s.x0,
            P_last=kept.kept(s.P0),
            **no_window(s, N + 1),
            present=np.zeros((1, N + 1)),
            called=0,
        )
        time_update = predict(s, self.integrator, self.covariance)
        update = correct(s, check=self.covariance == "ode")

        # The new sample enters the window, which begins at the first measurement.
        here = _begins(s)(m.present[N], mask)
        U, Y, M, present = moved_on((m.U, m.Y, m.M, m.present), (u, y, mask, here))
        full = present[0]
        last = [m.x_last, m.P_last]
        prior = choose(m.called, time_update.call([*last, U[:, N - 1], u]), last)
        x_start, P_start = choose(m.present[N], [m.x_start, m.P_start], prior)
        e, S = innovation(s)(*prior, u, y, mask)

        # 1. pre-filter, eq. 29-31
        x_bar, P_bar, flags = update(x_start, P_start, U[:, 0], Y[:, 0], full * M[:, 0])

        # 2. optimiser, eq. 26-28
        cost = window_cost(s, self.integrator, N=N, alpha=self.alpha)
        minimise = self.optimiser.minimiser(
            cost, lower=s.lower, upper=s.upper, cost_unit=float(np.mean(np.diag(s.R)))
        )
        found = minimise(full, x_bar, _factor(s)(P_bar), U, Y, M)
        x, Sigma, iterations, limit, rejected = found

        # 3. post-filter, eq. 32
        (x_now, P_now, flags), _ = scan(
            _post_filter(s, time_update, update),
            N,
            carry=[x, P_bar, flags],
            xs=[U[:, :-1], U[:, 1:], Y[:, 1:], M[:, 1:], present[:, :-1], present[:, 1:]],
        )
        raised = dataclasses.replace(Flags.of(flags), iteration_limit=limit, step_rejected=rejected)

        # 4. start of the next window, eq. 29
        ahead = time_update.call([x, P_bar, U[:, 0], U[:, 1]])
        x_start, P_start = choose(full, ahead, [x_start, P_start])
        estimate = physical(
            s, x=x_now, P=kept.triangle()(P_now), u=u, e=e, S=S, flags=raised.vector()
        )
        x_window, P_window = _physical_start(s)(x, Sigma)
        return m.recursion(
            self.key,
            data,
            next={
                "x_start": x_start,
                "P_start": P_start,
                "x_last": x_now,
                "P_last": P_now,
                "U": U,
                "Y": Y,
                "M": M,
                "present": present,
                "called": 1,
            },
            outputs=estimate | {"iterations": iterations, "x_start": x_window, "P_start": P_window},
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


def _begins(s: Setting) -> ca.Function:
    """1 from the first sample in which anything was measured."""
    sizes = {**notation(s), "began": 1}
    return leaf("begins", sizes, lambda began, mask: {"here": ca.fmax(began, ca.mmax(mask > 0))})


def _factor(s: Setting) -> ca.Function:
    """Lower factor of a covariance."""
    return half("factor", s, lambda P: {"L": ca.densify(cholesky(P))})


def _post_filter(s: Setting, predict: ca.Function, correct: ca.Function) -> ca.Function:
    """Step i of the post-filter, eq. 32; samples before the start of the data change nothing."""
    m = s.model
    sizes = {
        "x": m.nx, "P": Covariance(m.nx).size, "flags": FLAGS, "u_last": m.nu, "u": m.nu,
        "y": m.ny, "mask": m.ny, "before": 1, "here": 1,
    }  # fmt: skip
    k = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    predicted = predict.call([k["x"], k["P"], k["u_last"], k["u"]])
    prior = choose(k["before"], predicted, [k["x"], k["P"]])
    x_post, P_post, raised = correct(*prior, k["u"], k["y"], k["here"] * k["mask"])
    flags = _merged()(k["flags"], raised)
    return ca.Function("post_filter", list(k.values()), [x_post, P_post, flags])


def _merged() -> ca.Function:
    """Flags of the window so far and of its next sample.

    Clipping is reported of the present sample only, a covariance that fails of the whole window.
    """
    so_far, now = ca.SX.sym("so_far", FLAGS), ca.SX.sym("now", FLAGS)
    a, b = Flags.of(so_far), Flags.of(now)
    failed = ca.fmax(a.not_positive_definite, b.not_positive_definite)
    merged = dataclasses.replace(b, not_positive_definite=failed)
    return ca.Function("merge_flags", [so_far, now], [merged.vector()])


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
        step = _variation(s, integrator, moving, s.dt / n)
        advanced, _ = scan(step, n, carry=[x, rows], xs=columns, constants=held)
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
    nx, continuous = s.model.nx, s.model.continuous

    def formula(x: ca.SX, rows: ca.SX, ua: ca.SX, ub: ca.SX) -> Results:
        ahead = flow(s, integrator, x, ua=ua, ub=ub, h=h) if continuous else s.model.rhs(x, ua)
        Phi = ca.jacobian(ahead, x)[moving, :]
        return {"x_next": ahead, "rows_next": ca.densify(Phi @ _full(rows, moving, nx))}

    return leaf("variation", {**notation(s), "rows": (len(moving), nx)}, formula)


def _accumulate(s: Setting, moving: list[int], alpha: float) -> ca.Function:
    """Add one sample's residual to cost, minus gradient and Hessian, eq. 26."""
    nx = s.model.nx

    def formula(
        x: ca.SX, rows: ca.SX, cost: ca.SX, c: ca.SX, G: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX
    ) -> Results:
        y_model = s.model.output(x, u)
        H, e, R = masked(ca.jacobian(y_model, x), y - y_model, ca.SX(s.R), mask)
        HS = H @ _full(rows, moving, nx)
        weighted = alpha * solve_spd(R, ca.horzcat(e, HS))
        return {
            "cost": cost + ca.dot(e, weighted[:, 0]) / 2,
            "c": c + HS.T @ weighted[:, 0],
            "G": G + HS.T @ weighted[:, 1:],
        }

    sizes = {"rows": (len(moving), nx), "cost": 1, "c": nx, "G": Symmetric(nx)}
    return leaf("accumulate", {**notation(s), **sizes}, formula)


def _physical_start(s: Setting) -> ca.Function:
    """State and covariance at the start of the window in physical units."""
    scales = ca.SX(np.outer(s.sx, s.sx))
    return leaf("physical_start", notation(s), lambda x, P: {"x": ca.SX(s.sx) * x, "P": P * scales})
