"""Limited quantities of a window beside its filter: mean, covariance, and that with the end.

They are carried along like further states that do not change any more: a fixed-point smoother for
the limits of all samples at once.
"""

import dataclasses

import casadi as ca
import numpy as np
import scipy

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.symmetric import unvech
from backsight.algebra.triangular import forward
from backsight.algebra.update import masked
from backsight.engine.dense import add_product, filled_up
from backsight.engine.loops import scan
from backsight.estimators.linear_windows._window_filter import absorb, advance, begin, solve_start
from backsight.estimators.linear_windows.stacked import Stacked, stacked
from backsight.estimators.parts.limits import Rows, stacked_rows
from backsight.estimators.parts.linear import Linear, root
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class LimitGains:
    """Limited quantities of a full window: c = K Y + K_u U, covariance M, with the end Psi."""

    K: Array
    K_u: Array
    M: Array
    Psi: Array


def limit_gains(system: Linear, rows: Rows, N: int) -> LimitGains:
    """See `stacked.gains`, whose rows these are with other ends."""
    nx = len(system.A)
    s = stacked(system, N)
    noise = np.linalg.cholesky(np.asarray(scipy.linalg.block_diag(*[system.s.R] * (N + 1))))
    white = scipy.linalg.solve_triangular(noise, s.Phi, lower=True)
    q, r = np.linalg.qr(np.vstack([white, np.eye(s.Phi.shape[1])[nx:]]))
    on_state = stacked_rows(rows, N)
    wanted = on_state @ s.T + _noise_rows(system, rows, N, s)
    ends = scipy.linalg.solve_triangular(r, np.vstack([wanted, s.T[-nx:]]).T, trans=1).T
    limited, present = ends[:-nx], ends[-nx:]
    K = scipy.linalg.solve_triangular(noise, (limited @ q[: len(white)].T).T, lower=True, trans=1).T
    return LimitGains(
        K=K,
        K_u=on_state @ s.F - K @ s.Gamma,
        M=limited @ limited.T,
        Psi=limited @ present.T,
    )


def _noise_rows(system: Linear, rows: Rows, N: int, s: Stacked) -> Array:
    """Weights of the process noise, by the unknowns of the stack."""
    nx, n = len(system.A), len(rows.names)
    G = root(system.s.Q)
    q = G.shape[1]
    found = np.zeros(((N + 1) * n, s.T.shape[1]))
    for i in range(N):
        found[(i + 1) * n : (i + 2) * n, nx + i * q : nx + (i + 1) * q] = rows.noise @ G
    return found


def window_limits(system: Linear, rows: Rows, N: int) -> ca.Function:
    """As `window_filter`, and ``(c, M, Psi)``: ``(...) -> (x, P, deficient, c, M, Psi)``."""
    nx, nu, ny = (len(system.A), *system.D.T.shape)
    n = len(rows.names)
    total = n * (N + 1)
    full = filled_up(total)
    x, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    diffuse, present = ca.MX.sym("diffuse"), ca.MX.sym("present", 1, N + 1)
    U, Y, M_ = (ca.MX.sym(k, m, N + 1) for k, m in (("U", nu), ("Y", ny), ("M", ny)))
    zeros = [ca.MX.zeros(full, k) for k in (1, nx, nx, full)]
    end, _ = scan(
        _sample(system, rows, full),
        N + 1,
        carry=[x, *begin(nx)(vP, diffuse), *zeros],
        xs=[
            ca.horzcat(U[:, 0], U[:, :-1]), U, Y, M_, ca.horzcat(0, present[:, :-1]), present,
            ca.MX(np.eye(full, total)),
        ],
    )  # fmt: skip
    *filtered, c, Psi, Xc, M = end
    x_end, P_end, deficient, first, spread, inverse = solve_start(nx)(*filtered, diffuse)
    wide = add_product(ca.MX.zeros(full, nx), Xc, inverse)
    limited = [
        add_product(c, Xc, first.T),
        add_product(M, wide, wide)[:, :total],
        add_product(Psi, wide, spread),
    ]
    return ca.Function(
        "window_limits",
        [x, vP, diffuse, U, Y, M_, present],
        [x_end, P_end, deficient, *(rows_[:total, :] for rows_ in limited)],
    )


