"""Triangular factors of covariances: straight-line code for few states, loops for many.

The functions take SX and are then those of `backsight.algebra`, or MX. In the loops a pass takes
one row after the other by its unit vector, so that no matrix has to be shifted.
"""

import dataclasses
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from backsight.algebra import sigma, triangular
from backsight.algebra.factor import (
    cholesky_semidefinite,
    smallest_pivot,
    solve_ldl,
    solve_spd,
)
from backsight.algebra.sigma import Weights
from backsight.algebra.symmetric import vech
from backsight.engine.dense import VECTOR, add_product, transpose
from backsight.engine.loops import scan
from backsight.estimators.parts.covariance import Covariance, Term, packed
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Factor:
    """How the lower factor of a covariance is kept, and 1 behind it if a prediction had none.

    Parameters
    ----------
    like : Covariance
    """

    like: Covariance

    @property
    def size(self) -> int:
        """How many numbers are kept."""
        return self.like.size + 1

    def of(self, L: Array) -> Array:
        """A factor in numbers as it is kept, without the last entry."""
        return L.ravel(order="F") if self.like.whole else packed(L)

    def spread(self, P: Array) -> Array:
        """The factor of a covariance in numbers as it is kept, (`size`,)."""
        return np.append(self.of(cholesky_factor(P)), 0.0)

    def opened(self, spread: Term) -> Term:
        """The factor (n, n)."""
        L = self.like.opened(spread[:-1])
        return L if self.like.whole else ca.tril(L)

    def closed(self, L: Term) -> Term:
        """A factor (n, n) as it is kept, without the last entry."""
        return ca.vec(L) if self.like.whole else vech(ca.densify(L))


def cholesky_factor(P: Array) -> Array:
    """Lower factor of a positive semidefinite matrix in numbers."""
    A = ca.MX(ca.DM(P)) if Covariance(len(P)).whole else ca.SX(ca.DM(P))
    return np.asarray(ca.evalf(ca.densify(cholesky(A))))


def each_column(function: ca.Function, X: Term, *constants: Term) -> list[Term]:
    """Apply a function to every column; its results side by side."""
    if isinstance(X, ca.MX):
        return list(scan(function, X.shape[1], carry=[], xs=[X], constants=constants)[1])
    results = [function.call([X[:, i], *constants]) for i in range(X.shape[1])]
    return [ca.horzcat(*values) for values in zip(*results, strict=True)]


def cholesky(A: Term) -> Term:
    """Lower factor of a positive semidefinite A, see `cholesky_semidefinite`."""
    if not isinstance(A, ca.MX):
        return cholesky_semidefinite(A)
    n = A.shape[0]
    left, unit = ca.MX.sym("A", n, n), ca.MX.sym("unit", n)
    below, size = ca.MX.sym("below", n), ca.MX.sym("size")
    c, e, b, a = ca.SX.sym("c", n), ca.SX.sym("e", n), ca.SX.sym("b", n), ca.SX.sym("a")
    pivot = ca.dot(e, c)
    keep = pivot > 1e-14 * a
    found = b * ca.if_else(keep, c / ca.sqrt(ca.if_else(keep, pivot, 1)), 0)
    column = ca.Function("column", [c, e, b, a], [found])
    new = column(add_product(ca.MX.zeros(n, 1), left, unit.T), unit, below, size)
    inputs = [left, unit, below, size]
    body = ca.Function("cholesky_column", inputs, [add_product(left, -new, new), new])
    diagonal = ca.diag(A).T
    _, (L,) = scan(body, n, carry=[A], xs=[*_places(n), diagonal])
    return L


def definite(A: Term) -> Term:
    """1 if a symmetric matrix is positive definite."""
    if not isinstance(A, ca.MX):
        return smallest_pivot(A) > 0
    return ca.mmin(ca.diag(cholesky(A))) > 0


