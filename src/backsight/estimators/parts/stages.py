"""The samples of a window as the trajectory solver wants them: outputs and limits."""

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.update import masked, measured
from backsight.engine.dense import (
    applied,
    cholesky_of,
    diagonal,
    few_entries,
    product_of,
    scaled_rows,
    solve_triangular,
)
from backsight.engine.loops import iterate, scan
from backsight.estimators.base import Setting
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.leaf import leaf, notation
from backsight.estimators.parts.limits import Limits, exact_outputs
from backsight.models.lti import output_equation
from backsight.solvers.trajectory import Chain, end_covariance
from backsight.types import Array


def chain_of(
    s: Setting,
    limits: Limits,
    F: ca.Sparsity,
    *,
    Q: Array,
    N: int,
    parts: Sequence[Array] = (),
) -> Chain:
    """Sizes and constants of a window; F is where its transition matrices can differ from zero."""
    seen = _linear_outputs(s)
    if seen is None:
        x, u, y, mask = _symbols(s)
        rows = sensed(s, x, u, y, mask)
        H, A = rows.H.sparsity(), limited_rows(s, limits, rows, x, u, y)[0].sparsity()
    else:
        C = few_entries(seen[0])
        H = C.sparsity() if _independent(s) else ca.Sparsity.dense(*C.shape)
        A = ca.sparsify(ca.DM(limits.state - limits.residual @ seen[0])).sparsity()
    return Chain(
        N=N,
        Q=Q,
        F=F,
        H=H,
        noise=limits.noise,
        A=A,
        softness=limits.softness,
        slack=limits.slack,
        exact=tuple(limits.exact),
        parts=tuple(parts),
    )


def outputs_and_limits(s: Setting, limits: Limits, chain: Chain) -> ca.Function:
    """``(X, U, Y, M, present) -> (before, H, e, A, low, high)`` of all samples, see `Chain.sizes`.

    X is the trajectory along which outputs and residuals are linearised. The noise of a transition
    is multiplied by inputs of the sample from which it leads.
    """
    nx, nu, ny, N = s.model.nx, s.model.nu, s.model.ny, chain.N
    sizes = {"X": nx, "U": nu, "Y": ny, "M": ny, "present": 1}
    X, U, Y, M, present = given = [ca.MX.sym(k, size, N + 1) for k, size in sizes.items()]
    before = ca.horzcat(0, present[:, :-1])
    last = ca.MX(ca.DM([[0.0] * N + [1.0]]))
    found = _linear_outputs(s)
    one = _sample(s, limits, chain) if found is None else _of_many(s, limits, chain, *found)
    _, seen = scan(one, N + 1, carry=[ca.MX(0)], xs=[X, U, Y, M, before, present, last])
    factors = [present * U[a, :] * U[b, :] for a, b in (p.index for p in s.parts)]
    multiplied = [ca.horzcat(0, factor[:, :-1]) for factor in factors[: len(chain.parts)]]
    return ca.Function("outputs_and_limits", given, [ca.vertcat(before, *multiplied), *seen])


def equations_among(chain: Chain) -> ca.Function:
    """``(side, low, high) -> (side, dropped)``: of the active limits those that are equations.

    An equation, a limit whose ends are the same, is known to hold; that another limit is active is
    known from the data only, and does not make the state there any surer. ``dropped`` counts those.
    """
    side, low, high = symbols = [ca.SX.sym(k, chain.n) for k in ("side", "low", "high")]
    count = ca.SX.sym("count")
    width = (high - low) / ca.SX(np.maximum(chain.slack, 1e-300))
    kept = ca.if_else(width <= 1, side, 0)
    change = ca.sum1(ca.fabs(side - kept)) if chain.n else ca.SX(0)
    body = ca.Function("equations", [count, *symbols], [count + change, ca.densify(kept)])
    stacks = [ca.MX.sym(k, chain.n, chain.N + 1) for k in ("side", "low", "high")]
    (dropped,), (free,) = scan(body, chain.N + 1, carry=[ca.MX(0)], xs=stacks)
    return ca.Function("equations_of_window", stacks, [free, dropped])


def covariance_of(chain: Chain) -> ca.Function:
    """``(dropped, P, *problem) -> P`` of the last sample without the limits that were dropped.

    P is with them, and is what it is without them if there were none.
    """
    if not chain.n:
        P = ca.MX.sym("P", chain.size_P)
        problem = chain.window() + [ca.MX.sym(k, 0, chain.N + 1) for k in ("side", "force")]
        return ca.Function("covariance_of_end", [ca.MX.sym("go"), P, *problem], [P])
    problem = chain.window() + [ca.MX.sym(k, chain.n, chain.N + 1) for k in ("side", "force")]
    go, P = ca.MX.sym("go"), ca.MX.sym("P_all", chain.size_P)
    free = ca.Function(
        "without_limits", [go, P, *problem], [ca.MX(0), end_covariance(chain)(*problem)]
    )
    return ca.Function(
        "covariance_of_end",
        [go, P, *problem],
        [iterate(free, 1, carry=[go, P], constants=problem)[1]],
    )


