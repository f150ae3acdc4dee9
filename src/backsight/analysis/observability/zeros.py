"""Transmission zeros: motions that inputs can make without any output telling."""

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from backsight.errors import ModelError
from backsight.types import Array

RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest are zero, columns and rows made comparable."""

ZERO_TOLERANCE = 1e-8
"""The same for the system matrix at a zero, which is known to fewer digits."""

CROWDED = 1e-5
"""Eigenvalues that are nearer than this share of the largest have eigenvectors of few digits."""

SEEN = 1e-3
"""An eigenvector whose image is larger, by the largest row of outputs, is no motion without any."""


def transmission_zeros(
    A: ArrayLike, E: ArrayLike, C: ArrayLike, F: ArrayLike
) -> NDArray[np.complex128]:
    r"""Transmission zeros of a discrete-time system from forces to outputs.

    They are the z at which

    .. math:: \begin{bmatrix} z I - A & -E \\ C & F \end{bmatrix}

    loses column rank: with :math:`d_k = d_0 z^k` and a suitable start the outputs stay zero.
    Whoever computes the forces from the outputs makes errors that evolve by these z. With more
    outputs than forces there are none in general.

    Parameters
    ----------
    A : (nx, nx) array
    E : (nx, m) array
        Of :math:`x_{k+1} = A x_k + E d_k`.
    C : (ny, nx) array
    F : (ny, m) array
        Of :math:`y_k = C x_k + F d_k`. If it is zero, the outputs of the next sample count.

    Raises
    ------
    ModelError
        If the forces do not show independently in one sample: F, or C E if F is zero, must have the
        rank m.

    Notes
    -----
    Without feedthrough :math:`y_{k+1} = C A x_k + C E d_k` takes the place of the output. Choosing
    d so that as many outputs as there are forces stay zero leaves the eigenvalues of
    :math:`A - E H^+ G` with the output equation :math:`G x + H d`; those that keep the other
    outputs zero, too, are the zeros. The m eigenvalues that the step ahead adds are taken out by
    restricting x to the motions with :math:`H^+ C x = 0`. Of an eigenvalue that is alone the
    eigenvector tells whether the other outputs show it; only where they hardly do, or others are
    near, is the rank of the matrix above looked at, which costs as much for each z as all
    eigenvalues together.

    Examples
    --------
    >>> bs.check.transmission_zeros([[0, 1], [-4, -1]], [[0], [1]], [[1, 1]], [[0]])
    array([-1.+0.j])
    """
    a, e, c, f = (np.atleast_2d(np.asarray(k, float)) for k in (A, E, C, F))
    _, (size, _) = scipy.linalg.matrix_balance(a, permute=False, separate=True)
    a, e, c = a * size / size[:, None], e / size[:, None], c * size
    direct = bool(f.any())
    seen = f if direct else c @ e
    of_y, of_d = _lengths(np.hstack([c, f]), 1), _lengths(np.vstack([e, f]), 0)
    e, c, f = e / of_d, c / of_y[:, None], f / of_d / of_y[:, None]
    H = seen / of_d / of_y[:, None]
    m = H.shape[1]
    if rank_of(H) < m:
        raise ModelError(
            f"{m} forces show in one sample in only {rank_of(H)} independent ways; their "
            "transmission zeros are not found in this way: use fewer forces or more sensors"
        )
    back = np.linalg.pinv(H)
    if direct:
        left, seen_alone = a - e @ back @ c, c - H @ (back @ c)
    else:
        basis = scipy.linalg.null_space(back @ c)
        left = basis.T @ (a - e @ back @ c @ a) @ basis
        seen_alone = c @ basis
    if len(H) == m:
        kept = list(np.linalg.eigvals(left)) if left.size else []
    else:
        size = np.linalg.norm(c, axis=1).max(initial=0.0)
        candidates = _hardly_seen(left, seen_alone, size)
        kept = [z for z in candidates if _loses_rank(complex(z), a, e, c, f)]
    return np.array(sorted(kept, key=lambda z: (z.real, z.imag)), complex)


def rank_of(matrix: Array) -> int:
    """Rank of a matrix whose rows are comparable, its columns made so."""
    columns = matrix / _lengths(matrix, 0)
    values = np.linalg.svd(columns, compute_uv=False)
    return int((values > RANK_TOLERANCE * max(values[0], 1e-300)).sum()) if values.size else 0


def _hardly_seen(A: Array, C: Array, size: float) -> NDArray[np.complex128]:
    """Eigenvalues of A but for those alone whose eigenvectors C, with rows of a size, shows."""
    if not A.size:
        return np.zeros(0, complex)
    values, vectors = np.linalg.eig(A)
    values = values.astype(complex)
    apart = np.abs(values[:, None] - values)
    np.fill_diagonal(apart, np.inf)
    alone = apart.min(axis=1, initial=np.inf) > CROWDED * np.abs(values).max()
    shown = np.linalg.norm(C @ vectors, axis=0) > SEEN * size
    return values[~(alone & shown)]


def _loses_rank(z: complex, a: Array, e: Array, c: Array, f: Array) -> bool:
    top = np.hstack([z * np.eye(len(a)) - a, -e])
    values = np.linalg.svd(np.vstack([top, np.hstack([c, f])]), compute_uv=False)
    return bool(values[-1] < ZERO_TOLERANCE * values[0])


def _lengths(matrix: Array, axis: int) -> Array:
    lengths = np.linalg.norm(matrix, axis=axis)
    return np.where(lengths > 0, lengths, 1.0)
