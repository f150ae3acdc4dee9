"""How a covariance is kept, and the products with it.

Straight-line code for a covariance grows with the cube of the number of states. Up to
`backsight.engine.dense.UNROLL` states a covariance is packed, as its lower triangle, and formulas
are straight-line code in SX; with more it is whole, as a vector of n * n numbers, and formulas are
operations on matrices in MX. This is the only place that decides which; the functions below are the
same formulas for both.

With F the Jacobian of a sub-step, F P F' = (P F')' F': both products run over the nonzeros of F
only, so that a model of many weakly coupled modes costs little more than its modes.
"""

import dataclasses
from typing import Any

import casadi as ca
import numpy as np

from backsight.algebra import update
from backsight.algebra.symmetric import unvech, vech
from backsight.engine import dense
from backsight.engine.dense import UNROLL, add_product, symmetrise, transpose
from backsight.types import Array

Term = Any
"""What a formula is written with: SX in straight-line code, MX where loops take its place. The
types of CasADi's functions do not know that they take either."""


@dataclasses.dataclass(frozen=True)
class Covariance:
    """How the covariance of n numbers is kept.

    Parameters
    ----------
    n : int
    """

    n: int

    @property
    def whole(self) -> bool:
        """Whether loops over all of the matrix take the place of straight-line code."""
        return self.n > UNROLL

    @property
    def size(self) -> int:
        """How many numbers are kept."""
        return self.n * self.n if self.whole else self.n * (self.n + 1) // 2

    def kept(self, P: Array) -> Array:
        """A covariance (n, n) in numbers as it is kept, (`size`,)."""
        return P.ravel() if self.whole else packed(P)

    def opened(self, kept: Term) -> Term:
        """The matrix (n, n)."""
        return ca.reshape(kept, self.n, self.n) if self.whole else unvech(kept)

    def closed(self, P: Term) -> Term:
        """A matrix (n, n) as it is kept, symmetric to the last bit."""
        return ca.vec(symmetrise(P)) if self.whole else vech(P)

    def triangle(self) -> ca.Function:
        """What is kept to the lower triangle."""
        if self.whole:
            whole = ca.MX.sym("kept", self.size)
            return ca.Function("covariance", [whole], [dense.triangle(self.opened(whole))])
        kept = ca.SX.sym("kept", self.size)
        return ca.Function("covariance", [kept], [kept])

    def of_triangle(self) -> ca.Function:
        """Lower triangle to what is kept."""
        if self.whole:
            triangle = ca.MX.sym("P", self.n * (self.n + 1) // 2)
            return ca.Function("kept", [triangle], [ca.vec(dense.unpacked(triangle, self.n))])
        P = ca.SX.sym("P", self.n * (self.n + 1) // 2)
        return ca.Function("kept", [P], [P])


def packed(P: Array) -> Array:
    """Lower triangle of a symmetric matrix, (n (n + 1) / 2,)."""
    return P.T[np.triu_indices(len(P))]


def plus_known(P: Term, Q: Array | ca.DM | Term) -> Term:
    """P + Q; of a constant Q that is diagonal only its diagonal counts."""
    if not isinstance(P, ca.MX) or isinstance(Q, ca.MX):
        return P + Q
    known = ca.DM(Q).full()
    if np.count_nonzero(known - np.diag(np.diag(known))):
        return P + Q
    n = len(known)
    places = ca.Sparsity.triplet(n * n, n, [i * (n + 1) for i in range(n)], list(range(n)))
    row = ca.reshape(P, 1, n * n)
    added = add_product(row, ca.MX.ones(1, n), ca.MX(ca.DM(places, np.diag(known))))
    return ca.reshape(added, n, n)


def times_transposed(A: Term, F: Term) -> Term:
    """A F' of a dense A and a sparse F."""
    if isinstance(A, ca.MX):
        return add_product(ca.MX.zeros(A.shape[0], F.shape[0]), A, ca.MX(F))
    return A @ F.T


def symmetric_part(P: Term) -> Term:
    """The symmetric part; straight-line code takes no other entries anyway."""
    return symmetrise(P) if isinstance(P, ca.MX) else P


def matrix_product(A: Term | ca.DM, B: Term | ca.DM) -> Term:
    """A B, of which one may be constant numbers."""
    if not (isinstance(A, ca.MX) or isinstance(B, ca.MX)):
        return A @ B
    if isinstance(B, ca.DM):
        return times_transposed(A, B.T)
    A = ca.MX(A)
    if A.nnz() <= dense.FEW * A.numel():
        return transpose(times_transposed(transpose(B), A))
    return dense.product_of(ca.densify(A), ca.densify(B))


def turned_product(A: Term, b: Term) -> Term:
    """A' b of a column b."""
    return dense.applied(A, b, turned=True) if isinstance(b, ca.MX) else A.T @ b


def inner_product(a: Term, b: Term) -> Term:
    """a' b of columns."""
    if isinstance(a, ca.MX):
        return dense.product_of(a, b, turned=(True, False))
    return ca.dot(a, b)


def influence(S: Term, R: Array) -> Term:
    """S R S'."""
    return (
        times_transposed(times_transposed(S, ca.DM(R)), S) if isinstance(S, ca.MX) else S @ R @ S.T
    )


def transposed(A: Term) -> Term:
    """A' of a dense A."""
    return transpose(A) if isinstance(A, ca.MX) else A.T


def congruence(F: Term, P: Term, Q: Array | ca.DM | Term) -> Term:
    """F P F' + Q of symmetric P and Q."""
    if not isinstance(P, ca.MX):
        return F @ P @ F.T + Q
    F, added = ca.MX(F), ca.densify(Q if isinstance(Q, ca.MX) else ca.MX(ca.DM(Q)))
    if F.shape == P.shape and F.nnz() > dense.FEW * F.numel():
        return dense.congruence_of(ca.densify(F), P, added)
    return add_product(added, transpose(times_transposed(P, F)), F)


def kalman_gain(P: Term, H: Term, R: Term) -> tuple[Term, Term]:
    """Kalman gain K = P H' S^-1 (nx, ny) and innovation covariance S = H P H' + R (ny, ny)."""
    if not isinstance(P, ca.MX):
        return update.gain(P, H, R)
    K, S, _ = weighted_gain(P, H, R, ca.MX.ones(H.shape[0]))
    return K, S


def weighted_gain(P: ca.MX, H: ca.MX, R: Array | ca.MX, mask: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Gain K (nx, ny), innovation covariance S and noise (ny, ny) of a sample with these weights.

    Of many states; the weights are those of `backsight.algebra.update.masked`, R the nominal noise.
    K has columns of zeros where nothing was measured, so that H and the noise, which is nominal
    there, need none.
    """
    PHt = times_transposed(P, H)
    S = times_transposed(transpose(PHt), H)
    return dense.gain_of(PHt, S, R if isinstance(R, ca.MX) else ca.MX(ca.DM(R)), mask)


def innovation_covariance(P: ca.MX, H: ca.MX, R: Array | ca.MX, mask: ca.MX) -> ca.MX:
    """H P H' and the noise of the sample, of many states; see `weighted_gain`."""
    PHt = times_transposed(P, H)
    HPHt = times_transposed(transpose(PHt), H)
    noise = R if isinstance(R, ca.MX) else ca.MX(ca.densify(ca.DM(R)))
    return symmetrise(HPHt) + noise_of_many(noise, mask)


def noise_of_many(R: ca.MX, mask: ca.MX) -> ca.MX:
    """`backsight.algebra.update.noise_of` of many outputs."""
    m = ca.SX.sym("mask", R.shape[0])
    weights = ca.Function("weights", [m], [ca.if_else(update.measured(m), m, 1)])(mask)
    return R / dense.product_of(weights, weights, turned=(False, True))


@dataclasses.dataclass(frozen=True)
class Corrected:
    """Covariances around a measurement of a model of many states.

    Parameters
    ----------
    P : MX
        Covariance (nx, nx) of the estimate.
    K, S, noise : MX
        See `weighted_gain`.
    """

    P: ca.MX
    K: ca.MX
    S: ca.MX
    noise: ca.MX


def corrected_covariance(P: ca.MX, H: ca.MX, R: Array | ca.MX, mask: ca.MX) -> Corrected:
    """Gain and covariance after a measurement, see `weighted_gain`.

    P - P H' S^-1 H P as P - W' W with W = L^-1 H P and S = L L', see `matrix_gain.c`. What rounding
    makes of S changes that by K (dS) K', which is small beside P; Joseph's form, which does not
    mind a rounded gain either, takes four times as many operations with all of P.
    """
    G = times_transposed(P, H)
    HG = times_transposed(transpose(G), H)
    noise = R if isinstance(R, ca.MX) else ca.MX(ca.DM(R))
    return Corrected(*dense.corrected_of(P, G, HG, noise, mask))


def scatter_and_noise(d: Term, weights: Array, R: Array, mask: Term) -> Term:
    """Covariance d diag(w) d' of weighted deviations, with the noise of the sample."""
    if not isinstance(d, ca.MX):
        return d @ ca.diag(ca.SX(weights)) @ d.T + update.noise_of(ca.SX(R), mask)
    ny = d.shape[0]
    weighted = d * dense.product_of(ca.MX.ones(ny, 1), ca.MX(ca.DM(weights).T))
    scatter = dense.product_of(weighted, d, turned=(False, True))
    _, S, _ = dense.gain_of(ca.MX.zeros(1, ny), scatter, ca.MX(ca.DM(R)), mask)
    return S


def joseph_form(P: Term, K: Term, H: Term, R: Term) -> Term:
    """(I - K H) P (I - K H)' + K R K': positive semidefinite for every gain, however rounded.

    Of a large matrix as products of tall ones.
    """
    if not isinstance(P, ca.MX):
        return update.joseph(P, K, H, R)
    left = dense.plus_product(P, K, times_transposed(P, H), turned=(False, True), minus=True)
    rest = times_transposed(K, R) - times_transposed(left, H)
    return dense.plus_product(left, rest, K, turned=(False, True))
