r"""The formulas of the two-filter smoother with the information itself, instead of its root.

What the measurements from a sample on tell of its state, as a matrix and a vector,

.. math:: J_k (x_k - \hat x_k^-) = \eta_k + \varepsilon_k, \qquad \varepsilon_k \sim N(0, J_k) :

with half the work of `two_filter`, and as accurate as long as the process noise does not drown what
is told, see `drowned`. Joseph's form keeps J positive semidefinite; process noise, prior and
information may be singular.

Source: Fraser and Potter, "The optimum linear smoother as a combination of two optimum linear
filters", 1969, doi:10.1109/TAC.1969.1099196.
"""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.estimators.parts.covariance import Term, congruence, matrix_product, transposed
from backsight.estimators.parts.factors import cholesky, solve_definite, solve_lower
from backsight.types import Array

DROWNED = 1e6
"""By how much the process noise of a sample may be larger than what is told of it, in variance:
the information left is a difference, of which rounding takes so many times its own size."""


def drowned(F: Array, H: Array, G: Array) -> bool:
    """Whether process noise drowns what the measurements ahead tell of it.

    Parameters
    ----------
    F, H, G : (nx, nx), (ny, nx), (nx, q) arrays
        Transition, outputs in units of their noise, and factor of the process noise.
    """
    J, nx = H.T @ H, len(F)
    for _ in range(min(nx, 10)):
        B = J @ G
        told = np.eye(G.shape[1]) + G.T @ B
        if not np.trace(told) < DROWNED * len(told):
            return True
        left = J - B @ np.linalg.solve(told, B.T)
        J = F.T @ left @ F + H.T @ H
    return False


def noise_passed(J: Term, eta: Term, G: Term | ca.DM) -> tuple[Term, Term]:
    r"""Information on the state before the process noise w = G n, n ~ N(0, I).

    With :math:`K = J G (I + G' J G)^{-1}` it is :math:`(I - K G') J (I - K G')' + K K'` and
    :math:`(I - K G') \eta`.
    """
    if not G.shape[1]:
        return J, eta
    B = matrix_product(J, G)
    D = matrix_product(transposed(B), G) + type(B)(ca.DM(np.eye(G.shape[1])))
    K = transposed(solve_definite(D, transposed(B)))
    left = J - matrix_product(K, transposed(B))
    rest = matrix_product(left, G) - K
    eta_before = eta - matrix_product(K, matrix_product(_turned(G), eta))
    return lower_half(left - matrix_product(rest, transposed(K))), eta_before


def carried_back(J: Term, eta: Term, F: Term | ca.DM) -> tuple[Term, Term]:
    """Information F' J F and F' eta on the state from which F led to the next one."""
    told = lower_half(congruence(_turned(F), J, ca.DM(*F.shape)))
    return told, matrix_product(_turned(F), eta)


def combined_with(x: Term, L: Term, J: Term, eta: Term) -> tuple[Term, Term]:
    r"""Estimate x with covariance L L', and what J (state - x) = eta tells: smoothed (x, T').

    With :math:`C C' = I + L' J L`: :math:`T' = C^{-1} L'` is the root of the smoothed covariance
    :math:`T T'`, and the estimate moves by :math:`T T' \eta`.
    """
    unit = ca.DM(np.eye(L.shape[1]))
    C = cholesky(congruence(transposed(L), J, unit))
    Tt = solve_lower(C, transposed(L))
    return x + matrix_product(transposed(Tt), matrix_product(Tt, eta)), Tt


def lower_half(A: Term) -> Term:
    """A symmetric matrix, of which straight-line code computes the lower half only."""
    return A if isinstance(A, ca.MX) else unvech(vech(ca.densify(A)))


def _turned(matrix: Term | ca.DM) -> Term | ca.DM:
    return matrix.T if isinstance(matrix, ca.DM) else transposed(matrix)
