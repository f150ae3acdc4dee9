"""The pass through a window for many states: the same formulas as operations on matrices.

See `backsight.estimators.linear_windows._window_filter`; covariances are whole, and L has all its
entries.
"""

import casadi as ca
import numpy as np

from backsight.algebra.update import measured
from backsight.engine import dense
from backsight.engine.dense import few_entries
from backsight.engine.loops import smallest
from backsight.estimators.kalman.prediction import per_sample
from backsight.estimators.parts.covariance import (
    Covariance,
    congruence,
    corrected_covariance,
    matrix_product,
)
from backsight.estimators.parts.factors import cholesky, solve_lower
from backsight.estimators.parts.filtering import choose
from backsight.estimators.parts.linear import Linear, Varying
from backsight.models.lti import coefficients

NEGLIGIBLE = 1e-9
"""A pivot this small beside its row says that the window does not determine the direction."""


def dense_begin(system: Linear | Varying) -> ca.Function:
    """``(P, diffuse) -> (P, X, L)`` at the start of the window; P comes as its triangle."""
    nx = system.s.model.nx
    triangle, diffuse = ca.MX.sym("P", nx * (nx + 1) // 2), ca.MX.sym("diffuse")
    P = ca.reshape(Covariance(nx).of_triangle()(triangle), nx, nx)
    X = diffuse * ca.MX(ca.DM(np.eye(nx)))
    return ca.Function(
        "dense_begin", [triangle, diffuse], [(1 - diffuse) * P, X, ca.MX.zeros(nx + 1, nx + 1)]
    )


def dense_absorb(system: Linear | Varying) -> ca.Function:
    """Take in the measurements of one sample: ``(x, P, X, L, u, y, mask, here)``."""
    s = system.s
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, P, X, L = _carry(nx)
    u, y, mask = ca.MX.sym("u", nu), ca.MX.sym("y", ny), ca.MX.sym("mask", ny)
    here = ca.MX.sym("here")
    if isinstance(system, Varying):
        C, d = coefficients(s.model, outputs=True)(u)
        C = ca.densify(C)
    else:
        C, d = ca.MX(few_entries(system.C)), matrix_product(few_entries(system.D), u)
    weight = here * mask
    missed, seen = _seen(ny)(y - matrix_product(C, x) - d, weight)
    # The Kalman filter, as if the first state were known.
    now = corrected_covariance(P, C, s.R, weight)
    CX = matrix_product(C, X)
    # Its innovations, white, are equations for the first state.
    rows = dense.scaled_rows(ca.horzcat(CX, missed), weight)
    both = dense.product_of(weight, weight, turned=(False, True))
    S = now.S * both + dense.diagonal(1 - seen)
    white = solve_lower(cholesky(S), rows)
    equations = dense.compressed(ca.horzcat(L, dense.transpose(white)))
    X_next = dense.plus_product(X, now.K, CX, minus=True)
    return ca.Function(
        "dense_absorb",
        [x, P, X, L, u, y, mask, here],
        [x + matrix_product(now.K, missed), dense.symmetrise(now.P), X_next, equations],
    )


def dense_advance(system: Linear | Varying) -> ca.Function:
    """Go on to the next sample: ``(x, P, X, L, u, u_next, before)``; else nothing moves."""
    s = system.s
    nx, nu = s.model.nx, s.model.nu
    x, P, X, L = _carry(nx)
    u, v, before = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu), ca.MX.sym("before")
    if isinstance(system, Varying):
        A, b, Q = system.transitions(u, v)
        A = ca.densify(A)
    else:
        A, Q = ca.MX(few_entries(system.A)), ca.MX(per_sample(s, u))
        b = matrix_product(few_entries(system.B), u) + matrix_product(few_entries(system.B_next), v)
    moved = [
        matrix_product(A, x) + b,
        dense.symmetrise(congruence(A, P, Q)),
        matrix_product(A, X),
    ]
    return ca.Function(
        "dense_advance", [x, P, X, L, u, v, before], [*choose(before, moved, [x, P, X]), L]
    )


def dense_solve_start(system: Linear | Varying) -> ca.Function:
    """``(x, P, X, L, diffuse, x_start) -> (x, P, deficient, x_first, P_first)``, P as triangles."""
    nx = system.s.model.nx
    x, P, X, L = _carry(nx)
    diffuse, x_start = ca.MX.sym("diffuse"), ca.MX.sym("x_start", nx)
    factor, told = L[:nx, :nx], dense.transpose(L[nx, :nx])
    found = dense.solve_triangular(factor, ca.horzcat(told, ca.MX(ca.DM(np.eye(nx)))), turned=True)
    first, inverse = found[:, 0], found[:, 1:]
    spread = dense.product_of(X, inverse)
    rows = dense.product_of(factor * factor, ca.MX.ones(nx, 1))
    results = [
        x + dense.product_of(X, first),
        dense.triangle(dense.plus_product(P, spread, spread, turned=(False, True))),
        diffuse * _deficient(nx)(ca.diag(factor), rows),
        x_start + first,
        dense.triangle(dense.product_of(inverse, inverse, turned=(False, True))),
    ]
    return ca.Function("dense_solve_start", [x, P, X, L, diffuse, x_start], results)


def _carry(nx: int) -> list[ca.MX]:
    shapes = {"x": (nx, 1), "P": (nx, nx), "X": (nx, nx), "L": (nx + 1, nx + 1)}
    return [ca.MX.sym(name, *shape) for name, shape in shapes.items()]


def _seen(ny: int) -> ca.Function:
    """``(e, weight) -> (e, seen)``: residuals that were measured, and which these are."""
    e, weight = ca.SX.sym("e", ny), ca.SX.sym("weight", ny)
    seen = ca.densify(measured(weight))
    return ca.Function("seen", [e, weight], [seen * e, seen])


def _deficient(nx: int) -> ca.Function:
    """``(pivots, squares of rows) -> 1`` if a direction is not determined."""
    pivot, square, least = ca.MX.sym("pivot", nx), ca.MX.sym("square", nx), ca.SX.sym("least")
    lacks = ca.Function("lacks", [least], [ca.if_else(least <= 0, 1, 0)])
    left = smallest(pivot - NEGLIGIBLE * ca.sqrt(square))
    return ca.Function("deficient", [pivot, square], [lacks(left)])
