r"""A gain that gives an observer of many states its poles, by a Sylvester equation.

With F = A' and B = C' a gain K' is wanted for which F - B K has the poles :math:`\lambda_i`. For
any matrix G, one column for each pole,

.. math:: F X - X \Lambda = B G, \qquad K = G X^{-1}

is such a gain, since then (F - B K) X = X :math:`\Lambda` (Bhattacharyya, de Souza, "Pole
assignment via Sylvester's equation", Systems & Control Letters 1(4), 1982, 261-263). What G leaves
open goes into the eigenvectors X: descent along the gradient of :math:`\|X^{-1}\|_F`, with columns
of the length 1, makes them as independent as a few steps can (Varga, "Robust pole assignment via
Sylvester equation based state feedback parametrization", IEEE Symposium on Computer-Aided Control
System Design, 2000, 13-18). A step costs a few products of matrices and an inverse; a method
that turns one eigenvector after the other, as `scipy.signal.place_poles` does, needs a QR
decomposition for each of them in each round, minutes for hundreds of states.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from backsight.errors import TuningError
from backsight.types import Array

STEPS = 5, 100
"""Of the descent at least and at most; the first ones do most."""

EFFORT = 5e8
"""Steps times the cube of the number of states: what takes less than a second."""

APART = 1e-6
"""A pole that is nearer than this to an eigenvalue of the model makes the equation singular."""

ILL = 1e8
"""Condition number of the model's eigenvectors from which on they are no coordinates."""

FOUND = 1e-6
"""Error of a pole that is taken."""


def placed_gain(A: Array, C: Array, poles: Sequence[complex]) -> Array:
    """L (nx, ny) with which A - L C has the poles.

    Parameters
    ----------
    A, C : (nx, nx), (ny, nx) arrays
    poles : sequence of complex
        One for each state, with their conjugates; none more often than C has independent rows.

    Raises
    ------
    TuningError
        If the arithmetic does not suffice: the poles that come out are not those that were asked
        for.
    """
    half = sorted((p for p in poles if p.imag >= 0), key=lambda p: (p.imag > 0, p.real))
    upper: NDArray[np.complex128] = np.array(half, complex)
    # Outputs as orthogonal directions, so that no unit of one makes it heavier than another.
    turned, size, _ = np.linalg.svd(C.T, full_matrices=False)
    seen = size > size[0] * len(A) * np.finfo(float).eps
    B, back = turned[:, seen], np.linalg.pinv(C.T)
    before, F = np.zeros((B.shape[1], len(A))), A.T
    rng = np.random.default_rng(0)
    values, vectors = np.linalg.eig(F)
    if not _apart(values, vectors, upper):
        # Any other feedback to begin with moves the eigenvalues away; it is part of the gain.
        before = rng.standard_normal(before.shape) * np.linalg.norm(F, 1) / np.sqrt(F.size)
        values, vectors = np.linalg.eig(F - B @ before)
    equation = _Equation(
        vectors,
        np.linalg.solve(vectors, B.astype(complex)).astype(complex),
        (1 / (values[:, None] - upper)).astype(complex),
        sum(p.imag == 0 for p in half),
    )
    start = rng.standard_normal((B.shape[1], len(A)))
    best = scipy.optimize.minimize(
        lambda g: equation.cost(g.reshape(start.shape)),
        equation.even(start).ravel(),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": int(np.clip(EFFORT / len(A) ** 3, *STEPS))},
    )
    G = best.x.reshape(start.shape)
    K = before + np.linalg.solve(equation.vectors(G).T, G.T).T
    L = (back @ B @ K).T
    _check(A - L @ C, poles)
    return L


def _apart(values: Array, vectors: Array, poles: NDArray[np.complex128]) -> bool:
    """Whether eigenvectors can be counted by, and no eigenvalue is a pole."""
    gap = np.abs(values[:, None] - poles).min()
    return bool(gap > APART and np.linalg.cond(vectors, 1) < ILL)


@dataclasses.dataclass(frozen=True)
class _Equation:
    """F X - X Lambda = B G in the coordinates of the eigenvectors V of F.

    Of conjugate poles X has the real and the imaginary part of one eigenvector, next to each
    other; G likewise. Real ones stand first.

    Parameters
    ----------
    V : (n, n) complex array
    B : (n, m) complex array
        V^-1 B.
    weights : (n, number of poles that are not conjugates of another) complex array
        1 / (eigenvalue - pole).
    real : int
        How many poles are real.
    """

    V: NDArray[np.complex128]
    B: NDArray[np.complex128]
    weights: NDArray[np.complex128]
    real: int

    def vectors(self, G: Array) -> Array:
        """X (n, n)."""
        return self._parts(self.V @ (self.B @ self._whole(G) * self.weights))

    def even(self, G: Array) -> Array:
        """G with eigenvectors of the length 1."""
        return G / self._lengths(self.vectors(G))

    def cost(self, G: Array) -> tuple[float, Array]:
        """Logarithm of the squared norm of the inverse of even eigenvectors; its gradient."""
        free = self.vectors(G)
        lengths = self._lengths(free)
        X = free / lengths
        try:
            Y = np.linalg.inv(X)
        except np.linalg.LinAlgError:
            return np.inf, np.zeros(G.size)
        size = float(np.sum(Y * Y))
        slope = -2 / size * Y.T @ (Y @ Y.T)
        slope = (slope - X * self._pairs(np.sum(X * slope, axis=0)) / self._squares(X)) / lengths
        into = self.V.conj().T @ self._whole(slope) * self.weights.conj()
        return np.log(size), self._parts(self.B.conj().T @ into).ravel()

    def _whole(self, parts: Array) -> NDArray[np.complex128]:
        """Complex columns of their real and imaginary parts."""
        pairs = parts[:, self.real :]
        alone = parts[:, : self.real].astype(complex)
        return np.hstack([alone, pairs[:, ::2] + 1j * pairs[:, 1::2]])

    def _parts(self, columns: NDArray[np.complex128]) -> Array:
        """The contrary of `_whole`."""
        pairs = columns[:, self.real :]
        both = np.stack([pairs.real, pairs.imag], axis=-1).reshape(len(columns), -1)
        return np.hstack([columns[:, : self.real].real, both])

    def _pairs(self, of_columns: Array) -> Array:
        """Sums over the two columns of a pair, for each of both."""
        sums = of_columns[self.real :].reshape(-1, 2).sum(axis=1)
        return np.concatenate([of_columns[: self.real], np.repeat(sums, 2)])

    def _squares(self, X: Array) -> Array:
        return self._pairs(np.sum(X * X, axis=0))

    def _lengths(self, X: Array) -> Array:
        return np.sqrt(self._squares(X))


def _check(error: Array, poles: Sequence[complex]) -> None:
    """Compare the poles with those that were asked for, each with its own."""
    found = np.linalg.eigvals(error)
    away = np.abs(found[:, None] - np.asarray(poles))
    worst = float(away[scipy.optimize.linear_sum_assignment(away)].max())
    if not worst < FOUND:
        raise TuningError(
            f"the poles cannot be placed: with the best gain found one is {worst:.2g} away from "
            "where it was asked for; spread the poles, move them nearer to those of the model, or "
            "let KalmanFilter(steady_state=True) choose"
        )
