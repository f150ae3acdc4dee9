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

import numpy as np
import scipy

from backsight.errors import BacksightWarning, ModelError
from backsight.models.structures.matrices.lowest_modes._factors import (
    ShiftedSolutions,
    sparse_factor,
)
from backsight.models.structures.matrices.lowest_modes._lanczos import BLOCK, Solve, block_lanczos
from backsight.types import Array, Sparse

EPS = float(np.finfo(float).eps)

ROUNDING = 8.0
r"""Units of rounding of :math:`|x|' |K| |x|` below which :math:`|x' K x|` is that of a rigid body.

Measured on free beams of 10 to 400 elements: 0.03 at most, on space frames in any position 0.4; the
first bending of a cantilever of 400 elements has 45000.
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

_BELOW = 1e-6
"""So much below the last square modes are counted: not within a pair of it."""


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
    try:
        squares, Q = scipy.linalg.eigh(_symmetric(X.T @ (K @ X)), _symmetric(X.T @ (M @ X)))
    except np.linalg.LinAlgError:
        masses = M.diagonal()[M.diagonal() > 0]
        raise ModelError(
            f"mass is not positive definite for the lowest modes: its diagonal is from "
            f"{masses.min():.3g} to {masses.max():.3g}; a coordinate without mass has the mass 0"
        ) from None
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
    shifted = ShiftedSolutions(K - shift * M)
    if not shifted.regular:
        return None
    X, missed = block_lanczos(M, shifted.solve, count, np.zeros((n, 0))), 0
    if X is None:
        raise ModelError(
            f"the {count} lowest modes do not converge: rounding hides them; check the units of "
            "the coordinates and whether a penalty is too large"
        )
    for _ in range(_TRIES):
        squares, X, size = (part[..., :count] for part in _ritz(M, K, X))
        bends = squares[-1] > ROUNDING * EPS * size[-1]
        # Of a singular mass matrix, once more: rounding along its null space goes.
        pure = shifted.solve(M @ X)
        shifted.forget()
        # If all are rigid bodies, none may be further below zero than the shift.
        missed = _missed(M, K, squares, squares[-1] * (1 - _BELOW) if bends else 2 * shift)
        if not missed:
            return LowestModes(np.zeros(count), pure, shift, shifted.solve)
        few = min(missed, n // 4)
        more = block_lanczos(M, shifted.solve, few, X, width=min(max(few, BLOCK), n // 8))
        if more is None or not more.shape[1]:
            break
        X = np.hstack([X, more])
    raise ModelError(
        f"{missed} modes below {_hertz(np.maximum(squares[-1:], 0))} Hz are not found: stiffness "
        "is not positive semidefinite by much"
    )


def _missed(M: Sparse, K: Sparse, squares: Array, mu: float) -> int:
    """How many modes below mu were missed: some of one frequency, or far below zero.

    By Sylvester's law: as many pivots of K - mu M are negative as there are squares below mu.
    """
    factor = sparse_factor(K - mu * M)
    below = factor.negative if factor is not None else None
    return 0 if below is None else max(below - int((squares < mu).sum()), 0)


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
