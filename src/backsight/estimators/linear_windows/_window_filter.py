"""Least squares over a window with missing samples, as one pass from sample to sample.

A Kalman filter runs through the window as if the first state were known; beside it goes the
derivative of its state by that first state, and the innovations become equations for it. The
result is the least-squares estimate with nothing known before the window; neither the transition
matrix nor the process noise is ever inverted. After de Jong, "The diffuse Kalman filter", 1991,
doi:10.1214/aos/1176348139.
"""

import casadi as ca

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.triangular import compress, forward
from backsight.algebra.update import gain, joseph, masked
from backsight.engine.loops import scan
from backsight.estimators.parts.linear import Linear, Varying
from backsight.models.lti import coefficients
from backsight.types import Array

NEGLIGIBLE = 1e-9
"""A pivot this small beside its row says that the window does not determine the direction."""


def window_filter(system: Linear | Varying, N: int) -> ca.Function:
    """``(x, P, diffuse, U, Y, M, present) -> (x, P, deficient, x_first, P_first)``.

    x and P (lower triangle) describe the start of the window, the results its end. With
    ``diffuse = 1`` nothing is known of the start, ``deficient`` is 1 if the measurements do not
    determine it, and ``x_first, P_first`` are what they say of it. Samples with ``present = 0`` do
    not exist; they come first.
    """
    nx, nu, ny = _sizes(system)
    x, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    diffuse = ca.MX.sym("diffuse")
    U, Y, M = (ca.MX.sym(n, k, N + 1) for n, k in (("U", nu), ("Y", ny), ("M", ny)))
    present = ca.MX.sym("present", 1, N + 1)
    absorbed = _absorb(system)(x, *_begin(nx)(vP, diffuse), U[:, 0], Y[:, 0], M[:, 0], present[0])
    carry, _ = scan(
        _next(system),
        N,
        carry=list(absorbed),
        xs=[U[:, :-1], U[:, 1:], Y[:, 1:], M[:, 1:], present[:, :-1], present[:, 1:]],
    )
    results = _solve_start(nx)(*carry, diffuse, x)
    return ca.Function("window_filter", [x, vP, diffuse, U, Y, M, present], list(results))