def _linear_outputs(s: Setting) -> tuple[Array, Array, Array] | None:
    """Matrices of the outputs of a model of many states, if they are linear: constants then.

    None also if a sensor has no noise.
    """
    if not Covariance(s.model.nx).whole or exact_outputs(s.R):
        return None
    return output_equation(s.model)


def _independent(s: Setting) -> bool:
    """Whether the noise of every sensor is its own."""
    return not np.count_nonzero(s.R - np.diag(np.diag(s.R)))


def _symbols(s: Setting) -> list[ca.SX]:
    m = s.model
    return [ca.SX.sym(k, size) for k, size in (("x", m.nx), ("u", m.nu), ("y", m.ny), ("m", m.ny))]


@dataclasses.dataclass(frozen=True)
class Sensed:
    """Rows of a sample.

    Parameters
    ----------
    H, e : (ny, nx), (ny,)
        Derivatives of the outputs and residuals, both with unit noise; zero where there is none.
    H_exact, e_exact : (ny, nx), (ny,)
        Those of combinations of outputs that are measured without noise.
    exact : (ny,)
        1 for those that are.
    """

    H: ca.SX
    e: ca.SX
    H_exact: ca.SX
    e_exact: ca.SX
    exact: ca.SX


def measured_rows(s: Setting, x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Derivative of the outputs (ny, nx) and residuals (ny,), both with unit noise."""
    rows = sensed(s, x, u, y, mask)
    return rows.H, rows.e


def sensed(s: Setting, x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Sensed:
    """Rows of a sample, with those that have no noise apart."""
    output, variances = s.model.output(x, u), np.diag(s.R)
    H, e, never = ca.jacobian(output, x), y - output, exact_outputs(s.R)
    if _independent(s):
        weights = [0 if v == 0 else mask[i] / np.sqrt(v) for i, v in enumerate(variances)]
        of_noise, none = ca.sparsify(ca.vertcat(ca.SX(0, 1), *weights)), variances == 0
        seen = ca.SX(none.astype(float)) * (mask > 0)
        return Sensed(ca.sparsify(ca.diag(of_noise) @ H), of_noise * e, H, e, seen)
    H, e, R = masked(H, e, ca.SX(s.R), mask)
    L = cholesky_semidefinite(R)
    rows: list[ca.SX] = []
    left: list[ca.SX] = []
    seen = ca.SX.zeros(s.model.ny)
    for j, row in enumerate(ca.vertsplit(ca.horzcat(e, H))):
        known = sum((L[j, k] * done for k, done in enumerate(rows)), ca.SX(*row.shape))
        left.append(row - known)
        # What the outputs before it do not tell of its noise, if anything.
        noisy = L[j, j] > 0
        if j in never:
            seen[j] = ca.logic_and(mask[j] > 0, ca.logic_not(noisy))
            rows.append(ca.if_else(noisy, left[j] / ca.if_else(noisy, L[j, j], 1), 0))
        else:
            rows.append(left[j] / L[j, j])
    white, rest = ca.vertcat(*rows), ca.vertcat(*left)
    return Sensed(ca.sparsify(white[:, 1:]), white[:, 0], rest[:, 1:], rest[:, 0], seen)


def limited_rows(
    s: Setting, limits: Limits, rows: Sensed, x: ca.SX, u: ca.SX, y: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Derivatives of the limited quantities by the state (n, nx), and their values (n,)."""
    of_state, of_residual = (_sparse(w) for w in (limits.state, limits.residual))
    output = s.model.output(x, u)
    A = ca.SX(of_state - of_residual @ ca.jacobian(output, x))
    value = ca.densify(of_state @ x + of_residual @ (y - output))
    for r, j in limits.exact.items():
        A[r, :] = -limits.residual[r, j] * rows.H_exact[j, :]
        value[r] = limits.residual[r, j] * rows.e_exact[j]
    return ca.sparsify(A), value


def _sample(s: Setting, limits: Limits, chain: Chain) -> ca.Function:
    """Outputs and limits of a sample: ``(k, x, u, y, m, before, here, last) -> (k, *stage)``.

    The limit of a value that is constant in the window is that of the last sample. A
    limit that needs something that was not measured, or that lies before the data, has no bounds.
    """
    x, u, y, mask = _symbols(s)
    count, before, here, last = (ca.SX.sym(k) for k in ("k", "before", "here", "last"))
    rows = sensed(s, x, u, y, here * mask)
    A, value = limited_rows(s, limits, rows, x, u, y)
    low, high = _ends(limits, chain)(value, mask, before, here, last, rows.exact)
    columns = [entries(rows.H, chain.H), ca.densify(rows.e), entries(A, chain.A), low, high]
    return ca.Function("sample", [count, x, u, y, mask, before, here, last], [count + 1, *columns])


def _ends(limits: Limits, chain: Chain) -> ca.Function:
    """How far a limited quantity is from its ends: ``(value, m, before, here, last, exact)``."""
    value, mask = ca.SX.sym("value", chain.n), ca.SX.sym("m", chain.ny)
    before, here, last = (ca.SX.sym(k) for k in ("before", "here", "last"))
    exact = ca.SX.sym("exact", chain.ny)
    low, high = ca.SX(limits.lower) - value, ca.SX(limits.upper) - value
    for r in range(chain.n):
        needed = [mask[int(j)] for j in np.flatnonzero(limits.residual[r])]
        exists = before if limits.noise[r].any() else here
        if limits.once[r]:
            exists = last
        counts = ca.mmin(ca.vertcat(exists, *needed)) > 0
        if r in limits.exact:
            counts = exact[limits.exact[r]]
        low[r] = ca.if_else(counts, low[r], -np.inf)
        high[r] = ca.if_else(counts, high[r], np.inf)
    return ca.Function("ends", [value, mask, before, here, last, exact], [low, high])


def _of_many(s: Setting, limits: Limits, chain: Chain, C: Array, D: Array, d: Array) -> ca.Function:
    """`_sample` of a model of many states with the outputs C x + D u + d, as matrices."""
    nx, nu, ny, n = s.model.nx, s.model.nu, s.model.ny, chain.n
    sizes = {"k": 1, "x": nx, "u": nu, "y": ny, "m": ny, "before": 1, "here": 1, "last": 1}
    given = [ca.MX.sym(name, size) for name, size in sizes.items()]
    count, x, u, y, mask, before, here, last = given
    e = y - applied(few_entries(C), x) - applied(few_entries(D), u) - ca.DM(d)
    value = ca.MX.zeros(n, 1)
    if n:
        value = applied(few_entries(limits.state), x) + applied(few_entries(limits.residual), e)
    low, high = _ends(limits, chain)(value, mask, before, here, last, ca.MX.zeros(ny))
    H, e = _whitened(s, chain, C)(e, here * mask)
    A = ca.project(ca.DM(limits.state - limits.residual @ C), chain.A)
    columns = [H, e, ca.MX(ca.DM(A.nonzeros())) if A.nnz() else ca.MX(0, 1), low, high]
    return ca.Function("sample_of_many", given, [count + 1, *columns])


def _whitened(s: Setting, chain: Chain, C: Array) -> ca.Function:
    """``(e, weights) -> (H, e)``: entries of C and residuals, both with unit noise."""
    ny = s.model.ny
    e, weights = ca.MX.sym("e", ny), ca.MX.sym("weights", ny)
    if _independent(s):
        by = weights / ca.DM(np.sqrt(np.diag(s.R)))
        # Every entry times the weight of its row, as the product with a matrix.
        rows, values = chain.H.row(), ca.project(ca.DM(C), chain.H).nonzeros()
        spread = ca.DM.triplet(list(range(len(rows))), rows, ca.DM(values), len(rows), ny)
        return ca.Function("whitened", [e, weights], [applied(spread, by), by * e])
    rows = scaled_rows(ca.horzcat(ca.MX(ca.DM(C)), e), weights)
    white = solve_triangular(cholesky_of(noise_seen(s)(weights)), rows)
    return ca.Function("whitened", [e, weights], [ca.vec(white[:, :-1]), white[:, -1]])


def noise_seen(s: Setting) -> ca.Function:
    """``mask -> R`` of `backsight.algebra.update.masked`, for many states."""
    mask = ca.MX.sym("mask", s.model.ny)
    seen = leaf("measured", notation(s), lambda mask: {"seen": measured(mask)})(mask)
    both = product_of(seen, seen, turned=(False, True))
    return ca.Function("noise_seen", [mask], [ca.MX(ca.DM(s.R)) * both + diagonal(1 - seen)])


def entries(matrix: ca.SX, pattern: ca.Sparsity) -> ca.SX:
    """The entries of a matrix at the places of a pattern, as a column."""
    places = zip(pattern.row(), pattern.get_col(), strict=True)
    return ca.densify(ca.vertcat(ca.SX(0, 1), *(matrix[r, k] for r, k in places)))


def _sparse(matrix: Array) -> ca.SX:
    return ca.SX(ca.sparsify(ca.DM(matrix)))
