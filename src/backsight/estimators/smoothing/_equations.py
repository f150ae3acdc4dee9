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

from backsight.algebra.triangular import compress, forward_semidefinite, upper_triangular

NOTHING = 1e-13
"""Noise below this share of an equation is rounding: the equation is one that is known already."""


def through_noise(A: ca.SX, N: ca.SX, G: ca.SX) -> ca.SX:
    """N of the equations A on the state before the process noise w = G n, n ~ N(0, I)."""
    return compress(ca.densify(ca.horzcat(A @ G, N)))


def estimated(x: ca.SX, L: ca.SX, A: ca.SX, N: ca.SX, zeta: ca.SX) -> tuple[ca.SX, ca.SX]:
    r"""Estimate x with covariance L L', given A (state - x) = zeta + N epsilon: smoothed (x, T').

    An orthogonal transformation of the noises z and epsilon, with state = x + L z,

    .. math::
        \begin{bmatrix} A L & N \\ L & 0 \end{bmatrix} \to
        \begin{bmatrix} C & 0 \\ X & T \end{bmatrix},

    leaves those that the equations fix, C y = zeta, and those that they leave open.
    """
    n = L.shape[0]
    rows = ca.vertcat(ca.horzcat(A @ L, N), ca.horzcat(L, ca.SX.zeros(n, n)))
    both = compress(ca.densify(rows))
    fixed = forward_semidefinite(both[:n, :n], zeta, least=NOTHING * (1 + ca.norm_inf(x)))
    return x + both[n:, :n] @ fixed, both[n:, n:].T


def joined(
    A: ca.SX, N: ca.SX, zeta: ca.SX, *, H: ca.SX, noise: ca.SX, e: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(A, N, zeta) together with readings H (state - x) = e + noise epsilon of their own noise."""
    n, ny = A.shape[1], H.shape[0]
    # 1. One size for all rows, so that a number says what is rounding.
    H, noise, e = _of_size_one(H, noise, e)
    # 2. The state out of as many rows as there are readings, by a transformation of the rows.
    apart = ca.diagcat(N, noise)
    both = ca.vertcat(A, H)
    rest = upper_triangular(both, ca.horzcat(both, apart, ca.vertcat(zeta, e)))
    kept, told = rest[:n, :], rest[n:, :]
    # 3. These rows tell of the noise only, and of that of the others what both have in common.
    split = compress(ca.vertcat(told[:, n:-1], kept[:, n:-1]))
    known = forward_semidefinite(split[:ny, :ny], told[:, -1], least=NOTHING)
    zeta = kept[:, -1] - split[ny:, :ny] @ known
    return _of_size_one(kept[:, :n], split[ny:, ny:], zeta)


def _of_size_one(A: ca.SX, N: ca.SX, zeta: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The same equations, each divided by the size of its row [A, N]."""
    sizes = [ca.norm_2(row) for row in ca.vertsplit(ca.densify(ca.horzcat(A, N)))]
    by = ca.diag(ca.vertcat(*(1 / ca.if_else(size > 0, size, 1) for size in sizes)))
    return by @ A, by @ N, by @ zeta
