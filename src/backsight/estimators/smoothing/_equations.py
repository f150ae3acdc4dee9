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

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra import triangular
from backsight.engine import dense
from backsight.engine.dense import scaled_rows
from backsight.estimators.parts.covariance import Term, matrix_product, transposed
from backsight.estimators.parts.factors import compress_rows, on_top, solve_lower, with_fixed

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
    n, k = L.shape[0], A.shape[0]
    rows = [ca.horzcat(matrix_product(A, L), N), ca.horzcat(L, type(L).zeros(n, k))]
    both = compress_rows(ca.densify(on_top([ca.densify(row) for row in rows])))
    fixed = known_by(both[:k, :k], zeta, NOTHING * (1 + ca.norm_inf(x)))
    return x + matrix_product(both[k:, :k], fixed), transposed(both[k:, k:])


def joined(
    A: Term, N: Term, zeta: Term, *, H: Term, noise: Term, e: Term
) -> tuple[Term, Term, Term]:
    """(A, N, zeta) together with readings H (state - x) = e + noise epsilon of their own noise."""
    n, ny, zeros = A.shape[1], H.shape[0], type(A).zeros
    # 1. One size for all rows, so that a number says what is rounding.
    H, noise, e = of_size_one(H, noise, e)
    rows = [ca.horzcat(A, N, zeros(n, ny), zeta), ca.horzcat(H, zeros(ny, n), noise, e)]
    return _apart(rows, n, readings=ny, unknown=0)


@dataclasses.dataclass(frozen=True)
class FlatForce:
    """A force d in the equations A (state - x) + E d = zeta + N epsilon, and in readings.

    Parameters
    ----------
    E, F : (nx, m), (ny, m)
        Its columns in both.
    prior : (m, m)
        The equations ``prior d = epsilon`` of one that nothing else tells, else zero.
    """

    E: Term
    F: Term
    prior: Term


def joined_with_force(
    A: Term, N: Term, zeta: Term, *, H: Term, noise: Term, e: Term, d: FlatForce
) -> tuple[Term, Term, Term]:
    """`joined` with readings H (state - x) + F d = e + noise epsilon; whatever d is."""
    n, ny, m, zeros = A.shape[1], H.shape[0], d.prior.shape[0], type(A).zeros
    F_H, noise, e = of_size_one(ca.horzcat(d.F, H), noise, e)
    rows = [
        ca.horzcat(d.E, A, N, zeros(n, ny + m), zeta),
        ca.horzcat(F_H, zeros(ny, n), noise, zeros(ny, m), e),
        ca.horzcat(d.prior, zeros(m, n + n + ny), type(A)(ca.DM.eye(m)), zeros(m, 1)),
    ]
    return _apart(rows, n, readings=ny, unknown=m)


def without_force(A: Term, N: Term, zeta: Term, *, E: Term, prior: Term) -> tuple[Term, Term, Term]:
    """What A (state - x) + E d = zeta + N epsilon tells of the state whatever d is."""
    n, m, zeros = A.shape[1], E.shape[1], type(A).zeros
    rows = [
        ca.horzcat(E, A, N, zeros(n, m), zeta),
        ca.horzcat(prior, zeros(m, n + n), type(A)(ca.DM.eye(m)), zeros(m, 1)),
    ]
    return _apart(rows, n, readings=0, unknown=m)


def _apart(rows: list[Term], n: int, *, readings: int, unknown: int) -> tuple[Term, Term, Term]:
    """(A, N, zeta) of the state, which has n columns behind those that are `unknown`."""
    rest = turned(on_top([ca.densify(row) for row in rows]), unknown + n)
    kept = rest[unknown : unknown + n, unknown:]
    told = rest[unknown + n : unknown + n + readings, unknown:]
    # 2. The rows that are left tell of the noise only, of that of the others, too.
    noise, zeta = kept[:, n:-1], kept[:, -1]
    if readings:
        size = ca.SX.sym("told", *told[:, n:].shape)
        V, y, _ = triangular.fixed_directions(size[:, :-1], size[:, -1], least=NOTHING)
        fixed = ca.Function("fixed_noise", [size], [V, ca.densify(y)])
        noise, moved = with_fixed(ca.densify(noise), 0 * zeta, *fixed(ca.densify(told[:, n:])))
        zeta = zeta - moved
    return of_size_one(kept[:, :n], compress_rows(ca.densify(noise)), zeta)


def turned(rows: Term, n: int) -> Term:
    """The same rows after an orthogonal transformation that makes n columns upper triangular."""
    if not isinstance(rows, ca.MX):
        return triangular.upper_triangular(rows[:, :n], rows)
    # The triangular factor of all columns has that of the first n in its first n rows.
    factor = dense.compressed(dense.transpose(ca.densify(rows)))
    return dense.transpose(factor)[: rows.shape[0], :]


def known_by(L: Term, b: Term, least: Term | float) -> Term:
    """`triangular.forward_semidefinite`, for many states, too."""
    if not isinstance(L, ca.MX):
        return triangular.forward_semidefinite(L, b, least=least)
    pivots, right, size = ca.SX.sym("L", b.numel()), ca.SX.sym("b", b.numel()), ca.SX.sym("least")
    tell = ca.if_else(pivots > size, 1, 0)
    told = ca.Function("telling_rows", [pivots, right, size], [tell, tell * right])
    keep, right = told(ca.diag(L), b, least)
    return solve_lower(scaled_rows(ca.densify(L), keep) + dense.diagonal(1 - keep), right)


def of_size_one(A: Term, N: Term, zeta: Term) -> tuple[Term, Term, Term]:
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
