r"""The lowest modes of :math:`K \Phi = M \Phi \Lambda`, to the rounding of each mode itself.

Shift and invert: the largest :math:`\theta = 1 / (\lambda - \sigma)` of
:math:`M x = \theta (K - \sigma M) x` with a small shift :math:`\sigma < 0`, so that
:math:`K - \sigma M` is positive definite although the structure may be free, and M may be singular.
The Rayleigh-Ritz step at the end squares the errors of the vectors.

Source: Bathe, "Finite Element Procedures", 2nd ed. 2014, sections 11.2.3 (shifts), 11.3.1 (rigid
bodies); Parlett, "The Symmetric Eigenvalue Problem", 1998, sections 11.3 and 15.9.
"""

import dataclasses
import warnings
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import scipy
import scipy.sparse as sparse

from backsight.errors import BacksightWarning, ModelError
from backsight.types import Array, Sparse

Solve: TypeAlias = Callable[[Array], Array]

EPS = float(np.finfo(float).eps)

ROUNDING = 16.0
r"""Units of rounding of :math:`|x|' |K| |x|` below which :math:`|x' K x|` is that of a rigid body.

Measured on free beams of 10 to 400 elements: 0.03 at most; the first bending of a cantilever of 400
elements has 45000.
"""

_VAGUE = 0.02
"""Share of a squared frequency that rounding may be without a word."""

DENSE = 600
"""Up to so many coordinates all numbers are kept; above, if one in `FILLED` is not zero."""

FILLED = 5

_RAISE = 1e3
"""Factor of the shift if rounding makes :math:`K - \\sigma M` indefinite."""

_NEAR = (1e-6, 10.0)
"""Range of the shift by the lowest elastic square in which accuracy does not suffer."""

_TRIES = 10


@dataclasses.dataclass(frozen=True)
class LowestModes:
    r"""Modes by mass: :math:`\Phi' M \Phi = I`.

    Parameters
    ----------
    squares : (m,) array
        Squared angular frequencies, ascending; exactly 0 for a rigid body [rad2/s2].
    shapes : (n, m) array
        :math:`\Phi`.
    shift : float
        :math:`\sigma`.
    solve : callable
        Solution of :math:`(K - \sigma M) x = b` for one or more columns b.
    """

    squares: Array
    shapes: Array
    shift: float
    solve: Solve


def lowest(M: Sparse, K: Sparse, count: int, *, precision: float) -> LowestModes:
    """Find the lowest modes of a symmetric structure.

    Parameters
    ----------
    M, K : (n, n) sparse arrays
        M positive semidefinite; its null space is not a motion without stiffness.
    count : int
        Number of modes.
    precision : float
        Relative rounding of the entries of K.

    Raises
    ------
    ModelError
        If K is not positive semidefinite by more than the rounding of the mode that shows it, or M
        is not.
    """
    with_mass = M.diagonal() > 0
    ratio = K.diagonal()[with_mass] / M.diagonal()[with_mass]
    shift = -1e3 * EPS * float(np.median(np.abs(ratio))) or -EPS
    for _ in range(_TRIES):
        found = _shifted(M, K, count, shift)
        if found is None:
            shift *= _RAISE
            continue
        squares, shapes, size = _ritz(M, K, found.shapes)
        found = dataclasses.replace(found, squares=squares, shapes=shapes)
        rounding = ROUNDING * EPS * size
        elastic = squares[squares > rounding]
        free = elastic.size < squares.size
        if (
            not elastic.size
            or squares[0] < -rounding[0]
            or (_NEAR[0] * elastic[0] if free else 0) < -shift < _NEAR[1] * elastic[0]
        ):
            return _judged(found, rounding, rounding + precision * size)
        shift = -float(elastic[0])
    raise ModelError(
        "the lowest modes of the stiffness and mass matrices could not be found to any accuracy: "
        "the stiffness is not positive semidefinite, or rounding hides it; check the units of the "
        "coordinates and whether a penalty is too large"
    )


