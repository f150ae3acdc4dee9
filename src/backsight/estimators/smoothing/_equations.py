r"""The formulas of the two-filter smoother for exact sensors: equations.

An exact reading is information without limit, of which there is no matrix. So what the measurements
from a sample on tell of its state is kept as equations with the factor of their noise, as many as
there are states,

.. math:: A_k (x_k - \hat x_k^-) = \zeta_k + N_k \varepsilon_k, \qquad \varepsilon_k \sim N(0, I),

where N may be singular: an equation without noise is a row of N that is zero. It begins with A = 0
and N = I, which says nothing. Equations are joined by orthogonal transformations only, of the rows
and of the noise; nothing is inverted, or subtracted from a covariance, so that a variance that is
zero comes out as zero. What a sensor tells twice, of which there would be two equations, the pass
forward leaves out, see `backsight.estimators.kalman.exact_sensors`.

Source: Paige and Saunders, "Least squares estimation of discrete linear dynamic systems using
orthogonal transformations", SIAM Journal on Numerical Analysis 14 (1977), doi:10.1137/0714012; the
generalised least squares in each step: Paige, "Computer solution and perturbation analysis of
generalized linear least squares problems", Mathematics of Computation 33 (1979),
doi:10.1090/S0025-5718-1979-0514820-3.
"""

import casadi as ca
import numpy as np

from backsight.algebra import triangular
from backsight.engine import dense
from backsight.engine.dense import scaled_rows
from backsight.estimators.parts.covariance import Term, matrix_product, transposed
from backsight.estimators.parts.factors import compress_rows, on_top, solve_lower

NOTHING = 1e-13
"""Noise below this share of an equation is rounding: the equation is one that is known already."""


def through_noise(A: Term, N: Term, G: Term) -> Term:
    """N of the equations A on the state before the process noise w = G n, n ~ N(0, I)."""
    return compress_rows(ca.densify(ca.horzcat(matrix_product(A, G), N)))


def estimated(x: Term, L: Term, A: Term, N: Term, zeta: Term) -> tuple[Term, Term]:
    r"""Estimate x with covariance L L', given A (state - x) = zeta + N epsilon: smoothed (x, T').

    An orthogonal transformation of the noises z and epsilon, with state = x + L z,

    .. math::
        \begin{bmatrix} A L & N \\ L & 0 \end{bmatrix} \to
        \begin{bmatrix} C & 0 \\ X & T \end{bmatrix},

    leaves those that the equations fix, C y = zeta, and those that they leave open.
    """
    n = L.shape[0]
    rows = [ca.horzcat(matrix_product(A, L), N), ca.horzcat(L, type(L).zeros(n, n))]
    both = compress_rows(ca.densify(on_top([ca.densify(k) for k in rows])))
    fixed = _known(both[:n, :n], zeta, NOTHING * (1 + ca.norm_inf(x)))
    return x + matrix_product(both[n:, :n], fixed), transposed(both[n:, n:])


def joined(
    A: Term, N: Term, zeta: Term, *, H: Term, noise: Term, e: Term
) -> tuple[Term, Term, Term]:
    """(A, N, zeta) together with readings H (state - x) = e + noise epsilon of their own noise."""
    n, ny, zeros = A.shape[1], H.shape[0], type(A).zeros
    # 1. One size for all rows, so that a number says what is rounding.
    H, noise, e = _of_size_one(H, noise, e)
    # 2. The state out of as many rows as there are readings, by a transformation of the rows.
    before, now = ca.horzcat(A, N, zeros(n, ny), zeta), ca.horzcat(H, zeros(ny, n), noise, e)
    rest = _turned(on_top([ca.densify(before), ca.densify(now)]), n)
    kept, told = rest[:n, :], rest[n : n + ny, :]
    # 3. These rows tell of the noise only, and of that of the others what both have in common.
    split = compress_rows(on_top([ca.densify(told[:, n:-1]), ca.densify(kept[:, n:-1])]))
    known = _known(split[:ny, :ny], told[:, -1], NOTHING)
    zeta = kept[:, -1] - matrix_product(split[ny:, :ny], known)
    return _of_size_one(kept[:, :n], split[ny:, ny:], zeta)


def _turned(rows: Term, n: int) -> Term:
    """The same rows after an orthogonal transformation that makes n columns upper triangular."""
    if not isinstance(rows, ca.MX):
        return triangular.upper_triangular(rows[:, :n], rows)
    # The triangular factor of all columns has that of the first n in its first n rows.
    factor = dense.compressed(dense.transpose(ca.densify(rows)))
    return dense.transpose(factor)[: rows.shape[0], :]


def _known(L: Term, b: Term, least: Term | float) -> Term:
    """`triangular.forward_semidefinite`, for many states, too."""
    if not isinstance(L, ca.MX):
        return triangular.forward_semidefinite(L, b, least=least)
    pivots, right, size = ca.SX.sym("L", b.numel()), ca.SX.sym("b", b.numel()), ca.SX.sym("least")
    tell = ca.if_else(pivots > size, 1, 0)
    told = ca.Function("telling_rows", [pivots, right, size], [tell, tell * right])
    keep, right = told(ca.diag(L), b, least)
    return solve_lower(scaled_rows(ca.densify(L), keep) + dense.diagonal(1 - keep), right)


def _of_size_one(A: Term, N: Term, zeta: Term) -> tuple[Term, Term, Term]:
    """The same equations, each divided by the size of its row [A, N]."""
    rows = ca.densify(ca.horzcat(A, N))
    if isinstance(rows, ca.MX):
        squares = matrix_product(rows * rows, ca.MX(ca.DM(np.ones((rows.shape[1], 1)))))
        size = ca.SX.sym("square", rows.shape[0])
        by = ca.Function("by_size", [size], [1 / ca.sqrt(ca.if_else(size > 0, size, 1))])(squares)
        return scaled_rows(ca.densify(A), by), scaled_rows(ca.densify(N), by), by * zeta
    sizes = [ca.norm_2(row) for row in ca.vertsplit(rows)]
    by = ca.diag(ca.vertcat(*(1 / ca.if_else(size > 0, size, 1) for size in sizes)))
    return by @ A, by @ N, by @ zeta
