"""The parts of a Gauss-Newton step for many unknowns, as operations on matrices.

See `backsight.solvers.box.gauss_newton`; the same functions with the same arguments.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np

from backsight.engine.dense import (
    cholesky_of,
    diagonal,
    plus_product,
    product_of,
    scaled_rows,
    solve_triangular,
    transpose,
    triangle,
    unpacked,
)


def dense_trial(nx: int) -> ca.Function:
    """Point after a step, ``(z, d, t, x_bar, L) -> (z, x)``."""
    z, d, t = ca.MX.sym("z", nx), ca.MX.sym("d", nx), ca.MX.sym("t")
    x_bar, L = ca.MX.sym("x_bar", nx), ca.MX.sym("L", nx, nx)
    z_try = z + t * d
    return ca.Function("dense_trial", [z, d, t, x_bar, L], [z_try, plus_product(x_bar, L, z_try)])


def dense_hessian(nx: int) -> ca.Function:
    """Hessian I + L' G L of the whole cost in z, ``(G, L) -> A``."""
    vG, L = ca.MX.sym("G", nx * (nx + 1) // 2), ca.MX.sym("L", nx, nx)
    half = product_of(L, unpacked(vG, nx), turned=(True, False))
    A = plus_product(ca.MX(ca.DM(np.eye(nx))), half, L)
    return ca.Function("dense_hessian", [vG, L], [triangle(A)])


def dense_step(nx: int, bounded: list[int]) -> ca.Function:
    """Gauss-Newton step without bounds, and what the bounds need: columns V, M = Sigma_bb."""
    z, x_bar, L = ca.MX.sym("z", nx), ca.MX.sym("x_bar", nx), ca.MX.sym("L", nx, nx)
    c, vA = ca.MX.sym("c", nx), ca.MX.sym("A", nx * (nx + 1) // 2)
    A = unpacked(vA, nx)
    factor = cholesky_of(A)
    right = plus_product(plus_product(-z, A, z), L, c, turned=(True, False))
    rows = _rows(L, bounded)
    both = ca.horzcat(right, transpose(rows)) if bounded else right
    solved = solve_triangular(factor, solve_triangular(factor, both), turned=True)
    z_free, V = solved[:, 0], solved[:, 1:]
    if not bounded:
        none = ca.MX(0, 1)
        return ca.Function("dense_step", [z, x_bar, L, c, vA], [z_free, ca.MX(nx, 0), none, none])
    x_free = x_bar[bounded] + product_of(rows, z_free)
    return ca.Function(
        "dense_step", [z, x_bar, L, c, vA], [z_free, V, triangle(product_of(rows, V)), x_free]
    )


def dense_covariance(nx: int) -> ca.Function:
    """Covariance L A^-1 L' of x, ``(A, L) -> Sigma``."""
    vA, L = ca.MX.sym("A", nx * (nx + 1) // 2), ca.MX.sym("L", nx, nx)
    W = solve_triangular(cholesky_of(unpacked(vA, nx)), transpose(L))
    return ca.Function(
        "dense_covariance", [vA, L], [triangle(product_of(W, W, turned=(True, False)))]
    )


def dense_held(nx: int, bounded: list[int]) -> ca.Function:
    """Covariance when the states at a bound are held there, ``(Sigma, side) -> Sigma``."""
    n = len(bounded)
    vSigma, side = ca.MX.sym("Sigma", nx * (nx + 1) // 2), ca.MX.sym("side", n)
    Sigma = unpacked(vSigma, nx)
    rows, active = _rows(Sigma, bounded), side * side
    both = product_of(active, active, turned=(False, True))
    system = rows[:, bounded] * both + diagonal(1 - active)
    W = solve_triangular(cholesky_of(system), scaled_rows(rows, active))
    left = plus_product(Sigma, W, W, turned=(True, False), minus=True)
    return ca.Function("dense_held", [vSigma, side], [triangle(left)])


def dense_products(k: Mapping[str, ca.MX]) -> tuple[ca.MX, ...]:
    """The step from the trial point, and L' c, L d, G L d, L (z_try - z), L z."""
    L, z, z_try, V = k["L"], k["z"], k["z_try"], k["V"]
    free = plus_product(k["z_free"], V, k["lam"]) if V.shape[1] else k["z_free"]
    d_try = free - z_try
    Ld = product_of(L, d_try)
    GLd = product_of(unpacked(k["G_try"], z.shape[0]), Ld)
    Lc = product_of(L, k["c"], turned=(True, False))
    return d_try, Lc, Ld, GLd, product_of(L, z_try - z), product_of(L, z)


def _rows(A: ca.MX, which: list[int]) -> ca.MX:
    """Some rows of a matrix."""
    return ca.vertcat(*(A[i, :] for i in which)) if which else ca.MX(0, A.shape[1])
