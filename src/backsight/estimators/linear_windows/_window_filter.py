"""Least squares over a window with missing samples, as one pass from sample to sample.

A Kalman filter runs through the window as if the first state were known; beside it goes the
derivative of its state by that first state, and the innovations become equations for it. The
result is the least-squares estimate with nothing known before the window; neither the transition
matrix nor the process noise is ever inverted. After de Jong, "The diffuse Kalman filter", 1991,
doi:10.1214/aos/1176348139.
"""

import casadi as ca

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.triangular import compress, forward
from backsight.algebra.update import gain, joseph, masked
from backsight.engine.loops import scan
from backsight.estimators.kalman.prediction import per_sample
from backsight.estimators.linear_windows._window_filter_dense import (
    NEGLIGIBLE,
    dense_absorb,
    dense_advance,
    dense_begin,
    dense_solve_start,
)
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.leaf import Results, Size, Symmetric, leaf, notation
from backsight.estimators.parts.linear import Linear, Varying
from backsight.models.lti import coefficients
from backsight.types import Array


def window_filter(system: Linear | Varying, N: int) -> ca.Function:
    """``(x, P, diffuse, U, Y, M, present) -> (x, P, deficient, x_first, P_first)``.

    x and P (lower triangle) describe the start of the window, the results its end. With
    ``diffuse = 1`` nothing is known of the start, ``deficient`` is 1 if the measurements do not
    determine it, and ``x_first, P_first`` are what they say of it. Samples with ``present = 0`` do
    not exist; they come first.
    """
    nx, nu, ny = system.s.model.nx, system.s.model.nu, system.s.model.ny
    x, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    diffuse = ca.MX.sym("diffuse")
    U, Y, M = (ca.MX.sym(n, k, N + 1) for n, k in (("U", nu), ("Y", ny), ("M", ny)))
    present = ca.MX.sym("present", 1, N + 1)
    many = Covariance(nx).whole
    begin = dense_begin(system) if many else _begin(system)
    absorb = dense_absorb(system) if many else _absorb(system)
    advance = dense_advance(system) if many else _advance(system)
    solve_start = dense_solve_start(system) if many else _solve_start(system)
    absorbed = absorb(x, *begin(vP, diffuse), U[:, 0], Y[:, 0], M[:, 0], present[0])
    carry, _ = scan(
        _next(absorb, advance),
        N,
        carry=list(absorbed),
        xs=[U[:, :-1], U[:, 1:], Y[:, 1:], M[:, 1:], present[:, :-1], present[:, 1:]],
    )
    results = solve_start(*carry, diffuse, x)
    return ca.Function("window_filter", [x, vP, diffuse, U, Y, M, present], list(results))


def _sizes(system: Linear | Varying) -> dict[str, Size]:
    """Those of the notation; X, derivative of the state by the first one; L, equations for it."""
    nx = system.s.model.nx
    return {**notation(system.s), "X": (nx, nx), "L": Symmetric(nx + 1), "diffuse": 1, "here": 1}


def _begin(system: Linear | Varying) -> ca.Function:
    """``(P, diffuse) -> (P, X, L)`` at the start of the window."""
    nx = system.s.model.nx

    def formula(P: ca.SX, diffuse: ca.SX) -> Results:
        X, L = diffuse * ca.SX.eye(nx), ca.SX.zeros(nx + 1, nx + 1)
        return {"P": (1 - diffuse) * P, "X": ca.densify(X), "L": L}

    return leaf("begin", _sizes(system), formula)