def _sample(system: Linear, rows: Rows, total: int) -> ca.Function:
    """Go on to a sample, take up its limited quantities, and take in its measurements."""
    nx, nu, ny = (len(system.A), *system.D.T.shape)
    n = len(rows.names)
    carry = [
        ca.MX.sym("x", nx),
        ca.MX.sym("P", nx * (nx + 1) // 2),
        ca.MX.sym("X", nx, nx),
        ca.MX.sym("L", (nx + 1) * (nx + 2) // 2),
        ca.MX.sym("c", total),
        ca.MX.sym("Psi", total, nx),
        ca.MX.sym("Xc", total, nx),
        ca.MX.sym("M", total, total),
    ]
    sizes = (("u", nu), ("v", nu), ("y", ny), ("m", ny), ("before", 1), ("here", 1))
    data = [ca.MX.sym(k, size) for k, size in sizes]
    E = ca.MX.sym("E", total, n)
    *filtered, c, Psi, Xc, M = carry
    u, v, y, mask, before, here = data

    ahead = advance(system)(*filtered, u, v, before)
    Psi = add_product(ca.MX.zeros(total, nx), Psi, _transition(system)(before))
    mean, by_start, spread, coefficients, variance = _take_up(system, rows)(
        *ahead[:3], before, here
    )
    cross = add_product(ca.MX.zeros(total, n), Psi, coefficients)
    cross = add_product(cross, E, variance)
    M = add_product(add_product(M, E, cross), cross, E)
    c = add_product(c, E, mean.T)
    Psi, Xc = add_product(Psi, E, spread), add_product(Xc, E, by_start)

    white, e, HX, HP = _whitened(system)(*ahead[:3], v, y, mask, here)
    seen = add_product(ca.MX.zeros(total, ny), Psi, white)
    after = [
        add_product(c, seen, e.T),
        add_product(Psi, -seen, HP),
        add_product(Xc, -seen, HX),
        add_product(M, -seen, seen),
    ]
    absorbed = absorb(system)(*ahead, v, y, mask, here)
    return ca.Function("limited_sample", [*carry, *data, E], [*absorbed, *after])


def _transition(system: Linear) -> ca.Function:
    before, nx = ca.SX.sym("before"), len(system.A)
    moved = ca.if_else(before, ca.SX(ca.DM(system.A)), ca.SX.eye(nx))
    return ca.Function("transition", [before], [ca.densify(moved)])


def _take_up(system: Linear, rows: Rows) -> ca.Function:
    """Mean of the new rows, derivative by the start, covariances with state and each other.

    The last two: their coefficients of the state (for the covariance with older rows), and half
    of the covariance among themselves. Matrices with a row per state are transposed.
    """
    nx = len(system.A)
    x, vP, X = ca.SX.sym("x", nx), ca.SX.sym("P", nx * (nx + 1) // 2), ca.SX.sym("X", nx, nx)
    before, here = ca.SX.sym("before"), ca.SX.sym("here")
    a, w = here * ca.SX(ca.DM(rows.state)), before * ca.SX(ca.DM(rows.noise))
    P, Q = unvech(vP), ca.SX(ca.DM(system.s.Q))
    variance = a @ P @ a.T + w @ Q @ w.T + a @ Q @ w.T + w @ Q @ a.T
    results = [a @ x, (a @ X).T, (a @ P + w @ Q).T, a, variance / 2]
    return ca.Function("take_up", [x, vP, X, before, here], [ca.densify(r) for r in results])


def _whitened(system: Linear) -> ca.Function:
    """Rows and innovations of unit variance; the rows times X and P, transposed."""
    nx, nu, ny = (len(system.A), *system.D.T.shape)
    x, vP, X = ca.SX.sym("x", nx), ca.SX.sym("P", nx * (nx + 1) // 2), ca.SX.sym("X", nx, nx)
    u, y, mask, here = (ca.SX.sym(*k) for k in (("u", nu), ("y", ny), ("m", ny), ("here", 1)))
    C, D = ca.sparsify(ca.DM(system.C)), ca.sparsify(ca.DM(system.D))
    e = y - ca.mtimes(C, x) - ca.mtimes(D, u)
    H, e, R = masked(ca.SX(C), e, ca.SX(system.s.R), here * mask)
    P = unvech(vP)
    L = cholesky_semidefinite(H @ P @ H.T + R)
    columns = ca.horzsplit(ca.densify(ca.horzcat(e, H)))
    white = ca.horzcat(*(forward(L, column) for column in columns))
    rows = white[:, 1:]
    results = [rows, white[:, 0], (rows @ X).T, (rows @ P).T]
    return ca.Function("whitened", [x, vP, X, u, y, mask, here], [ca.densify(r) for r in results])