def solve_definite(A: Term, B: Term) -> Term:
    """Solve A X = B for symmetric positive definite A; what is put out for others is worthless."""
    if not isinstance(A, ca.MX):
        return solve_spd(A, B)
    n = A.shape[0]
    factor, b = ca.SX.sym("L", n, n), ca.SX.sym("b", n)
    size = ca.diag(factor)
    d = ca.if_else(size > 0, size, 1)
    unit = ca.tril(factor) @ ca.diag(1 / d)
    column = ca.Function("solve_column", [b, factor], [solve_ldl(unit, d**2, b)])
    return each_column(column, B, cholesky(A))[0]


def solve_lower(L: Term, B: Term) -> Term:
    """Solve L X = B for lower triangular L, see `backsight.algebra.triangular.forward`."""
    return _by_factor(triangular.forward, L, B)


def solve_upper_semidefinite(L: Term, B: Term) -> Term:
    """Solve L' X = B, see `backsight.algebra.triangular.backward_semidefinite`."""
    return _by_factor(triangular.backward_semidefinite, L, B)


def _by_factor(solve: Callable[[ca.SX, ca.SX], ca.SX], L: Term, B: Term) -> Term:
    if not isinstance(L, ca.MX):
        return solve(L, B)
    n = L.shape[0]
    factor, b = ca.SX.sym("L", n, n), ca.SX.sym("b", n)
    column = ca.Function(f"{solve.__name__}_column", [b, factor], [solve(factor, b)])
    return each_column(column, ca.densify(B), L)[0]


def compress_rows(A: Term) -> Term:
    """Lower triangular L with L L' = A A', see `backsight.algebra.triangular.compress`."""
    if not isinstance(A, ca.MX):
        return triangular.compress(A)
    n, m = A.shape
    # Both ways round: a row is picked from one and multiplied by the other, nothing is turned.
    left, turned = ca.MX.sym("rows", n, m), ca.MX.sym("turned", m, n)
    unit, below = ca.MX.sym("unit", n), ca.MX.sym("below", n)
    row = ca.SX.sym("row", m)
    size = ca.norm_2(row)
    normed = ca.Function("direction", [row], [row / ca.if_else(size > 0, size, 1)])
    d = normed(add_product(ca.MX.zeros(m, 1), turned, unit.T))
    along = add_product(ca.MX.zeros(n, 1), left, d.T)
    after = [add_product(left, -along, d), add_product(turned, d, -along)]
    body = ca.Function("gram_schmidt", [left, turned, unit, below], [*after, below * along])
    _, (L,) = scan(body, n, carry=[A, transpose(A)], xs=_places(n))
    return L


def downdate_factor(L: Term, v: Term) -> tuple[Term, Term]:
    """Factor of L L' - v v' and whether there is one, see `backsight.algebra.triangular`."""
    if not isinstance(L, ca.MX):
        return triangular.downdate(L, v)
    n = L.shape[0]
    w, definite = ca.SX.sym("v", n), ca.SX.sym("definite")
    c, e, b = ca.SX.sym("c", n), ca.SX.sym("e", n), ca.SX.sym("b", n)
    old, top = ca.dot(e, c), ca.dot(e, w)
    square = old**2 - top**2
    positive = square > 0
    pivot = ca.sqrt(ca.if_else(positive, square, old**2))
    under = b - e
    column = e * pivot + under * (c * old - w * top) / pivot
    rest = under * (w * old - c * top) / pivot
    body = ca.Function(
        "hyperbolic", [w, definite, c, e, b], [rest, ca.if_else(positive, definite, 0), column]
    )
    (_, all_definite), (found,) = scan(body, n, carry=[v, ca.MX(1)], xs=[L, *_places(n)])
    return found, all_definite