def _absorb(system: Linear | Varying) -> ca.Function:
    """Take in the measurements of one sample."""
    R_all = ca.SX(_sparse(system.s.R))

    def formula(
        x: ca.SX, P: ca.SX, X: ca.SX, L: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX, here: ca.SX
    ) -> Results:
        # The Kalman filter, as if the first state were known.
        if isinstance(system, Varying):
            C, d = coefficients(system.s.model, outputs=True)(u)
        else:
            C, d = ca.SX(_sparse(system.C)), ca.mtimes(_sparse(system.D), u)
        e = y - ca.mtimes(C, x) - d
        H, e, R = masked(C, e, R_all, here * mask)
        K, S = gain(P, H, R)
        # Its innovations, white, are equations for the first state.
        HX = H @ X
        factor = cholesky_semidefinite(S)
        white = [forward(factor, c) for c in ca.horzsplit(ca.densify(ca.horzcat(HX, e)))]
        equations = compress(ca.horzcat(ca.tril(L), ca.horzcat(*white).T))
        return {
            "x": x + K @ e,
            "P": joseph(P, K, H, R),
            "X": ca.densify(X - K @ HX),
            "L": ca.densify(equations),
        }

    return leaf("absorb", _sizes(system), formula)


def _advance(system: Linear | Varying) -> ca.Function:
    """Go on to the next sample; before the first sample nothing moves."""
    if isinstance(system, Varying):
        return _advance_varying(system)
    A, B, B_next = _sparse(system.A), _sparse(system.B), _sparse(system.B_next)

    def formula(
        x: ca.SX, P: ca.SX, X: ca.SX, L: ca.SX, u: ca.SX, u_next: ca.SX, before: ca.SX
    ) -> Results:
        Q = ca.sparsify(per_sample(system.s, u))
        ahead = ca.mtimes(A, x) + ca.mtimes(B, u) + ca.mtimes(B_next, u_next)
        return {
            "x": ca.if_else(before, ahead, x),
            "P": ca.if_else(before, ca.densify(A @ P @ A.T + Q), P),
            "X": ca.densify(ca.if_else(before, ca.mtimes(A, X), X)),
            "L": L,
        }

    return leaf("advance", {**_sizes(system), "before": 1}, formula)


def _advance_varying(system: Varying) -> ca.Function:
    """The same with the matrices of this sample."""
    nx, nu = system.s.model.nx, system.s.model.nu

    def formula(
        x: ca.SX, P: ca.SX, X: ca.SX, L: ca.SX, before: ca.SX, F: ca.SX, b: ca.SX, noise: ca.SX
    ) -> Results:
        return {
            "x": ca.if_else(before, ca.mtimes(F, x) + b, x),
            "P": ca.if_else(before, ca.densify(F @ P @ F.T + noise), P),
            "X": ca.densify(ca.if_else(before, ca.mtimes(F, X), X)),
            "L": L,
        }

    sizes = {**_sizes(system), "before": 1, "b": nx, "noise": (nx, nx)}
    by = leaf("advance_by", sizes, formula)
    carry = [ca.MX.sym(n, *by.size_in(k)) for k, n in enumerate(("x", "P", "X", "L"))]
    u, v, before = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu), ca.MX.sym("before")
    ahead = by(*carry, before, *system.transitions(u, v))
    return ca.Function("advance", [*carry, u, v, before], list(ahead))


def _next(absorb: ca.Function, advance: ca.Function) -> ca.Function:
    """Go on to the next sample and take it in."""
    names = ("x", "P", "X", "L", "u", "v", "y", "m", "before", "here")
    sizes = [absorb.size_in(k) for k in (0, 1, 2, 3, 4, 4, 5, 6, 7, 7)]
    every = [ca.MX.sym(n, *size) for n, size in zip(names, sizes, strict=True)]
    *carry, u, v, y, m, before, here = every
    ahead = advance(*carry, u, v, before)
    return ca.Function("next", every, list(absorb(*ahead, v, y, m, here)))


def _solve_start(system: Linear | Varying) -> ca.Function:
    """Solve for the first state, and put it into the last one.

    ``(x, P, X, L, diffuse, x_start) -> (x, P, deficient, x_first, P_first)``.
    """
    nx = system.s.model.nx

    def formula(x: ca.SX, P: ca.SX, X: ca.SX, L: ca.SX, diffuse: ca.SX, x_start: ca.SX) -> Results:
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
        return {
            "x": x + X @ first,
            "P": P + spread @ spread.T,
            "deficient": diffuse * deficient,
            "x_first": x_start + first,
            "P_first": ca.densify(inverse @ inverse.T),
        }

    return leaf("solve_start", _sizes(system), formula)


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))
