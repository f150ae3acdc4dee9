"""Windows of a linear model with many states whose covariances have converged.

With a Kalman filter as arrival cost the covariances of a window are those of this filter. While all
channels are measured with their nominal noise and the filter's covariance is at its limit (see
`backsight.estimators.steady.state`), every sample of a window has the same gain: what is left is a
filter forward and its adjoint backward with constant matrices. If the trajectory keeps all limits,
it is the optimum; any other window is solved as it always is.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.engine.dense import few_entries, near_to
from backsight.engine.loops import all_finite, iterate, scan, smallest
from backsight.engine.recursion import Recursion
from backsight.estimators.arrival import EKFArrival, SmoothedArrival
from backsight.estimators.mhe._sample import SMALL, Parts, memory, within
from backsight.estimators.parts.covariance import matrix_product
from backsight.estimators.parts.filtering import data_inputs, estimate_told
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.stages import outputs_and_limits
from backsight.estimators.parts.substeps import linear_step
from backsight.estimators.parts.window import moved_on
from backsight.estimators.steady import SteadyState, limit_of, waited
from backsight.models.lti import output_equation


def window_limit(parts: Parts, arrival: object) -> SteadyState | None:
    """Where the covariance of the arrival cost goes; None if windows must be solved anew."""
    s, chain = parts.s, parts.chain
    filtering = isinstance(arrival, EKFArrival) or arrival == SmoothedArrival()
    plain = not (parts.lag or parts.walk.any() or chain.noise.any() or chain.exact or s.parts)
    controlled = parts.optimiser.tolerance > 0 and not chain.softness.any()
    if not (chain.dense and filtering and plain and controlled):
        return None
    step, seen = linear_step(s, parts.integrator), output_equation(s.model)
    once = not s.model.continuous or parts.integrator.steps == 1
    if step is None or seen is None or not once or np.linalg.matrix_rank(s.R) < len(s.R):
        return None
    return limit_of(step[0], seen[0], s.Q, s.R)


def steady_windows(plain: Recursion, parts: Parts, limit: SteadyState) -> Recursion:
    """The recursion whose windows are solved anew only where the covariances can have changed."""
    s, N, nx, ny = parts.s, parts.chain.N, parts.s.model.nx, parts.s.model.ny
    names, sizes = [c.name for c in plain.channels], plain.output_sizes
    kept = {k: np.zeros(sizes[names.index(k)]) for k in ("P", "S")}
    m = Memory(window=plain.carry0, **kept, waiting=float(limit.wait + N + 1))
    data = data_inputs(s)

    quick, ok, told = _reused_window(parts, limit)(m.window, *data)
    outputs = dict(zip(("x_hat", "y_hat", "e", "status", "kkt"), _split(told, parts), strict=True))
    outputs |= {"P": m.P, "S": m.S, "iterations": ca.MX(1), "passes": ca.MX(1)}
    if "infeasible" in names:
        outputs["infeasible"] = ca.MX.zeros(sizes[names.index("infeasible")])
    ordered = [ca.vec(ca.densify(outputs[k])) for k in names]

    # Where that does not hold, the window is solved, and the covariance has to come to its limit.
    go, waiting = ca.MX.sym("go"), ca.MX.sym("waiting")
    symbols = [ca.MX.sym("o", *k.shape) for k in (quick, *ordered)]
    given = [ca.MX.sym("i", *k.shape) for k in (m.window, *data)]
    after, *shown = plain.step.call(given)
    start = _places(memory(parts), "spread")
    near = near_to(ca.reshape(after[start], nx, nx), ca.MX(ca.DM(limit.P)), limit.sigma, limit.near)
    still = waited(ny, limit.wait + N)(given[-1], near, waiting)
    body = ca.Function(
        "window_anew", [go, *symbols, waiting, *given], [ca.MX(0), after, *shown, still]
    )
    free = ca.SX.sym("ok"), ca.SX.sym("waiting")
    goes = ca.Function("window_goes", free, [1 - ca.logic_and(free[0], free[1] <= 0)])
    _, after, *shown, still = iterate(
        body,
        1,
        carry=[goes(ok, m.waiting), quick, *ordered, m.waiting],
        constants=[m.window, *data],
    )
    found = dict(zip(names, shown, strict=True))
    return m.recursion(
        plain.name,
        data,
        next={"window": after, "P": found["P"], "S": found["S"], "waiting": still},
        outputs=found,
        channels=plain.channels,
        dt=plain.dt,
    )


def _places(m: Memory, name: str) -> slice:
    """Where a part of a memory is."""
    at = 0
    for part, value in m.parts(m.start).items():
        if part == name:
            return slice(at, at + value.size)
        at += value.size
    raise KeyError(name)


def _split(told: ca.MX, parts: Parts) -> list[ca.MX]:
    nx, ny = parts.s.model.nx, parts.s.model.ny
    ends = np.cumsum([0, nx, ny, ny, 1, 1])
    return ca.vertsplit(told, [int(k) for k in ends])


def _reused_window(parts: Parts, limit: SteadyState) -> ca.Function:
    """``(window, u, y, mask) -> (window, ok, told)``: the next sample with the gain of the limit.

    ``ok`` is 1 if everything was measured and the trajectory keeps its limits; ``told`` are
    estimate, outputs, innovation, status and residual of the optimality conditions.
    """
    s, N = parts.s, parts.chain.N
    m, data = memory(parts), data_inputs(s)
    u, y, mask = s.enter()(*data)
    U, Y, M, present = moved_on((m.U, m.Y, m.M, m.present), (u, y, mask, 1))
    forward, backward, look = _passes(parts, limit)
    ahead = ca.horzcat(U[:, 1:], U[:, N])
    _, (x_prior, x_post, nu) = scan(forward, N + 1, carry=[m.x_start], xs=[U, ahead, Y])
    start = [ca.MX.zeros(s.model.nx), ca.MX(0)]
    (_, residual), (X,) = scan(backward, N + 1, carry=start, xs=[x_post, nu, U, Y], backward=True)

    e = look(m.x_last, U[:, N - 1], u, y)
    least, finite, full = ca.SX.sym("least"), ca.SX.sym("finite"), ca.SX.sym("full")
    nominal = smallest(-ca.fabs(mask - 1))
    of_limits = ca.MX(0)
    if parts.chain.n:
        *_, low, high = outputs_and_limits(s, parts.limits, parts.chain)(X, U, Y, M, present)
        of_limits = smallest(ca.vertcat(ca.vec(-low), ca.vec(high)))
    right = ca.logic_and(ca.logic_and(least >= 0, finite), full >= 0)
    ok = ca.Function("keeps_limits", [least, finite, full], [right])(
        of_limits, all_finite(X), nominal
    )
    x = within(s)(X[:, N], 0)
    x_hat, y_hat, status = estimate_told(s, x=x, u=u, flags=ca.MX(Flags().vector()))
    after = {
        "x_start": x_prior[:, 1], "spread": m.spread, "x_last": X[:, N], "P_last": m.P_last,
        "U": U, "Y": Y, "M": M, "present": present, "X": X,
        "side": ca.MX.zeros(*m.side.shape), "late": m.late,
    }  # fmt: skip
    told = ca.vertcat(x_hat, y_hat, ca.DM(s.sy) * e, status, ca.fmax(residual, SMALL))
    return ca.Function("reused_window", [m.symbol, *data], [m.joined(after), ok, told])


def _passes(parts: Parts, limit: SteadyState) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Samples of the pass forward and of its adjoint, and the innovation of the newest sample.

    ``(x, u, u_next, y) -> (x_next, x, x_post, nu)`` with the multiplier nu of the outputs,
    ``(lam, residual, x_post, nu, u, y) -> (lam, residual, X)``, ``(x, u_last, u, y) -> e``.
    """
    s = parts.s
    step, seen = linear_step(s, parts.integrator), output_equation(s.model)
    if step is None or seen is None:
        raise ValueError("the model is not linear")  # `window_limit` has looked
    (F, first, last, c), (C, D, d) = step, seen
    S = C @ limit.P @ C.T + s.R
    K = np.linalg.solve(S, C @ limit.P).T
    left = np.eye(len(F)) - K @ C
    P = left @ limit.P @ left.T + K @ s.R @ K.T
    root = np.linalg.cholesky(s.R)
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny

    def moved(x: ca.MX, ua: ca.MX, ub: ca.MX) -> ca.MX:
        return _times(F, x) + _times(first, ua) + _times(last, ub) + ca.DM(c)

    def missed(x: ca.MX, u: ca.MX, y: ca.MX) -> ca.MX:
        return y - _times(C, x) - _times(D, u) - ca.DM(d)

    sizes = {"x": nx, "lam": nx, "ua": nu, "ub": nu, "y": ny, "nu": ny, "residual": 1}
    k = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    e = missed(k["x"], k["ua"], k["y"])
    x_post = k["x"] + _times(K, e)
    forward = ca.Function(
        "reused_forward",
        [k["x"], k["ua"], k["ub"], k["y"]],
        [moved(x_post, k["ua"], k["ub"]), k["x"], x_post, _times(np.linalg.inv(S), e)],
    )
    X = k["x"] + _times(P, k["lam"])
    nu = k["nu"] - _times(K.T, k["lam"])
    # R nu is what the trajectory leaves of the measurement.
    gap = _times(root.T, nu) - _times(np.linalg.inv(root), missed(X, k["ua"], k["y"]))
    lam = _times(F.T, k["lam"] + _times(C.T, nu))
    backward = ca.Function(
        "reused_backward",
        [k["lam"], k["residual"], k["x"], k["nu"], k["ua"], k["y"]],
        [lam, ca.fmax(k["residual"], -smallest(-ca.fabs(gap))), X],
    )
    newest = missed(moved(k["x"], k["ua"], k["ub"]), k["ub"], k["y"])
    look = ca.Function("reused_innovation", [k["x"], k["ua"], k["ub"], k["y"]], [newest])
    return forward, backward, look


def _times(matrix: NDArray[np.floating[Any]], vector: ca.MX) -> ca.MX:
    if not matrix.any():
        return ca.MX.zeros(len(matrix), 1)
    return ca.densify(matrix_product(few_entries(np.asarray(matrix, float)), vector))
