"""Matrices in texts whose head says how they are stored: Matrix Market, Harwell-Boeing."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import scipy

from backsight.data.finite_elements.matrix import Matrix, precision_of
from backsight.errors import DataError

MARKET = b"%%MatrixMarket"
"""Begin of a Matrix Market file; some programs write it in small letters."""

BOEING = re.compile(r"[RPC][SURZH][AE]\s")
"""Type of a matrix at the begin of the third line of a Harwell-Boeing file."""

_LOOK = 1 << 16


def read_market(path: Path) -> Matrix:
    """Read a Matrix Market file, of which the head may say that one triangle stands for both.

    Source: Boisvert, Pozo, Remington, "The Matrix Market exchange formats", NISTIR 5935, 1996.
    """
    with path.open("rb") as file:
        head = file.read(_LOOK)
    words = head.split(b"\n", 1)[0].decode("latin-1").lower().split()
    if "pattern" in words:
        raise DataError("it holds a pattern, the places of entries without their numbers")
    lines = [line for line in head.decode("latin-1").splitlines() if not line.startswith("%")]
    cells = [line.split() for line in lines if line.strip()]
    source: Any = path
    if not head.startswith(MARKET):
        source = io.BytesIO(MARKET + path.read_bytes()[len(MARKET) :])
    found = scipy.io.mmread(source, spmatrix=False)
    A = _real(found)
    if words[-1:] != ["general"] and scipy.sparse.issparse(found):
        _check_once(found.nnz, A, words[-1])
    return Matrix(A, (), precision_of([row[-1] for row in cells[1:]]), path.stem)


def read_boeing(path: Path) -> Matrix:
    """Read a Harwell-Boeing file: whole, or symmetric (S) or skew (Z) with the lower triangle.

    Source: Duff, Grimes, Lewis, "Users' guide for the Harwell-Boeing sparse matrix collection",
    1992, section 2.
    """
    lines = path.read_text(encoding="latin-1").splitlines(keepends=True)
    kind = lines[2][:3].upper()
    if kind[0] == "P":
        raise DataError("it holds a pattern, the places of entries without their numbers")
    if kind[0] == "C":
        raise DataError("it is a complex matrix")
    # SciPy reads them as they are stored, but refuses the symmetric by their head.
    text = "".join([*lines[:2], f"{kind[0]}U{kind[2]}{lines[2][3:]}", *lines[3:]])
    A = _real(scipy.io.hb_read(io.StringIO(text), spmatrix=False))
    if kind[1] in "SZH":
        below, above = scipy.sparse.tril(A, -1), scipy.sparse.triu(A, 1)
        if below.nnz and above.nnz:
            raise DataError(_TWICE.format(kind))
        mirrored = (below + above).T
        A = scipy.sparse.csc_array(A - mirrored if kind[1] == "Z" else A + mirrored)
    return Matrix(A, name=path.stem)


_TWICE = (
    "its head says '{}', that one triangle stands for both, but entries are there twice; "
    "if both triangles are written, its head must say that it is general"
)


def _check_once(entries: int, A: scipy.sparse.csc_array, word: str) -> None:
    """Raise `DataError` if entries and mirror images of others fell together, and were added."""
    if A.nnz < entries:
        raise DataError(_TWICE.format(word))


def _real(found: object) -> scipy.sparse.csc_array:
    A = scipy.sparse.csc_array(found)
    A.sum_duplicates()
    if A.dtype.kind not in "biuf":
        raise DataError("it is a complex matrix")
    return A
