"""Bounded nonlinear least squares around a Gaussian prior, by Gauss-Newton steps."""

import dataclasses
from typing import Any

import casadi as ca
import numpy as np

from backsight.algebra.factor import ldl, solve_spd
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.triangular import forward
from backsight.description import Count, Description, NonNegative
from backsight.engine.dense import UNROLL
from backsight.engine.loops import iterate
from backsight.solvers.box._box import dual_active_set
from backsight.solvers.box._gauss_newton_dense import (
    dense_covariance,
    dense_held,
    dense_hessian,
    dense_products,
    dense_step,
    dense_trial,
)
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class GaussNewton(Description):
    r"""When and how the iterations end.

    Parameters
    ----------
    max_iterations : int
        Largest number of evaluations of model and sensitivities. If it is reached, the result is
        the best point that was evaluated.
    tolerance : float
        The iterations end when the next step is shorter than this, measured in standard
        deviations of the estimate. With 0 exactly `max_iterations` are made.
    active_set_passes : int, optional
        Largest number of passes in which the active limits of a step are found; by default so many
        as always suffice. Where they do not, the status says *iteration limit* and the estimate is
        set to its bounds. With ``tolerance = 0`` and this a sample takes a fixed effort.
    cost_tolerance, step_tolerance : float, optional
        A rule of the kind of general optimisers instead: end when
        :math:`|J_i - J_{i+1}| < \delta_J (1 + |J_i|)` or
        :math:`|x_i - x_{i+1}| < \delta_x (1 + |x_i|)`, with J and x scaled as in
        Polóni et al. (2012), section VI.D. J is then of the order of 1e-6, so that the rule is an
        absolute tolerance and nearly always ends after one step.

    Examples
    --------
    >>> bs.settings.GaussNewton(max_iterations=1).tolerance  # one iteration: real time
    1e-06
    """

    max_iterations: Count = 20
    tolerance: NonNegative = 1e-6
    cost_tolerance: NonNegative | None = None
    step_tolerance: NonNegative | None = None
    active_set_passes: Count | None = None

    def minimiser(
        self, evaluate: ca.Function, *, lower: Array, upper: Array, cost_unit: float
    ) -> ca.Function:
        """Build the minimiser of a cost around a Gaussian prior in a box, see `minimise`."""
        return minimise(evaluate, self, lower=lower, upper=upper, cost_unit=cost_unit)