def _judged(found: LowestModes, computed: Array, written: Array) -> LowestModes:
    """Zero for what is a rigid body by the rounding of its own mode; indefinite is refused.

    Parameters
    ----------
    computed, written : (m,) array
        What rounding makes of a squared frequency: that of the machine, and that of the entries as
        they are written, too.
    """
    squares = found.squares
    if squares[0] < -written[0]:
        raise ModelError(
            f"stiffness is not positive semidefinite: a squared frequency is {squares[0]:.3g}, and "
            f"rounding explains {written[0]:.1g} only"
        )
    hidden = (squares > computed) & (squares <= written)
    if hidden.any():
        _tell(
            f"modes at {_hertz(squares[hidden])} Hz are taken for rigid bodies: the stiffness "
            "is written with too few digits to tell; write more if the structure is held"
        )
    vague = (squares > written) & (_VAGUE * squares < written)
    if vague.any():
        _tell(
            f"the frequencies of the modes at {_hertz(squares[vague])} Hz may be wrong by "
            f"{50 * float((written / squares)[vague].max()):.2g} %, by the digits with which the "
            "stiffness is written"
        )
    return dataclasses.replace(found, squares=np.where(squares > written, squares, 0.0))


def _tell(sentence: str) -> None:
    warnings.warn(sentence, BacksightWarning, stacklevel=2)


def _hertz(squares: Array) -> str:
    return ", ".join(f"{f:.3g}" for f in np.sqrt(squares) / (2 * np.pi))


def _ritz(M: Sparse, K: Sparse, X: Array) -> tuple[Array, Array, Array]:
    """Rayleigh quotients and vectors in the span of X, and |x|'|K||x| of each."""
    squares, Q = scipy.linalg.eigh(_symmetric(X.T @ (K @ X)), _symmetric(X.T @ (M @ X)))
    X = X @ Q
    X /= np.sqrt(np.einsum("ij,ij->j", X, M @ X))
    squares = np.einsum("ij,ij->j", X, K @ X)
    size = np.einsum("ij,ij->j", np.abs(X), abs(K) @ np.abs(X))
    order = np.argsort(squares, kind="stable")
    return squares[order], X[:, order], size[order]


def _symmetric(A: Array) -> Array:
    return (A + A.T) / 2


def _shifted(M: Sparse, K: Sparse, count: int, shift: float) -> LowestModes | None:
    """Modes nearest to the shift, or None if K - shift M is not positive definite."""
    n = M.shape[0]
    if n <= DENSE or K.nnz * FILLED > n * n or count > n // 2:
        return _dense(M.toarray(), K.toarray(), count, shift)
    solve = _factored(sparse.csc_array(K - shift * M))
    if solve is None:
        return None
    start = np.random.default_rng(0).standard_normal(n)
    _, X = sparse.linalg.eigsh(
        K,
        count,
        M,
        sigma=shift,
        OPinv=sparse.linalg.LinearOperator((n, n), solve, dtype=float),
        v0=start,
        ncv=min(n - 1, 2 * count + 20),
    )
    # Of a singular mass matrix, once more: what rounding left along its null space goes.
    return LowestModes(np.zeros(count), solve(M @ X), shift, solve)


def _dense(M: Array, K: Array, count: int, shift: float) -> LowestModes | None:
    n = len(M)
    try:
        factor = scipy.linalg.cho_factor(K - shift * M)
        _, X = scipy.linalg.eigh(M, K - shift * M, subset_by_index=[n - count, n - 1])
    except np.linalg.LinAlgError:
        return None
    return LowestModes(
        np.zeros(count), X[:, ::-1], shift, lambda b: np.asarray(scipy.linalg.cho_solve(factor, b))
    )


def _factored(A: Sparse) -> Solve | None:
    """Solution by sparse factors; None if the matrix is not positive definite (its pivots)."""
    try:
        # Pivots stay on the diagonal: half the work, and their signs are those of the eigenvalues.
        factor = sparse.linalg.splu(
            A,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return None
    positive = np.array_equal(factor.perm_r, factor.perm_c) and (factor.U.diagonal() > 0).all()
    return factor.solve if positive else None