def _symbols(nx: int) -> list[ca.SX]:
    """State, covariance, derivative by the first state, equations for the first state."""
    return [
        ca.SX.sym("x", nx),
        ca.SX.sym("P", nx * (nx + 1) // 2),
        ca.SX.sym("X", nx, nx),
        ca.SX.sym("L", (nx + 1) * (nx + 2) // 2),
    ]


def _begin(nx: int) -> ca.Function:
    """``(P, diffuse) -> (P, X, L)`` at the start of the window."""
    vP, diffuse = ca.SX.sym("P", nx * (nx + 1) // 2), ca.SX.sym("diffuse")
    identity = ca.densify(diffuse * ca.SX.eye(nx))
    equations = ca.SX.zeros((nx + 1) * (nx + 2) // 2)
    return ca.Function("begin", [vP, diffuse], [(1 - diffuse) * vP, identity, equations])


def _sizes(system: Linear | Varying) -> tuple[int, int, int]:
    """Numbers of states, inputs and outputs."""
    return system.s.model.nx, system.s.model.nu, system.s.model.ny


def _absorb(system: Linear | Varying) -> ca.Function:
    """Take in the measurements of one sample."""
    nx, nu, ny = _sizes(system)
    x, vP, X, vL = _symbols(nx)
    u, y = ca.SX.sym("u", nu), ca.SX.sym("y", ny)
    mask, here = ca.SX.sym("m", ny), ca.SX.sym("here")
    if isinstance(system, Varying):
        C, d = coefficients(system.s.model, outputs=True)(u)
    else:
        C, d = ca.SX(_sparse(system.C)), ca.mtimes(_sparse(system.D), u)
    e = y - ca.mtimes(C, x) - d
    H, e, R = masked(C, e, ca.SX(_sparse(system.s.R)), here * mask)
    P = unvech(vP)
    K, S = gain(P, H, R)
    HX = H @ X
    factor = cholesky_semidefinite(S)
    white = [forward(factor, c) for c in ca.horzsplit(ca.densify(ca.horzcat(HX, e)))]
    rows = ca.horzcat(*white)
    equations = compress(ca.horzcat(ca.tril(unvech(vL)), rows.T))
    return ca.Function(
        "absorb",
        [x, vP, X, vL, u, y, mask, here],
        [x + K @ e, vech(joseph(P, K, H, R)), ca.densify(X - K @ HX), vech(ca.densify(equations))],
    )


def _advance(system: Linear | Varying) -> ca.Function:
    """Go on to the next sample; before the first sample nothing moves.

    ``(x, P, X, L, u, u_next, before) -> (x, P, X, L)``.
    """
    nx, nu, _ = _sizes(system)
    state = _symbols(nx)
    u, u_next, before = ca.SX.sym("u", nu), ca.SX.sym("u_next", nu), ca.SX.sym("before")
    if isinstance(system, Linear):
        B, B_next = _sparse(system.B), _sparse(system.B_next)
        driven = ca.mtimes(B, u) + ca.mtimes(B_next, u_next)
        moved = _moved(state, before, ca.SX(_sparse(system.A)), driven, _sparse(system.s.Q))
        return ca.Function("advance", [*state, u, u_next, before], moved)
    A, b, Q = ca.SX.sym("A", nx, nx), ca.SX.sym("b", nx), ca.SX.sym("Q", nx, nx)
    by = ca.Function("advance_by", [*state, before, A, b, Q], _moved(state, before, A, b, Q))
    now = [ca.MX.sym(k, *v.shape) for k, v in zip("xPXL", state, strict=True)]
    u, u_next, before = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu), ca.MX.sym("before")
    ahead = by(*now, before, *system.transitions(u, u_next))
    return ca.Function("advance", [*now, u, u_next, before], list(ahead))


def _moved(
    state: list[ca.SX], before: ca.SX, A: ca.SX, driven: ca.SX, Q: ca.SX | ca.DM
) -> list[ca.SX]:
    """State, covariance, derivative and equations a sample later, or as they are."""
    x, vP, X, vL = state
    moved = [
        ca.mtimes(A, x) + driven,
        vech(ca.densify(A @ unvech(vP) @ A.T + Q)),
        ca.mtimes(A, X),
        vL,
    ]
    return [ca.densify(ca.if_else(before, m, o)) for m, o in zip(moved, state, strict=True)]


def _next(system: Linear | Varying) -> ca.Function:
    """Go on to the next sample and take it in."""
    nx, nu, ny = _sizes(system)
    carry = [ca.MX.sym(n, *s.shape) for n, s in zip("xPXL", _symbols(nx), strict=True)]
    data = [
        ca.MX.sym(n, k)
        for n, k in (("u", nu), ("v", nu), ("y", ny), ("m", ny), ("before", 1), ("here", 1))
    ]
    u, v, y, m, before, here = data
    ahead = _advance(system)(*carry, u, v, before)
    return ca.Function("next", [*carry, *data], list(_absorb(system)(*ahead, v, y, m, here)))


def _solve_start(nx: int) -> ca.Function:
    """Solve for the first state, and put it into the last one.

    ``(x, P, X, L, diffuse, x_start) -> (x, P, deficient, x_first, P_first)``.
    """
    x, vP, X, vL = _symbols(nx)
    diffuse, x_start = ca.SX.sym("diffuse"), ca.SX.sym("x_start", nx)
    L = ca.tril(unvech(vL))
    found = ca.SX(ca.densify(ca.horzcat(L[nx, :nx].T, ca.SX.eye(nx))))
    deficient = ca.SX(0)
    for i in reversed(range(nx)):
        for j in range(i + 1, nx):
            found[i, :] -= L[j, i] * found[j, :]
        small = L[i, i] <= NEGLIGIBLE * ca.norm_2(L[i, : i + 1])
        deficient = ca.if_else(small, 1, deficient)
        found[i, :] = ca.if_else(small, 0, found[i, :] / ca.if_else(small, 1, L[i, i]))
    first, inverse = found[:, 0], found[:, 1:]
    spread = X @ inverse
    return ca.Function(
        "solve_start",
        [x, vP, X, vL, diffuse, x_start],
        [
            x + X @ first,
            vech(unvech(vP) + spread @ spread.T),
            diffuse * deficient,
            x_start + first,
            vech(ca.densify(inverse @ inverse.T)),
        ],
    )


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))
