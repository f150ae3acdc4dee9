"""Whether the elements of a MAT file of version 5 are what they must be.

SciPy takes the number of an element's type for a place in a table, without a look whether the table
is that long: a damaged file, or one made for it, reads memory that is not its own. So all types,
and the sizes of elements inside each other, are looked at before it reads anything.
MATLAB, MAT-File Format, R2023b.
"""

import struct
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import IO

NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
"""Types of elements that are numbers."""

TEXTS = frozenset({1, 2, 3, 4, 16, 17, 18})
MATRIX, COMPRESSED = 14, 15
CHAR, NUMERIC = 4, range(6, 16)
"""Classes of matrices; the others are made of matrices and numbers."""

DEEPEST = 64
_STEP = 1 << 16


class _Bytes:
    """Bytes that come one after the other, unpacked on the way."""

    def __init__(self, file: IO[bytes], size: int, *, packed: bool) -> None:
        self._file, self._rest = file, size
        self._unpacker = zlib.decompressobj() if packed else None

    def read(self, size: int) -> bytes:
        """So many bytes.

        Raises
        ------
        ValueError
            If there are not as many.
        """
        found = b""
        while len(found) < size and (more := self._some(size - len(found))):
            found += more
        if len(found) < size:
            raise ValueError("an element ends before its content")
        return found

    def skip(self, size: int) -> None:
        """Pass over so many bytes."""
        while size > 0:
            size -= len(self.read(min(size, _STEP)))

    def _some(self, most: int) -> bytes:
        if self._unpacker is None:
            found = self._file.read(min(most, self._rest))
            self._rest -= len(found)
            return found
        while True:
            given = self._unpacker.unconsumed_tail
            if not given and self._rest:
                given = self._file.read(min(_STEP, self._rest))
                self._rest -= len(given)
            found = self._unpacker.decompress(given, most)
            if found or not (given or self._rest):
                return found


def check_elements(path: Path) -> None:
    """Raise `ValueError` if an element of a file has a type or a size that it cannot have."""
    end = path.stat().st_size
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(128)[126:128])
        while order and file.tell() + 8 <= end:
            kind, size = struct.unpack(f"{order}II", file.read(8))
            start = file.tell()
            if kind not in (MATRIX, COMPRESSED):
                raise ValueError(f"a variable has the type {kind}")
            content = _Bytes(file, min(size, end - start), packed=kind == COMPRESSED)
            inside = size
            if kind == COMPRESSED:
                kind, inside, _ = _tag(content, order)
                if kind != MATRIX:
                    raise ValueError(f"a packed variable has the type {kind}")
            _matrix(content, inside, order, 0)
            file.seek(start + size)


def _tag(content: _Bytes, order: str) -> tuple[int, int, int]:
    """Type and size of an element, and the bytes after its head; small ones are in the head."""
    head = content.read(8)
    first, size = struct.unpack(f"{order}II", head)
    if first >> 16:
        if first >> 16 > 4:
            raise ValueError("a small element is larger than 4 bytes")
        return first & 0xFFFF, first >> 16, 0
    return first, size, size + -size % 8


def _matrix(content: _Bytes, size: int, order: str, depth: int) -> None:
    """Look at the elements of a matrix of `size` bytes."""
    if size == 0:
        return  # an empty cell
    if depth > DEEPEST:
        raise ValueError(f"matrices are more than {DEEPEST} deep in each other")
    kind, length, rest = _tag(content, order)
    if (kind, length) != (6, 8):
        raise ValueError("a matrix does not begin with its class")
    (flags, _) = struct.unpack(f"{order}II", content.read(8))
    size -= 8 + rest
    of_class = flags & 0xFF
    allowed: Collection[int] = NUMBERS | {MATRIX}
    if of_class in NUMERIC:
        allowed = NUMBERS
    number = 1
    while size >= 8:
        kind, length, rest = _tag(content, order)
        if 8 + rest > size + 7:  # the last one may lack its padding
            raise ValueError("an element is larger than what it is in")
        if of_class == CHAR and number == 3:
            allowed = TEXTS
        if kind not in allowed:
            raise ValueError(f"an element of class {of_class} has the type {kind}")
        if kind == MATRIX:
            _matrix(content, length, order, depth + 1)
            content.skip(max(min(rest, size - 8) - length, 0))
        else:
            content.skip(min(rest, size - 8))
        size -= 8 + rest
        number += 1
