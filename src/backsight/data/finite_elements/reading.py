"""Which reader takes a matrix: what is in the file decides."""

from __future__ import annotations

import codecs
import os
import re
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, TypeAlias

from backsight.data._kinds import PACKED
from backsight.data._room import check_room
from backsight.data.finite_elements._binary import read_mat_matrix, read_npy_matrix, read_npz_matrix
from backsight.data.finite_elements._headed import BOEING, MARKET, read_boeing, read_market
from backsight.data.finite_elements._nastran import read_dmig
from backsight.data.finite_elements._op4 import is_op4, read_op4
from backsight.data.finite_elements._texts import ABAQUS, read_abaqus, read_table
from backsight.data.finite_elements.matrix import Matrix
from backsight.data.texts.content import content_of
from backsight.description import checked
from backsight.errors import DataError

MatrixFormat: TypeAlias = Literal[
    "matrix-market", "harwell-boeing", "mat", "npz", "npy", "abaqus", "dmig", "op4", "table"
]
"""Kinds of files."""

_LOOK = 1 << 16

_MARKS = (codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

_SUFFIXES = tuple(PACKED.values())


READERS: Mapping[MatrixFormat, Callable[[Path, str | None], Matrix]] = {
    "matrix-market": lambda path, _: read_market(path),
    "harwell-boeing": lambda path, _: read_boeing(path),
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
    them, a table with the names of the coordinates above, or lines ``row column value``. Texts may
    be packed (gz, bz2, xz, zip of one).

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
        return _unpacked(file, name, format) if _is_packed(file) else _read(file, name, format)
    except DataError as error:
        message = str(error)
        raise DataError(message if str(file) in message else f"{file}: {message}") from None
    except FileNotFoundError:
        raise DataError(f"there is no file '{file}'") from None
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"cannot read the matrix in '{file}': {error}") from None


def _read(file: Path, name: str | None, form: MatrixFormat | None) -> Matrix:
    return READERS[form or _kind_of(file)](file, name)


def _is_packed(file: Path) -> bool:
    """Whether it is a text that is packed, or begins with the mark of its encoding."""
    with file.open("rb") as stream:
        head = stream.read(8)
    if head.startswith(_MARKS):
        return True
    kind = next((k for sign, k in PACKED.items() if head.startswith(sign)), "")
    if kind != ".zip":
        return bool(kind)
    with zipfile.ZipFile(file) as archive:
        return not any(member.endswith(".npy") for member in archive.namelist())


def _unpacked(file: Path, name: str | None, form: MatrixFormat | None) -> Matrix:
    """Read the plain text beside which readers need not know anything."""
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder, file.with_suffix("").name if file.suffix in _SUFFIXES else file.name)
        plain.write_bytes(content_of(file, None))
        try:
            return _read(plain, name, form)
        except DataError as error:
            raise DataError(str(error).replace(str(plain), str(file))) from None


def _kind_of(file: Path) -> MatrixFormat:
    with file.open("rb") as stream:
        head = stream.read(_LOOK)
    if head[: len(MARKET)].lower() == MARKET.lower():
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
    if len(lines) > 3 and BOEING.match(lines[2].upper()):
        return "harwell-boeing"
    plain = [line for line in lines if line.strip() and not line.startswith(("*", "#", "%"))]
    return "abaqus" if plain and ABAQUS.match(plain[0]) else "table"
