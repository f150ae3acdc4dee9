"""The moving horizon problem as a general-purpose optimiser solves it: BFGS from the identity."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.factor import solve_spd
from backsight.algebra.symmetric import unvech, vech
from backsight.description import Count, Description, NonNegative
from backsight.engine.loops import iterate
from backsight.solvers.box._box import dual_active_set
from backsight.solvers.box.gauss_newton import finish, trial
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class QuasiNewton(Description):
    r"""Sequential quadratic programming with a BFGS matrix that starts from the identity.

    What general-purpose routines do that know the cost and its gradient only, and what
    Polóni et al. (2012), section VI.D, used. Kept to show what that does to the estimates: with
    the tolerances given there it ends long before the minimum. `GaussNewton` is the method to use.

    Parameters
    ----------
    max_iterations : int
        Largest number of evaluations.
    cost_tolerance, step_tolerance : float
        The iterations end when :math:`|J_i - J_{i+1}| < \delta_J (1 + |J_i|)` or
        :math:`\|x_i - x_{i+1}\| < \delta_x (1 + \|x_i\|)`, with J and x scaled as there.

    Examples
    --------
    >>> bs.settings.QuasiNewton(max_iterations=50).max_iterations
    50
    """

    max_iterations: Count = 100
    cost_tolerance: NonNegative = 2e-5
    step_tolerance: NonNegative = 1e-6

    def minimiser(
        self, evaluate: ca.Function, *, lower: Array, upper: Array, cost_unit: float
    ) -> ca.Function:
        r"""Build the minimiser of :math:`J(x) = (x-\bar x)' S (x-\bar x) + 2 r\,\ell(x)` in a box.

        Here :math:`S = r P^{-1}` and r is the cost unit. The iterates are kept as z in
        :math:`x = \bar x + L z`, but the first step is the steepest descent in x. P must be
        positive definite; otherwise every step is rejected and the result is :math:`\bar x`, which
        must lie in the box.
        Arguments and result as in `backsight.solvers.box.gauss_newton.minimise`.
        """
        nx, nb = len(lower), int(np.sum(np.isfinite(lower) | np.isfinite(upper)))
        bounded = [i for i in range(nx) if np.isfinite(lower[i]) or np.isfinite(upper[i])]
        triangle = nx * (nx + 1) // 2
        run, x_bar, L = (ca.MX.sym("run"), ca.MX.sym("x_bar", nx), ca.MX.sym("L", nx, nx))
        names = [evaluate.name_in(i) for i in range(1, evaluate.n_in())]
        data = [ca.MX.sym(n, evaluate.sparsity_in(i + 1)) for i, n in enumerate(names)]
        sizes = {
            "go": 1, "z": nx, "d": nx, "t": 1, "J": 1, "slope": 1, "g": nx, "H": triangle,
            "G": triangle, "side": nb, "count": 1, "stalled": 1,
        }  # fmt: skip
        carry = {name: ca.MX.sym(name, size) for name, size in sizes.items()}

        z_try, x_try = trial(nx)(carry["z"], carry["d"], carry["t"], x_bar, L)
        loss, c, G_try = evaluate(x_try, *data)
        g_try, J_try = _gradient(nx, cost_unit)(z_try, loss, c, L)
        H_try, d_free, M, x_free = _direction(nx, bounded)(
            *(carry[k] for k in ("z", "g", "H", "count")), z_try, g_try, x_try, L
        )
        if bounded:
            lam, side_try, *_ = dual_active_set(nb)(M, x_free, lower[bounded], upper[bounded])
        else:
            lam, side_try = ca.MX(0, 1), ca.MX(0, 1)
        after = _judge(nx, bounded, self)(
            *carry.values(), z_try, J_try, g_try, H_try, G_try, d_free, lam, side_try, x_bar, L
        )
        body = ca.Function("bfgs", [*carry.values(), x_bar, L, *data], list(after))
        start = {name: ca.MX.zeros(size) for name, size in sizes.items()}
        start |= {"go": run, "J": ca.MX(1e300)}
        last = iterate(
            body, self.max_iterations, carry=list(start.values()), constants=[x_bar, L, *data]
        )
        end = dict(zip(sizes, last, strict=True))
        x, Sigma = finish(nx, bounded, lower, upper)(
            end["z"], ca.MX.zeros(nx), 0, end["G"], end["side"], x_bar, L
        )
        results = [x, Sigma, end["count"], end["go"], end["stalled"]]
        return ca.Function("minimise", [run, x_bar, L, *data], results)


def _gradient(nx: int, unit: float) -> ca.Function:
    """Gradient of J in z, and J."""
    z, loss, c = ca.SX.sym("z", nx), ca.SX.sym("loss"), ca.SX.sym("c", nx)
    L = ca.SX.sym("L", nx, nx)
    gradient = 2 * unit * (z - ca.tril(L).T @ c)
    return ca.Function(
        "bfgs_gradient", [z, loss, c, L], [gradient, unit * (ca.sumsqr(z) + 2 * loss)]
    )


def _direction(nx: int, bounded: list[int]) -> ca.Function:
    """Inverse BFGS matrix, the step without bounds, and what the bounds need."""
    z, z_try, g, g_try = (ca.SX.sym(n, nx) for n in ("z", "z_try", "g", "g_try"))
    vH, count = ca.SX.sym("H", nx * (nx + 1) // 2), ca.SX.sym("count")
    x_try, L = ca.SX.sym("x_try", nx), ca.SX.sym("L", nx, nx)
    T = ca.tril(L)
    s, y = z_try - z, g_try - g
    curvature = ca.dot(s, y)
    usable = ca.logic_and(count > 0, curvature > 0)
    rho = ca.if_else(usable, 1 / curvature, 0)
    H = unvech(vH)
    A = ca.SX.eye(nx) - rho * s @ y.T
    updated = A @ H @ A.T + rho * s @ s.T
    identity_in_x = solve_spd(T.T @ T, ca.SX.eye(nx))
    H = ca.if_else(count > 0, updated, identity_in_x)
    d = -H @ g_try
    M = T[bounded, :] @ H @ T[bounded, :].T
    x_free = x_try[bounded, :] + T[bounded, :] @ d
    return ca.Function(
        "bfgs_direction",
        [z, g, vH, count, z_try, g_try, x_try, L],
        [vech(H), d, vech(M) if bounded else ca.SX(0, 1), x_free],
    )


def _judge(nx: int, bounded: list[int], method: QuasiNewton) -> ca.Function:
    """Accept the trial point and take the step from there, or halve the step that led to it."""
    nb, triangle = len(bounded), nx * (nx + 1) // 2
    z, d, g, z_try, g_try, d_free, x_bar = (
        ca.SX.sym(n, nx) for n in ("z", "d", "g", "z_try", "g_try", "d_free", "x_bar")
    )
    go, t, J, slope, count, stalled, J_try = (
        ca.SX.sym(n) for n in ("go", "t", "J", "slope", "count", "stalled", "J_try")
    )
    H, G, H_try, G_try = (ca.SX.sym(n, triangle) for n in ("H", "G", "H_try", "G_try"))
    side, lam, side_try = (ca.SX.sym(n, nb) for n in ("side", "lam", "side_try"))
    L = ca.SX.sym("L", nx, nx)
    T = ca.tril(L)

    first = count == 0
    accept = J_try <= J + 1e-4 * t * slope
    moved, size = ca.norm_2(T @ (z_try - z)), ca.norm_2(x_bar + T @ z)
    small = ca.logic_or(
        ca.fabs(J - J_try) < method.cost_tolerance * (1 + ca.fabs(J)),
        moved < method.step_tolerance * (1 + size),
    )
    stop = ca.logic_and(ca.logic_not(first), small)
    d_try = d_free + unvech(H_try) @ T[bounded, :].T @ lam
    halved = t / 2
    failed = ca.logic_and(ca.logic_not(accept), halved < 1e-8)
    new = {
        "z": z_try, "d": d_try, "t": 1, "J": J_try, "slope": ca.dot(g_try, d_try), "g": g_try,
        "H": H_try, "G": G_try, "side": side_try,
    }  # fmt: skip
    old = {
        "z": z, "d": d, "t": halved, "J": J, "slope": slope, "g": g, "H": H, "G": G, "side": side
    }  # fmt: skip
    chosen = [ca.if_else(accept, new[k], old[k]) for k in new]
    go_on = ca.logic_not(ca.logic_or(failed, ca.logic_and(accept, stop)))
    return ca.Function(
        "bfgs_judge",
        [go, z, d, t, J, slope, g, H, G, side, count, stalled,
         z_try, J_try, g_try, H_try, G_try, d_free, lam, side_try, x_bar, L],
        [go_on, *chosen, count + 1, failed],
    )  # fmt: skip
