"""Matrices of a structure as users have them: dense or sparse, one triangle, with names or not."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.data.finite_elements import EPS, Matrix
from backsight.errors import BacksightWarning, ModelError
from backsight.types import Sparse

MatrixLike: TypeAlias = ArrayLike | Matrix | Any
"""An array, a sparse matrix of SciPy, a `Matrix` from a file, or the diagonal alone."""

SKEW = 1e-9
"""A larger difference of mirrored entries, by those of the diagonal, is no rounding."""


@dataclasses.dataclass(frozen=True)
class Matrices:
    """What is given of a structure, on all of its coordinates.

    Parameters
    ----------
    mass, stiffness, damping : (n, n) sparse arrays
        In columns; mass is symmetric. Without a damping matrix all zero.
    coordinates : tuple of str
        Names, or empty.
    precision : float
        Relative rounding of the entries of the stiffness.
    skew : dict of str
        What is not symmetric, by how much and where; empty if all matrices are.
    """

    mass: Sparse
    stiffness: Sparse
    damping: Sparse
    coordinates: tuple[str, ...]
    precision: float
    skew: Mapping[str, str]

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.mass.shape[0]

    @property
    def gyroscopic(self) -> bool:
        """Whether the damping matrix is not symmetric."""
        return "damping_matrix" in self.skew


def matrices(mass: MatrixLike, stiffness: MatrixLike, damping: MatrixLike | None) -> Matrices:
    """Read the matrices, complete triangles, put coordinates of the same name together.

    Raises
    ------
    ModelError
        If one is not square, not finite or of another size than the others, if only some have named
        coordinates, or the mass is not symmetric.
    """
    given = {"mass": mass, "stiffness": stiffness}
    if damping is not None:
        given["damping_matrix"] = damping
    read = {what: _matrix(value, what) for what, value in given.items()}
    aligned, coordinates = _aligned(read)
    whole = {what: _completed(A, what) for what, A in aligned.items()}
    skew = {}
    for what, A in whole.items():
        limit = max(SKEW, 4 * read[what].precision)
        if (found := _asymmetry(A, what, limit, coordinates)) is None:
            whole[what] = scipy.sparse.csc_array((A + A.T) / 2)
        elif what == "mass":
            raise ModelError(found)
        else:
            skew[what] = found
    n = whole["mass"].shape[0]
    return Matrices(
        mass=whole["mass"],
        stiffness=whole["stiffness"],
        damping=whole.get("damping_matrix", scipy.sparse.csc_array((n, n))),
        coordinates=coordinates,
        precision=read["stiffness"].precision,
        skew=skew,
    )


def _matrix(given: MatrixLike, what: str) -> Matrix:
    """Square and finite, in columns; a row of numbers is a diagonal."""
    kept = given if isinstance(given, Matrix) else Matrix(given, precision=EPS, name=what)
    A = kept.values
    if getattr(A, "dtype", np.dtype(float)).kind == "c":
        raise ModelError(
            f"{what} is complex; give its real part, and structural damping, K (1 + i eta), as "
            "loss_factor = eta"
        )
    if scipy.sparse.issparse(A):
        if A.dtype.kind not in "biuf":
            raise ModelError(f"{what} is not a matrix of real numbers")
        precision = _precision_of(A.dtype)
        A: Sparse = scipy.sparse.csc_array(A).astype(float)
        A.sum_duplicates()
    else:
        try:
            dense = np.asarray(A)
            precision = _precision_of(dense.dtype)
            dense = dense.astype(float)
        except (TypeError, ValueError):
            raise ModelError(f"{what} is not a matrix of numbers") from None
        if what == "mass" and dense.ndim == 1 and dense.size:
            dense = np.diag(dense)
        if dense.ndim != 2:
            raise ModelError(f"{what} has the shape {dense.shape}; it must be square")
        A = scipy.sparse.csc_array(dense)
    if A.shape[0] != A.shape[1] or not A.shape[0]:
        raise ModelError(f"{what} has the shape {A.shape}; it must be square")
    if not np.isfinite(A.data).all():
        raise ModelError(f"{what} has an entry that is not finite")
    A.eliminate_zeros()
    return dataclasses.replace(kept, values=A, precision=max(precision, kept.precision))


def _precision_of(dtype: np.dtype) -> float:
    return float(np.finfo(dtype).eps) / 2 if dtype.kind == "f" and dtype.itemsize < 8 else EPS


def _aligned(read: Mapping[str, Matrix]) -> tuple[dict[str, Sparse], tuple[str, ...]]:
    """On the same coordinates: those of all matrices, in the order of the stiffness."""
    named = {what: m.coordinates for what, m in read.items() if m.coordinates}
    unnamed = [what for what, m in read.items() if not m.coordinates]
    first = read["stiffness"]
    for what in unnamed:
        if read[what].values.shape != first.values.shape:
            raise ModelError(
                f"{what} has the shape {read[what].values.shape}, but "
                f"stiffness {first.values.shape}"
                if what != "mass"
                else f"stiffness has the shape {first.values.shape}, but mass "
                f"{read[what].values.shape}"
            )
    order = tuple(dict.fromkeys(name for names in _stiffness_first(named) for name in names))
    if not named or all(names == order for names in named.values()):
        return {what: m.values for what, m in read.items()}, order
    if unnamed:
        raise ModelError(
            f"{' and '.join(named)} name their coordinates, {' and '.join(unnamed)} do not, and "
            "the order differs; take all from files that name them"
        )
    place = {name: i for i, name in enumerate(order)}
    return {what: _put(m, place) for what, m in read.items()}, order


def _stiffness_first(named: Mapping[str, tuple[str, ...]]) -> list[tuple[str, ...]]:
    return [named[w] for w in ("stiffness", "mass", "damping_matrix") if w in named]


def _put(matrix: Matrix, place: Mapping[str, int]) -> Sparse:
    at = np.array([place[name] for name in matrix.coordinates])
    entries = matrix.values.tocoo()
    shape = (len(place), len(place))
    return scipy.sparse.csc_array((entries.data, (at[entries.row], at[entries.col])), shape=shape)


def _completed(A: Sparse, what: str) -> Sparse:
    """Add the mirror image of a triangle; finite-element programs often store one only."""
    upper, lower = scipy.sparse.triu(A, 1), scipy.sparse.tril(A, -1)
    if (upper.nnz == 0) == (lower.nnz == 0):
        return A
    which = "upper" if upper.nnz else "lower"
    warnings.warn(
        f"{what}: a triangle was given, the {which} one; it is completed by its mirror image",
        BacksightWarning,
        stacklevel=2,
    )
    return scipy.sparse.csc_array(A + (upper if upper.nnz else lower).T)


def _asymmetry(A: Sparse, what: str, limit: float, coordinates: tuple[str, ...]) -> str | None:
    """By how much and where a matrix is not symmetric; None where that is rounding."""
    skew = scipy.sparse.coo_array(A - A.T)
    if not skew.nnz:
        return None
    # Judged by the diagonal: translations and rotations differ in size.
    root = np.sqrt(np.abs(A.diagonal()))
    own = np.maximum(np.abs(_at(A, skew.row, skew.col)), np.abs(_at(A, skew.col, skew.row)))
    size = np.maximum(root[skew.row] * root[skew.col], own)
    if (np.abs(skew.data) <= limit * size).all():
        return None
    whole = scipy.sparse.coo_array(A)
    sized = whole.data / np.maximum(root[whole.row] * root[whole.col], np.abs(whole.data))
    share = np.linalg.norm(skew.data / size) / 2 / np.linalg.norm(sized)
    worst = int(np.argmax(np.abs(skew.data) / np.where(size > 0, size, 1.0)))
    i, j = sorted((int(skew.row[worst]), int(skew.col[worst])))
    names = coordinates or tuple(map(str, range(A.shape[0])))
    return (
        f"{what} is not symmetric: by its diagonal, the skew part is {100 * share:.2g} % of it, "
        f"largest between the coordinates {names[i]} and {names[j]}: {A[i, j]:g} and {A[j, i]:g}"
    )


def _at(A: Sparse, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    return np.asarray(scipy.sparse.csr_array(A)[rows, columns]).ravel()