def deviation_factor(deviations: Term, w: Weights, noise: Term) -> tuple[Term, Term]:
    """Factor of the covariance of weighted deviations plus noise, see `algebra.sigma.factor`."""
    if not isinstance(deviations, ca.MX):
        return sigma.factor(deviations, w, noise)
    n, count = deviations.shape
    centre = float(w.covariance[0])
    scales = np.sqrt(np.append(abs(centre), w.covariance[1:]))
    weighted = deviations * ca.MX(ca.DM(np.tile(scales, (n, 1))))
    if centre >= 0:
        return compress_rows(ca.horzcat(weighted, noise)), ca.MX(1)
    return downdate_factor(compress_rows(ca.horzcat(weighted[:, 1:count], noise)), weighted[:, 0])


def joint_factor(Y: Term, L: Term, w: Weights, noise: Term) -> tuple[Term, Term]:
    r"""Lower factor of outputs and states together, and 1 if it is definite.

    The states of a pair of sigma points are opposite. With :math:`a_j, b_j` the outputs of a pair
    and :math:`2 w s^2 = 1` the weighted deviations turn, by :math:`(a_j \mp b_j) / \sqrt 2`, into

    .. math:: \begin{bmatrix} \sqrt{w / 2} (a_j - b_j) & \sqrt{w / 2} (a_j + b_j) & \sqrt{w_0} d_0 &
        \text{noise} \\ L & 0 & 0 & 0 \end{bmatrix}

    and what only the outputs have is a factor of theirs.

    Parameters
    ----------
    Y : (ny, 2 n + 1)
        Outputs of the sigma points minus their mean.
    L : (n, n)
        Lower factor of the states, of which they are made.
    w : Weights
    noise : (ny, ny)
        Factor of the covariance that is added to the outputs.
    """
    n, ny = L.shape[0], Y.shape[0]
    scale, centre = np.sqrt(w.covariance[1] / 2), float(w.covariance[0])
    a, b, middle = Y[:, 1 : n + 1], Y[:, n + 1 :], np.sqrt(abs(centre)) * Y[:, 0]
    rest = [scale * (a + b), noise, *([middle] if centre >= 0 else [])]
    alone = _few_rows(ca.horzcat(*rest))
    joint = compress_rows(
        on_top([ca.horzcat(scale * (a - b), alone), ca.horzcat(L, type(L).zeros(n, ny))])
    )
    if centre >= 0:
        return joint, type(L)(1)
    return downdate_factor(joint, ca.vertcat(middle, type(L).zeros(n, 1)))


def _few_rows(A: Term) -> Term:
    """`compress_rows`, straight-line for a few rows however many states there are."""
    if not isinstance(A, ca.MX) or A.shape[0] > VECTOR:
        return compress_rows(A)
    rows = ca.SX.sym("rows", *A.shape)
    return ca.Function("compress", [rows], [ca.densify(triangular.compress(rows))])(A)


def sigma_columns(x: Term, L: Term, spread: float) -> Term:
    """Sigma points side by side, see `backsight.algebra.sigma.sigma_points`."""
    if not isinstance(x, ca.MX):
        return sigma.sigma_points(x, L, spread)
    ones = ca.MX.ones(x.numel(), 1)
    return ca.horzcat(x, add_product(spread * L, x, ones), add_product(-spread * L, x, ones))


def minus(X: Term, x: Term) -> Term:
    """Columns of X minus x."""
    if isinstance(X, ca.MX):
        return add_product(X, -x, ca.MX.ones(X.shape[1], 1))
    return X - x


def on_top(parts: Sequence[Term]) -> Term:
    """Matrices of as many columns on top of each other."""
    if isinstance(parts[0], ca.MX):
        return transpose(ca.horzcat(*(transpose(part) for part in parts)))
    return ca.vertcat(*parts)


def _places(n: int) -> list[ca.MX]:
    """Unit vectors, and ones from there on down, one column for every pass."""
    return [ca.MX(ca.DM(np.eye(n))), ca.MX(ca.DM(np.tril(np.ones((n, n)))))]
