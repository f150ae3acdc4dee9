"""Cost of the measurements in the window, with exact sensitivities."""

import casadi as ca
import numpy as np

from backsight.algebra.factor import solve_spd
from backsight.algebra.update import masked
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import dense
from backsight.engine.loops import scan
from backsight.estimators.base import Setting
from backsight.estimators.parts.covariance import Covariance, times_transposed
from backsight.estimators.parts.leaf import Results, Symmetric, leaf, notation
from backsight.estimators.parts.stages import noise_seen
from backsight.estimators.parts.substeps import flow, moved_state, seen_outputs, substep_inputs
from backsight.estimators.varied_number import varied_at
from backsight.models.canonical.affine import moving_states


def window_cost(s: Setting, integrator: Integrator, *, N: int, alpha: float) -> ca.Function:
    """Cost of the measurements in the window, eq. 26 and 28, with gradient and Hessian.

    ``(x, U, Y, M) -> (cost, c, G)`` for `minimise`. The sensitivities dx_i/dx_0 go along with the
    response; rows of states that are constant in the model are known and not computed.
    """
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    many = Covariance(nx).whole
    moving = list(range(nx)) if many else moving_states(s.model)
    start = np.eye(nx)[moving, :]
    x, rows = ca.MX.sym("x", nx), ca.MX.sym("S", len(moving), nx)
    size = nx * nx if many else nx * (nx + 1) // 2
    cost, c, G = ca.MX.sym("J"), ca.MX.sym("c", nx), ca.MX.sym("G", size)
    u, u_next = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    y, mask = ca.MX.sym("y", ny), ca.MX.sym("m", ny)
    accumulate = _accumulate_dense(s, alpha) if many else _accumulate(s, moving, alpha)
    vary = _variation_dense(s, integrator) if many else _variation(s, integrator, moving)
    added = accumulate(x, rows, cost, c, G, u, y, mask)
    if s.model.continuous:
        n = integrator.steps
        columns, held = substep_inputs(integrator, u, u_next)
        advanced, _ = scan(vary, n, carry=[x, rows], xs=columns, constants=held)
    else:
        advanced = vary(x, rows, u, u_next)
    sample = ca.Function("sample", [x, rows, cost, c, G, u, u_next, y, mask], [*advanced, *added])
    U, Y, M = (ca.MX.sym(k, m, N + 1) for k, m in (("U", nu), ("Y", ny), ("M", ny)))
    x0 = ca.MX.sym("x0", nx)
    end, _ = scan(
        sample,
        N,
        carry=[x0, ca.MX(start), ca.MX(0), ca.MX.zeros(nx), ca.MX.zeros(G.numel())],
        xs=[U[:, :-1], U[:, 1:], Y[:, :-1], M[:, :-1]],
    )
    total = list(accumulate(*end, U[:, N], Y[:, N], M[:, N]))[-3:]
    if many:
        total[-1] = dense.triangle(ca.reshape(total[-1], nx, nx))
    return ca.Function("window_cost", [x0, U, Y, M], total, ["x", "U", "Y", "M"], ["J", "c", "G"])


def _full(rows: ca.SX, moving: list[int], nx: int) -> ca.SX:
    full = ca.SX.eye(nx)
    full[moving, :] = rows
    return full


def _variation_dense(s: Setting, integrator: Integrator) -> ca.Function:
    """`_variation` of many states; S is transposed, and all of it."""
    nx, nu, moved = s.model.nx, s.model.nu, moved_state(s, integrator)
    x, St = ca.MX.sym("x", nx), ca.MX.sym("S", nx, nx)
    ua, ub = ca.MX.sym("ua", nu), ca.MX.sym("ub", nu)
    x_next, Phi = moved(x, ua, ub)
    return ca.Function(
        "variation_dense", [x, St, ua, ub], [x_next, ca.densify(times_transposed(St, Phi))]
    )


def _accumulate_dense(s: Setting, alpha: float) -> ca.Function:
    """`_accumulate` of many states, of which S comes transposed and G is whole."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, St = ca.MX.sym("x", nx), ca.MX.sym("S", nx, nx)
    cost, c, G = ca.MX.sym("J"), ca.MX.sym("c", nx), ca.MX.sym("G", nx * nx)
    u, y, mask = ca.MX.sym("u", nu), ca.MX.sym("y", ny), ca.MX.sym("mask", ny)
    expected, H = seen_outputs(s)(x, u)
    HS = dense.transpose(times_transposed(St, H))
    v, factor = ca.SX.sym("u", nu), dense.cholesky_of(noise_seen(s)(mask))
    rows = dense.scaled_rows(ca.horzcat(y - expected, HS), mask)
    white = dense.solve_triangular(factor, rows)
    e, W = white[:, 0], white[:, 1:]
    by = ca.Function("alpha", [v], [varied_at(alpha, v)])(u)
    results = [
        cost + by * ca.dot(e, e) / 2,
        c + by * dense.product_of(W, e, turned=(True, False)),
        G + by * ca.vec(dense.product_of(W, W, turned=(True, False))),
    ]
    return ca.Function("accumulate_dense", [x, St, cost, c, G, u, y, mask], results)


def _variation(s: Setting, integrator: Integrator, moving: list[int]) -> ca.Function:
    """One sub-step of the state and of the moving rows of its sensitivities."""
    nx, continuous = s.model.nx, s.model.continuous
    h = s.dt / integrator.steps if continuous else 1.0

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
        weighted = varied_at(alpha, u) * solve_spd(R, ca.horzcat(e, HS))
        return {
            "cost": cost + ca.dot(e, weighted[:, 0]) / 2,
            "c": c + HS.T @ weighted[:, 0],
            "G": G + HS.T @ weighted[:, 1:],
        }

    sizes = {"rows": (len(moving), nx), "cost": 1, "c": nx, "G": Symmetric(nx)}
    return leaf("accumulate", {**notation(s), **sizes}, formula)
