"""Which reader takes a matrix: what is in the file decides."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, TypeAlias

import scipy

from backsight.data._room import check_room
from backsight.data.finite_elements._binary import read_mat_matrix, read_npy_matrix, read_npz_matrix
from backsight.data.finite_elements._nastran import read_dmig
from backsight.data.finite_elements._op4 import is_op4, read_op4
from backsight.data.finite_elements._texts import ABAQUS, read_abaqus, read_table
from backsight.data.finite_elements.matrix import Matrix, precision_of
from backsight.description import checked
from backsight.errors import DataError

MatrixFormat: TypeAlias = Literal[
    "matrix-market", "harwell-boeing", "mat", "npz", "npy", "abaqus", "dmig", "op4", "table"
]
"""Kinds of files."""

_BOEING = re.compile(r"[RP][SURZH][AE]\s")
"""Type of a matrix at the begin of the third line of a Harwell-Boeing file."""

_LOOK = 1 << 16


def _market(path: Path, name: str | None) -> Matrix:
    del name
    with path.open(encoding="latin-1") as file:
        head = (line.split() for line in file.readlines(_LOOK) if not line.startswith("%"))
        precision = precision_of([cells[-1] for cells in head if cells][1:])
    return Matrix(_real(scipy.io.mmread(path, spmatrix=False)), (), precision, path.stem)


def _boeing(path: Path, name: str | None) -> Matrix:
    del name
    lines = path.read_text(encoding="latin-1").splitlines(keepends=True)
    kind = lines[2][:3].upper()
    # SciPy reads them as they are stored, but refuses the symmetric by their head.
    text = "".join(
        [*lines[:2], lines[2].replace(lines[2][:3], f"{kind[0]}U{kind[2]}", 1), *lines[3:]]
    )
    A = _real(scipy.io.hb_read(io.StringIO(text), spmatrix=False))
    mirrored = scipy.sparse.csc_array(A + scipy.sparse.tril(A, -1).T) if kind[1] == "S" else A
    return Matrix(mirrored, name=path.stem)


def _real(found: object) -> scipy.sparse.csc_array:
    A = scipy.sparse.csc_array(found)
    if A.dtype.kind not in "biuf":
        raise DataError("it is a complex matrix")
    return A


READERS: Mapping[MatrixFormat, Callable[[Path, str | None], Matrix]] = {
    "matrix-market": _market,
    "harwell-boeing": _boeing,
    "mat": read_mat_matrix,
    "npz": read_npz_matrix,
    "npy": lambda path, _: read_npy_matrix(path),
    "abaqus": lambda path, _: read_abaqus(path),
    "dmig": read_dmig,
    "op4": read_op4,
    "table": lambda path, _: read_table(path),
}
"""Reader of every format: (path, name of the matrix in the file) to matrix."""


@checked(DataError, only=("name", "format"))
def read_matrix(
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    format: MatrixFormat | None = None,  # noqa: A002 - as in `read`
) -> Matrix:
    """Read a mass, damping or stiffness matrix that a finite-element program wrote.

    Matrix Market, MAT, NumPy (also sparse), Harwell-Boeing, Abaqus (``*MATRIX GENERATE``: .mtx),
    Nastran (DMIG in bulk data and punch files, OP4), and texts: rows of numbers, as OpenSees prints
    them, a table with the names of the coordinates above, or lines ``row column value``.

    Parameters
    ----------
    path : path
        The file. What is in it decides how it is read.
    name : str, optional
        Which matrix, in files that hold several; in a structure of MATLAB ``model/K``.
    format : str, optional
        One of `MatrixFormat`, if the file is taken for something else.

    Returns
    -------
    Matrix
        With the names of the coordinates, ``"node:direction"`` ("12:UX"), where the file has them.

    Raises
    ------
    DataError
        If the file cannot be read, or holds several matrices and none is named.
    """
    file = Path(path)
    try:
        check_room(file.stat().st_size, f"'{file}'")
        return READERS[format or _kind_of(file)](file, name)
    except DataError as error:
        message = str(error)
        raise DataError(message if str(file) in message else f"{file}: {message}") from None
    except FileNotFoundError:
        raise DataError(f"there is no file '{file}'") from None
    except (OSError, ValueError, LookupError, EOFError) as error:
        raise DataError(f"cannot read the matrix in '{file}': {error}") from None


def _kind_of(file: Path) -> MatrixFormat:
    with file.open("rb") as stream:
        head = stream.read(_LOOK)
    if head.startswith(b"%%MatrixMarket"):
        return "matrix-market"
    if head.startswith((b"MATLAB", b"\x89HDF")):
        return "mat"
    if head.startswith(b"\x93NUMPY"):
        return "npy"
    if head.startswith(b"PK\x03\x04"):
        return "npz"
    if is_op4(head):
        return "op4"
    if b"\0" in head:
        raise DataError(f"'{file}' is a binary file of an unknown kind")
    lines = head.decode("latin-1").splitlines()
    if any(re.match(r"DMIG\b", line, re.IGNORECASE) for line in lines):
        return "dmig"
    if len(lines) > 3 and _BOEING.match(lines[2].upper()):
        return "harwell-boeing"
    plain = [line for line in lines if line.strip() and not line.startswith(("*", "#", "%"))]
    return "abaqus" if plain and ABAQUS.match(plain[0]) else "table"