def minimise(
    evaluate: ca.Function,
    method: GaussNewton,
    *,
    lower: Array,
    upper: Array,
    cost_unit: float,
) -> ca.Function:
    r"""Build the minimiser of :math:`\tfrac12 (x-\bar x)' P^{-1} (x-\bar x) + \ell(x)` in a box.

    The unknown is z in :math:`x = \bar x + L z`, :math:`P = L L'`: the Hessian becomes
    :math:`I + L' G L`, whose eigenvalues are at least 1, and P may be singular. A step is accepted
    if it lowers the cost (Armijo), else halved.

    Parameters
    ----------
    evaluate : casadi.Function
        ``(x, *data) -> (l, c, G)``: cost, minus its gradient (nx,), and the lower triangle of its
        Gauss-Newton Hessian.
    method : GaussNewton
    lower, upper : (nx,) arrays
        Bounds on x, infinite where there is none.
    cost_unit : float
        Factor from the cost to the J of `GaussNewton.cost_tolerance`.

    Returns
    -------
    casadi.Function
        ``(run, x_bar, L, *data) -> (x, Sigma, iterations, limit, rejected)``. With ``run = 0`` the
        result is x_bar. ``limit`` is 1 if the iterations, or the passes that find the active bounds
        of the last step, did not suffice. Sigma is the lower triangle of the covariance of x;
        directions fixed by an active bound have none.
    """
    nx = len(lower)
    symbols = [ca.MX.sym("run"), ca.MX.sym("x_bar", nx), ca.MX.sym("L", nx, nx)]
    run, x_bar, L = symbols
    data = [ca.MX.sym(evaluate.name_in(i), *evaluate.size_in(i)) for i in range(1, evaluate.n_in())]
    bounded = [i for i in range(nx) if np.isfinite(lower[i]) or np.isfinite(upper[i])]
    go, z, d, t, cost, slope = (
        ca.MX.sym(n, k) for n, k in zip("gzdtJs", (1, nx, nx, 1, 1, 1), strict=True)
    )
    vG, side = ca.MX.sym("G", nx * (nx + 1) // 2), ca.MX.sym("side", len(bounded))
    count, stalled, unsolved = (ca.MX.sym(n) for n in ("count", "stalled", "unsolved"))
    carry = [go, z, d, t, cost, slope, vG, side, count, stalled, unsolved]

    z_try, x_try = trial(nx)(z, d, t, x_bar, L)
    loss, c, vG_try = evaluate(x_try, *data)
    z_free, V, M, x_free = _step(nx, bounded)(z_try, x_bar, L, c, _hessian(nx)(vG_try, L))
    if bounded:
        active_set = dual_active_set(len(bounded), most=method.active_set_passes)
        found = active_set(M, x_free, lower[bounded], upper[bounded])
        lam, side_try, _, exhausted = found
    else:
        lam, side_try, exhausted = ca.MX(0, 1), ca.MX(0, 1), ca.MX(0)
    after = _judge(nx, len(bounded), method, cost_unit)(
        z, d, t, cost, slope, vG, side, count, z_try, loss, c, vG_try, z_free, V, lam, side_try, L
    )
    body = ca.Function("gauss_newton", [*carry, x_bar, L, *data], [*after, exhausted])
    start = [
        run, *(ca.MX.zeros(nx) for _ in range(2)), ca.MX(0), ca.MX(1e300), ca.MX(0),
        ca.MX.zeros(vG.numel()), ca.MX.zeros(len(bounded)), ca.MX(0), ca.MX(0), ca.MX(0),
    ]  # fmt: skip
    last = iterate(body, method.max_iterations, carry=start, constants=[x_bar, L, *data])
    go_out, z_out, d_out, t_out, _, _, vG_out, side_out, count_out, stalled_out, open_out = last
    x, Sigma = finish(nx, bounded, lower, upper)(z_out, d_out, t_out, vG_out, side_out, x_bar, L)
    limit = ca.fmax(go_out, open_out) if method.tolerance > 0 else open_out
    return ca.Function("minimise", [*symbols, *data], [x, Sigma, count_out, limit, stalled_out])


def trial(nx: int) -> ca.Function:
    """Point after a step, ``(z, d, t, x_bar, L) -> (z, x)``."""
    if nx > UNROLL:
        return dense_trial(nx)
    z, d, t = ca.SX.sym("z", nx), ca.SX.sym("d", nx), ca.SX.sym("t")
    x_bar, L = ca.SX.sym("x_bar", nx), _lower("L", nx)
    z_try = z + t * d
    return ca.Function("trial", [z, d, t, x_bar, L], [z_try, x_bar + ca.tril(L) @ z_try])


def _hessian(nx: int) -> ca.Function:
    """Hessian I + L' G L of the whole cost in z, ``(G, L) -> A``."""
    if nx > UNROLL:
        return dense_hessian(nx)
    vG, L = ca.SX.sym("G", nx * (nx + 1) // 2), _lower("L", nx)
    T = ca.tril(L)
    return ca.Function("gn_hessian", [vG, L], [vech(T.T @ unvech(vG) @ T + ca.SX.eye(nx))])


def _step(nx: int, bounded: list[int]) -> ca.Function:
    """Gauss-Newton step without bounds, and what the bounds need: columns V, M = Sigma_bb."""
    if nx > UNROLL:
        return dense_step(nx, bounded)
    z, x_bar, L = ca.SX.sym("z", nx), ca.SX.sym("x_bar", nx), _lower("L", nx)
    c, vA = ca.SX.sym("c", nx), ca.SX.sym("A", nx * (nx + 1) // 2)
    T, A = ca.tril(L), unvech(vA)
    solved = solve_spd(A, ca.horzcat(T.T @ c + A @ z - z, T[bounded, :].T))
    z_free, V = solved[:, 0], solved[:, 1:]
    M = T[bounded, :] @ V
    x_free = x_bar[bounded, :] + T[bounded, :] @ z_free
    return ca.Function(
        "gn_step", [z, x_bar, L, c, vA], [z_free, V, vech(M) if bounded else ca.SX(0, 1), x_free]
    )


def _judge(nx: int, nb: int, method: GaussNewton, cost_unit: float) -> ca.Function:
    """Accept the trial point and take the step from there, or halve the step that led to it."""
    many, n = nx > UNROLL, nx * (nx + 1) // 2
    sizes = {
        "z": nx, "d": nx, "t": 1, "cost": 1, "slope": 1, "G": n, "side": nb, "count": 1,
        "z_try": nx, "loss": 1, "c": nx, "G_try": n, "z_free": nx, "V": (nx, nb), "lam": nb,
        "side_try": nb, "L": (nx, nx),
    }  # fmt: skip
    shapes = {k: size if isinstance(size, tuple) else (size, 1) for k, size in sizes.items()}
    symbol: Any = ca.MX.sym if many else ca.SX.sym
    k: dict[str, Any] = {name: symbol(name, *shape) for name, shape in shapes.items()}
    products: tuple[Any, ...] = dense_products(k) if many else _products(k)
    d_try, *measured = products
    given = [k[name] for name in ("z", "d", "t", "cost", "slope", "side", "count", "z_try", "loss")]
    decide = _decided(nx, nb, method, cost_unit)
    accept, go, *kept = decide.call([*given, k["side_try"], d_try, *measured])
    G = ca.if_else(accept, k["G_try"], k["G"])
    *before, side, count, stalled = kept
    return ca.Function("judge", list(k.values()), [go, *before, G, side, count, stalled])


def _products(k: dict[str, ca.SX]) -> tuple[ca.SX, ...]:
    """The step from the trial point, and L' c, L d, G L d, L (z_try - z), L z for `_decided`."""
    T = ca.tril(k["L"])
    d_try = k["z_free"] + k["V"] @ k["lam"] - k["z_try"]
    Ld = T @ d_try
    moved = T @ (k["z_try"] - k["z"])
    return d_try, T.T @ k["c"], Ld, unvech(k["G_try"]) @ Ld, moved, T @ k["z"]


def _decided(nx: int, nb: int, method: GaussNewton, cost_unit: float) -> ca.Function:
    """Whether the trial point is accepted, and what `_judge` puts out but for the Hessian."""
    z, d, z_try, d_try, Lc, Ld, GLd, moved, Lz = (
        ca.SX.sym(n, nx) for n in ("z", "d", "z_try", "d_try", "Lc", "Ld", "GLd", "moved", "Lz")
    )
    t, cost, slope, count, loss = (ca.SX.sym(n) for n in ("t", "cost", "slope", "count", "loss"))
    side, side_try = ca.SX.sym("side", nb), ca.SX.sym("side_try", nb)

    cost_try = ca.sumsqr(z_try) / 2 + loss
    # The cost counts in units of log-likelihood, where 1e-9 means nothing; rounding of residuals
    # that are small beside the outputs may cost that much and must not reject a good step.
    accept = cost_try <= cost + 1e-4 * t * slope + 1e-9 * (1 + ca.fabs(cost))
    slope_try = ca.dot(z_try - Lc, d_try)
    length = ca.sumsqr(d_try) + ca.dot(Ld, GLd)
    done = length < method.tolerance**2
    stop = ca.SX(0)
    if method.cost_tolerance is not None:
        before, now = 2 * cost_unit * cost, 2 * cost_unit * cost_try
        stop = ca.logic_or(stop, ca.fabs(before - now) < method.cost_tolerance * (1 + before))
    if method.step_tolerance is not None:
        far = ca.norm_2(moved) < method.step_tolerance * (1 + ca.norm_2(Lz))
        stop = ca.logic_or(stop, ca.logic_and(count > 0, far))
    d_next = ca.if_else(stop, 0, d_try)
    done = ca.logic_or(done, stop)

    halved = t / 2
    stalled = ca.logic_and(ca.logic_not(accept), halved < 1e-8)
    go = ca.logic_not(ca.logic_or(stalled, ca.logic_and(accept, done)))
    # A step that nobody will evaluate is taken only where the number of steps is fixed.
    last = ca.logic_and(go, count + 1 >= method.max_iterations)
    held = ca.logic_or(stalled, last) if method.tolerance > 0 else stalled
    results = [
        accept,
        go,
        ca.if_else(accept, z_try, z),
        ca.if_else(accept, d_next, d),
        ca.if_else(held, 0, ca.if_else(accept, 1, halved)),
        ca.if_else(accept, cost_try, cost),
        ca.if_else(accept, slope_try, slope),
        ca.if_else(accept, side_try, side),
        count + 1,
        stalled,
    ]
    given = [z, d, t, cost, slope, side, count, z_try, loss, side_try]
    return ca.Function("decided", [*given, d_try, Lc, Ld, GLd, moved, Lz], results)


def finish(nx: int, bounded: list[int], lower: Array, upper: Array) -> ca.Function:
    """Last step taken, inside the bounds to the last bit, with its covariance.

    ``(z, d, t, G, side, x_bar, L) -> (x, Sigma)``.
    """
    sizes = {"z": nx, "d": nx, "t": 1, "G": nx * (nx + 1) // 2, "side": len(bounded), "x_bar": nx}
    z, d, t, vG, side, x_bar = (ca.MX.sym(name, size) for name, size in sizes.items())
    L = ca.MX.sym("L", nx, nx)
    _, x = trial(nx)(z, d, t, x_bar, L)
    free = ca.SX.sym("x", nx)
    inside = ca.Function("inside", [free], [ca.fmin(ca.fmax(free, lower), upper)])
    Sigma = _covariance(nx)(_hessian(nx)(vG, L), L)
    if bounded:
        Sigma = _held(nx, bounded)(Sigma, side)
    return ca.Function("finish", [z, d, t, vG, side, x_bar, L], [inside(x), Sigma])


def _covariance(nx: int) -> ca.Function:
    """Covariance L A^-1 L' of x, ``(A, L) -> Sigma``."""
    if nx > UNROLL:
        return dense_covariance(nx)
    vA, L = ca.SX.sym("A", nx * (nx + 1) // 2), _lower("L", nx)
    C, D = ldl(unvech(vA))
    W = ca.horzcat(*(forward(C, column) for column in ca.horzsplit(ca.tril(L).T)))
    return ca.Function("gn_covariance", [vA, L], [vech(W.T @ ca.diag(1 / D) @ W)])


def _held(nx: int, bounded: list[int]) -> ca.Function:
    """Covariance when the states at a bound are held there, ``(Sigma, side) -> Sigma``."""
    if nx > UNROLL:
        return dense_held(nx, bounded)
    vSigma, side = ca.SX.sym("Sigma", nx * (nx + 1) // 2), ca.SX.sym("side", len(bounded))
    Sigma, D = unvech(vSigma), ca.diag(side**2)
    free = ca.SX.eye(len(bounded)) - D
    K = solve_spd(D @ Sigma[bounded, bounded] @ D + free, D @ Sigma[bounded, :]).T
    return ca.Function("held", [vSigma, side], [vech(Sigma - K @ D @ Sigma[bounded, :])])


def _lower(name: str, n: int) -> ca.SX:
    return ca.SX.sym(name, n, n)
