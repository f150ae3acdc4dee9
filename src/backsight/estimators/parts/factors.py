"""Triangular factors of covariances: straight-line code for few states, kernels for many.

The functions take SX and are then those of `backsight.algebra`, or MX and are then those of
`backsight.engine.dense`.
"""

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.algebra import sigma, triangular
from backsight.algebra.factor import (
    cholesky_semidefinite,
    smallest_pivot,
    solve_spd,
)
from backsight.algebra.sigma import Weights
from backsight.algebra.symmetric import vech
from backsight.engine import dense
from backsight.engine.dense import VECTOR
from backsight.engine.loops import scan
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    matrix_product,
    packed,
    times_transposed,
)
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
    return dense.cholesky_of(A)


def definite(A: Term) -> Term:
    """1 if a symmetric matrix is positive definite."""
    if not isinstance(A, ca.MX):
        return smallest_pivot(A) > 0
    return ca.mmin(ca.diag(cholesky(A))) > 0


def solve_definite(A: Term, B: Term) -> Term:
    """Solve A X = B for symmetric positive definite A; what is put out for others is worthless."""
    if not isinstance(A, ca.MX):
        return solve_spd(A, B)
    L = cholesky(A)
    return dense.solve_triangular(L, dense.solve_triangular(L, ca.densify(B)), turned=True)


def solve_lower(L: Term, B: Term) -> Term:
    """Solve L X = B for lower triangular L, see `backsight.algebra.triangular.forward`."""
    if not isinstance(L, ca.MX):
        return triangular.forward(L, B)
    return dense.solve_triangular(ca.densify(L), ca.densify(B))


def solve_upper_semidefinite(L: Term, B: Term) -> Term:
    """Solve L' X = B, see `backsight.algebra.triangular.backward_semidefinite`."""
    if not isinstance(L, ca.MX):
        return triangular.backward_semidefinite(L, B)
    return dense.solve_triangular(ca.densify(L), ca.densify(B), turned=True)


def compress_rows(A: Term) -> Term:
    """Lower triangular L with L L' = A A', see `backsight.algebra.triangular.compress`."""
    if not isinstance(A, ca.MX):
        return triangular.compress(A)
    return dense.compressed(ca.densify(A))


def with_fixed(L: Term, x: Term, V: Term, y: Term) -> tuple[Term, Term]:
    """(L, x) of x + L epsilon where V epsilon = y; rows of V are orthonormal, or zero."""
    for i in range(V.shape[0]):
        direction = V[i, :].T
        along = matrix_product(L, direction)
        x = x + along * y[i]
        L = L - times_transposed(along, direction)
    return L, x


def downdate_factor(L: Term, v: Term) -> tuple[Term, Term]:
    """Factor of L L' - v v' and whether there is one, see `backsight.algebra.triangular`."""
    if not isinstance(L, ca.MX):
        return triangular.downdate(L, v)
    return dense.downdated(ca.densify(L), v)


def mean_and_deviations(images: Term, w: Weights) -> tuple[Term, Term]:
    """Mean (m,) of images of sigma points (m, 2 n + 1), and what these deviate from it.

    The weights sum up to one but are large and of both signs: what is averaged is how far the
    images lie from the first one, so that rounding is that of the spread and not of the mean.
    """
    d = minus(images, images[:, 0])
    mean = times_transposed(d, ca.DM(w.mean).T) if isinstance(d, ca.MX) else d @ w.mean
    return images[:, 0] + mean, minus(d, mean)


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


def where_definite(definite: Term, new: Term, old: Term) -> Term:
    """What is new if a factor is one of a definite matrix, which is often known beforehand."""
    return new if definite.is_one() else ca.if_else(definite, new, old)


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
    centre = dense.product_of(x, ca.MX.ones(1, L.shape[1]))
    d = spread * ca.densify(L)
    return ca.horzcat(x, centre + d, centre - d)


def minus(X: Term, x: Term) -> Term:
    """Columns of X minus x."""
    if not isinstance(X, ca.MX):
        return X - x
    return X - dense.product_of(x, ca.MX.ones(1, X.shape[1]))


def on_top(parts: Sequence[Term]) -> Term:
    """Matrices of as many columns on top of each other."""
    if not isinstance(parts[0], ca.MX):
        return ca.vertcat(*parts)
    turned = [dense.transpose(ca.densify(part)) for part in parts]
    return dense.transpose(ca.horzcat(*turned))
