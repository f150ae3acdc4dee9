r"""The formulas of the two-filter smoother in square-root form.

A filter goes forward as ever. Another goes from the last sample back and gathers what the
measurements ahead tell of the state, as a square root of information: equations

.. math:: U_k' (x_k - \hat x_k^-) = \zeta_k + \varepsilon_k, \qquad \varepsilon_k \sim N(0, I),

with lower triangular U. It begins with U = 0: there is nothing ahead of the last sample. The
equations are about deviations from the forward filter's own estimates, so that nothing large
cancels. Nothing is subtracted from a covariance and none is inverted: Q, P and the information
ahead may be singular.

Source: Fraser and Potter, "The optimum linear smoother as a combination of two optimum linear
filters", 1969, doi:10.1109/TAC.1969.1099196; the square root of information back in time as in
Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapter X.
"""

import casadi as ca
import numpy as np

from backsight.estimators.parts.covariance import Term, matrix_product, transposed
from backsight.estimators.parts.factors import compress_rows, solve_lower

SHARPEST = 1e-15
"""Standard deviation of rounding, in the scale of a state, see `blurred`."""


def weakened(U: Term, zeta: Term, G: Term) -> tuple[Term, Term]:
    r"""Information on the state before the process noise w = G n, n ~ N(0, I): (V', zeta).

    With :math:`C C' = I + U' G G' U`: :math:`V' = C^{-1} U'`, and the right side
    :math:`C^{-1} \zeta`. This is :math:`J (I + Q J)^{-1}` for the information J = U U'.
    """
    C = compress_rows(ca.horzcat(_eye(U, U.shape[0]), matrix_product(transposed(U), G)))
    return solve_lower(C, transposed(U)), solve_lower(C, zeta)


def blurred(G: Term) -> Term:
    """Factor of the process noise with that of rounding.

    For motions that may be unstable: without noise, what is known of them would grow without limit
    on the way back.
    """
    return ca.horzcat(G, SHARPEST * _eye(G, G.shape[0]))


def combined(x: Term, L: Term, Vt: Term, zeta: Term) -> tuple[Term, Term]:
    r"""Estimate x with covariance L L', and what V' (state - x) = zeta tells: smoothed (x, T').

    With :math:`M = V' L` and :math:`C C' = I + M' M`: :math:`T' = C^{-1} L'` is the root of the
    smoothed covariance :math:`T T'`, and the estimate moves by :math:`T C^{-1} M' \zeta`.
    """
    M = matrix_product(Vt, L)
    C = compress_rows(ca.horzcat(_eye(L, L.shape[1]), transposed(M)))
    Tt = solve_lower(C, transposed(L))
    step = solve_lower(C, matrix_product(transposed(M), zeta))
    return x + matrix_product(transposed(Tt), step), Tt


def gathered(information: Term) -> Term:
    """Lower triangle with the information of many equations, one a column.

    The last row has their right sides, and has them after: an orthogonal transformation.
    """
    return compress_rows(information)


def _eye(like: Term, n: int) -> Term:
    return type(like)(ca.DM(np.eye(n)))
