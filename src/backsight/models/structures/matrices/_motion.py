"""What motions a structure may make: fixed coordinates and equations between coordinates."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.errors import MOST_NAMES, BacksightWarning, ModelError
from backsight.models.structures.matrices._given import Matrices
from backsight.models.structures.matrices._places import Places
from backsight.types import Array, Indices, Sparse

Equations: TypeAlias = ArrayLike | Sequence[Mapping[int | str, float]] | Any
"""C of C x = 0, an array or sparse matrix; or a list of ``{coordinate: factor}``, one per row."""

DENSE = 600
"""Up to so many coordinates the mass is checked by all of its eigenvalues."""

_DEPENDENT = 1e-10
"""A row of C that is so much smaller, after the others are taken off it, says nothing new."""


@dataclasses.dataclass(frozen=True)
class Motions:
    """Motions w = T q.

    Parameters
    ----------
    T : (n, r) sparse array
        Of the r coordinates that are free.
    free : (r,) array of int
        Their numbers.
    held : (k,) array of int
        Numbers of the fixed coordinates.
    """

    T: Sparse
    free: Indices
    held: Indices


@dataclasses.dataclass(frozen=True)
class Moving:
    """A structure on the coordinates that move by themselves.

    Parameters
    ----------
    mass, stiffness, damping : (r, r) sparse array
    whole : Matrices
        On all coordinates, as given.
    motions : Motions
    """

    mass: Sparse
    stiffness: Sparse
    damping: Sparse
    whole: Matrices
    motions: Motions

    @property
    def n(self) -> int:
        """Number of coordinates that move by themselves."""
        return self.mass.shape[0]


def motions(places: Places, fixed: Sequence[int | str], constraints: Equations | None) -> Motions:
    """Motions that fixed coordinates and constraints allow.

    Coordinates of q are coordinates of w: those that depend on others by a constraint are taken out
    by QR with column pivoting, so that they are well determined by the rest.

    Parameters
    ----------
    places : Places
        Names the coordinates.
    fixed : sequence of int or str
        Coordinates that do not move.
    constraints : Equations, optional
        Multi-point constraints, homogeneous.

    Raises
    ------
    ModelError
        If a coordinate is unknown or nothing can move.
    """
    n = places.n
    held = np.array(sorted({places.number(name, "fixed") for name in fixed}), int)
    free = np.setdiff1d(np.arange(n), held)
    T: Sparse = scipy.sparse.csc_array(scipy.sparse.eye_array(n, format="csc"))[:, free]
    if constraints is not None:
        C = scipy.sparse.csc_array(_rows(constraints, places) @ T)
        basis, independent = _null_space(C)
        T, free = scipy.sparse.csc_array(T @ basis), free[independent]
    if not T.shape[1]:
        raise ModelError("nothing can move: every coordinate is fixed or follows from constraints")
    return Motions(T, free, held)


def moving(
    whole: Matrices, places: Places, allowed: Motions, rayleigh: tuple[float, float]
) -> Moving:
    """Matrices of the motions; what has no mass is said, what has no stiffness either is held.

    Parameters
    ----------
    rayleigh : tuple of float
        Factors of the mass and of the stiffness that the damping has in addition [1/s, s].

    Raises
    ------
    ModelError
        If the mass is not positive semidefinite.
    """
    alpha, beta = rayleigh
    damping = whole.damping + alpha * whole.mass + beta * whole.stiffness
    M, K, C = (_projected(A, allowed.T) for A in (whole.mass, whole.stiffness, damping))
    bare = np.diff(M.indptr) == 0
    loose = bare & (np.diff(K.indptr) == 0)
    if loose.any():
        _tell(f"{_listed(places, allowed.free[loose])} neither mass nor stiffness: left out")
        kept = ~loose
        allowed = dataclasses.replace(
            allowed, T=scipy.sparse.csc_array(allowed.T[:, kept]), free=allowed.free[kept]
        )
        M, K, C = (scipy.sparse.csc_array(A[kept][:, kept]) for A in (M, K, C))
        bare = bare[kept]
    _check_mass(M, bare, places, allowed)
    if bare.any():
        _tell(
            f"{_listed(places, allowed.free[bare])} no mass: the others carry it along statically"
        )
    if not M.nnz:
        raise ModelError("mass has no entry that is not zero: nothing has a mass")
    return Moving(M, K, C, whole, allowed)


def ground_shape(structure: Moving, at: Array, rest: Callable[[Array], Array]) -> Array:
    """Motion of all coordinates while the ground moves by 1 and nothing vibrates, (n,).

    Parameters
    ----------
    at : (n,) array
        Motion of the ground. If coordinates are fixed, theirs counts and the others follow
        statically; if none is, it is that of the whole structure.
    rest : callable
        Loads (r, k) on the moving coordinates to the deflections (r, k) in which they come to rest.
    """
    held, T = structure.motions.held, structure.motions.T
    if not held.size:
        return at
    of_supports = np.zeros_like(at)
    of_supports[held] = at[held]
    if not of_supports.any():
        raise ModelError("the ground moves no fixed coordinate; give its motion at those")
    pull = T.T @ (structure.whole.stiffness @ of_supports)
    return of_supports - T @ rest(pull[:, None])[:, 0]


def _projected(A: Sparse, T: Sparse) -> Sparse:
    made = scipy.sparse.csc_array(T.T @ A @ T)
    made.eliminate_zeros()
    return made


def _check_mass(M: Sparse, bare: Indices, places: Places, allowed: Motions) -> None:
    diagonal = M.diagonal()
    wrong = np.flatnonzero(~bare & (diagonal <= 0))
    if wrong.size:
        raise ModelError(
            f"mass is not positive definite: {_listed(places, allowed.free[wrong])} a mass of "
            f"{diagonal[wrong[0]]:g}"
        )
    if (~bare).sum() > DENSE:
        return  # too much work; a mode of negative mass is refused when it is found
    part = M[~bare][:, ~bare].toarray()
    root = np.sqrt(part.diagonal())
    least = np.linalg.eigvalsh(part / np.outer(root, root))[0]
    if least < -len(part) * np.finfo(float).eps:
        raise ModelError(
            f"mass is not positive definite: by its diagonal, an eigenvalue is {least:.3g}"
        )


def _tell(sentence: str) -> None:
    warnings.warn(sentence, BacksightWarning, stacklevel=2)


def _listed(places: Places, numbers: Indices) -> str:
    names = [places.names[i] if places.names else str(i) for i in numbers[:MOST_NAMES]]
    more = f" and {len(numbers) - MOST_NAMES} more" if len(numbers) > MOST_NAMES else ""
    word = "coordinate" if len(numbers) == 1 else f"{len(numbers)} coordinates"
    return f"{word} ({', '.join(names)}{more}) {'has' if len(numbers) == 1 else 'have'}"


def _rows(given: Equations, places: Places) -> Sparse:
    if isinstance(given, list | tuple) and all(isinstance(row, Mapping) for row in given):
        columns = [places.weights(row, f"constraint {i + 1}") for i, row in enumerate(given)]
        return (
            scipy.sparse.csc_array(scipy.sparse.hstack(columns).T)
            if columns
            else scipy.sparse.csc_array((0, places.n))
        )
    C: Any = given if scipy.sparse.issparse(given) else np.atleast_2d(np.asarray(given, float))
    if C.shape[1] != places.n:
        raise ModelError(
            f"constraints have {C.shape[1]} columns; {places.n} coordinates need as many"
        )
    return scipy.sparse.csc_array(C).astype(float)


def _null_space(C: Sparse) -> tuple[Sparse, Indices]:
    """Basis of C x = 0 and the coordinates of x that are its own."""
    n = C.shape[1]
    used = np.flatnonzero(np.diff(C.indptr))
    if not used.size:
        return scipy.sparse.csc_array(scipy.sparse.identity(n, format="csc")), np.arange(n)
    R, order = scipy.linalg.qr(C[:, used].toarray(), mode="r", pivoting=True)
    size = np.abs(np.diagonal(R))
    rank = int((size > _DEPENDENT * size[0]).sum())
    dependent, others = used[order[:rank]], used[order[rank:]]
    follows = -scipy.linalg.solve_triangular(R[:rank, :rank], R[:rank, rank:])
    free = np.setdiff1d(np.arange(n), dependent)
    column = np.full(n, -1)
    column[free] = np.arange(free.size)
    shape = (n, free.size)
    kept = scipy.sparse.csc_array((np.ones(free.size), (free, column[free])), shape=shape)
    rows, columns = np.meshgrid(dependent, column[others], indexing="ij")
    entries = (follows.ravel(), (rows.ravel(), columns.ravel()))
    made = scipy.sparse.csc_array(kept + scipy.sparse.csc_array(entries, shape=shape))
    made.eliminate_zeros()
    return made, free
