r"""Block Lanczos: the largest :math:`|\theta|` of :math:`A X = X \Theta`, A self-adjoint by a mass.

:math:`A = (K - \sigma M)^{-1} M`, :math:`V' M V = I`: each step applies A to a block of vectors and
makes the result orthogonal to all before it. A sparse triangle is gone through once for a block,
not once for each of its vectors: with a block of 12 one costs a third.

Source: Grimes, Lewis, Simon, "A shifted block Lanczos algorithm for solving sparse symmetric
generalized eigenproblems", 1994, doi:10.1137/S0895479888151111.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import scipy

from backsight.types import Array, Sparse

Solve: TypeAlias = Callable[[Array], Array]

BLOCK = 12
"""Vectors at a time; modes of one frequency are found together, up to so many."""

CLOSE = 1e-10
r"""Residuals :math:`|A x - \theta x|` by :math:`\theta`, whose error is their square."""

_DEPENDENT = 1e-12
"""Share of a block's mass below which what is left of a vector is rounding."""

_LONGEST, _STEPS = 6, 30
"""Size of the basis by the number of vectors that are sought, and blocks beside."""

_RESTARTS = 50


def block_lanczos(
    M: Sparse, solve: Solve, count: int, known: Array, *, width: int = BLOCK
) -> Array | None:
    r"""Vectors of the largest eigenvalues, by mass orthogonal to known ones, (n, count).

    None if they do not converge. There may be fewer, if there are no others.

    Parameters
    ----------
    M : (n, n) sparse array
        Positive semidefinite.
    solve : callable
        Solution of :math:`(K - \sigma M) x = b` for columns b.
    count : int
    known : (n, k) array
        Vectors with :math:`X' M X = I`.
    width : int
        Of a block.
    """
    n, k = known.shape
    longest = min(n - k, _LONGEST * count + _STEPS * width)
    start = np.random.default_rng(k).standard_normal((n, width))
    # What is not used of so much memory is never touched.
    basis, massed = (np.empty((n, k + longest + width), order="F") for _ in range(2))
    basis[:, :k], massed[:, :k] = known, M @ known
    V, MV = basis[:, :k], massed[:, :k]
    block, _ = _orthogonal(M, solve(M @ start), V, MV)
    T, restarts = np.zeros((0, 0)), 0
    while block.shape[1]:
        m = V.shape[1] + block.shape[1]
        V, MV = basis[:, :m], massed[:, :m]
        V[:, -block.shape[1] :], MV[:, -block.shape[1] :] = block, M @ block
        image = solve(MV[:, -block.shape[1] :])
        rows = MV[:, k:].T @ image
        rest, beta = _orthogonal(M, image, V, MV)
        T = _bordered(T, rows)
        theta, S = scipy.linalg.eigh(T)
        best = np.argsort(-np.abs(theta))[:count]
        residuals = np.linalg.norm(beta @ S[-block.shape[1] :, best], axis=0)
        done = len(theta) >= count and (residuals <= CLOSE * np.abs(theta[best])).all()
        if done or not rest.shape[1]:
            return V[:, k:] @ S[:, best]
        block = rest
        if len(theta) < longest:
            continue
        # Once more, from the best that there are: frequencies that lie close together.
        restarts += 1
        if restarts > _RESTARTS:
            return None
        top = np.argsort(-np.abs(theta))[: count + 2 * width]
        m = k + len(top)
        basis[:, k:m], massed[:, k:m] = V[:, k:] @ S[:, top], MV[:, k:] @ S[:, top]
        V, MV, T = basis[:, :m], massed[:, :m], np.diag(theta[top])
    return block


def _bordered(T: Array, rows: Array) -> Array:
    """The projected matrix with the rows and columns of one more block."""
    wide = np.zeros((len(rows), len(rows)))
    wide[: len(T), : len(T)] = T
    wide[:, len(T) :] = rows
    wide[len(T) :] = rows.T
    return (wide + wide.T) / 2


def _orthogonal(M: Sparse, W: Array, V: Array, MV: Array) -> tuple[Array, Array]:
    """W without its part in V, as Q with Q'MQ = I, and beta of W = V (V'MW) + Q beta."""
    size = np.sqrt(np.einsum("ij,ij->j", W, M @ W))
    for _ in range(2):  # twice is enough (Kahan, Parlett)
        W = W - V @ (MV.T @ W)
    beta = np.eye(W.shape[1])
    for _ in range(2):
        squares, U = scipy.linalg.eigh(W.T @ (M @ W))
        kept = squares > (_DEPENDENT * size.max()) ** 2
        roots = np.sqrt(squares[kept])
        W = W @ (U[:, kept] / roots)
        beta = (roots[:, None] * U[:, kept].T) @ beta
        size = np.ones(1)
    return W, beta
