"""The bytes of a text: unpacked, in UTF-8, with one kind of line ends."""

import bz2
import codecs
import gzip
import io
import lzma
import zipfile
from pathlib import Path
from typing import IO

from backsight.data._kinds import PACKED, kind_inside, members
from backsight.data._room import check_density, check_room
from backsight.errors import DataError

_CHUNK = 1 << 24
_RESERVED = 16
"""Zeros at the end that a recorder reserved and did not use, rather than a sign of UTF-32."""

_BOMS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def content_of(path: Path, encoding: str | None) -> bytes:
    r"""Read a text, which may be packed (gz, bz2, xz, zip of one file), as UTF-8 with ``\n``.

    Without `encoding`, byte order marks tell, and zeros in every other byte; lines that are not
    UTF-8 are taken as Windows-1252: the µ and ° of older loggers.

    Raises
    ------
    DataError
        If it is not text in this encoding, or is much larger unpacked than it claims to be.
    """
    raw = _unpacked(path)
    raw = raw.rstrip(b"\0") if raw.endswith(b"\0" * _RESERVED) else raw
    content = _utf8(raw, encoding)
    if b"\r" in content and content.count(b"\r") != content.count(b"\r\n"):
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return content


def _unpacked(path: Path) -> bytes:
    with path.open("rb") as file:
        head = file.read(8)
    kind = next((k for sign, k in PACKED.items() if head.startswith(sign)), None)
    match kind:
        case ".gz":
            with gzip.open(path) as packed:
                return _limited(packed, path)
        case ".bz2":
            with bz2.open(path) as packed:
                return _limited(packed, path)
        case ".xz":
            with lzma.open(path) as packed:
                return _limited(packed, path)
        case ".zip":
            with zipfile.ZipFile(path) as archive:
                names = members(archive)
                if len(names) != 1:
                    raise DataError(f"the archive holds {len(names)} files; give one with one text")
                with archive.open(names[0]) as packed:
                    return _limited(packed, path)
    return path.read_bytes()


def _limited(packed: io.BufferedIOBase | IO[bytes], path: Path) -> bytes:
    """Unpack, but no more than fits: what a packed file claims cannot be trusted."""
    stored, parts, total = path.stat().st_size, [], 0
    try:
        while part := packed.read(_CHUNK):
            parts.append(part)
            total += len(part)
            check_density(total, stored, "the packed text")
            check_room(total, "the packed text")
    except (lzma.LZMAError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"the packed text is damaged: {error}") from None
    if parts and (kind := kind_inside(parts[0])):
        raise DataError(f"inside is a file of the kind '{kind}'; unpack it first")
    return b"".join(parts)


def _utf8(raw: bytes, encoding: str | None) -> bytes:
    bom = next((mark for mark in _BOMS if raw.startswith(mark)), b"")
    if encoding is None and not bom:
        encoding = _wide(raw)
    if encoding is None and _BOMS.get(bom, "utf-8") == "utf-8":
        body = raw[len(bom) :] if bom else raw
        return body if body.isascii() else _mended(body)
    encoding = encoding or _BOMS[bom]
    try:
        return raw.decode(encoding).removeprefix("\ufeff").encode()
    except LookupError:
        raise DataError(f"there is no encoding '{encoding}'") from None
    except UnicodeError as error:
        raise DataError(f"this is not text in {encoding}: {error}") from None


def _wide(raw: bytes) -> str | None:
    """UTF-16 without a mark: every other byte of plain text is zero."""
    head = raw[:4000]
    half = len(head) // 2
    if half < 4:
        return None
    if head[1::2].count(0) > 0.9 * half and not head[::2].count(0):
        return "utf-16-le"
    if head[::2].count(0) > 0.9 * half and not head[1::2].count(0):
        return "utf-16-be"
    return None


def _mended(body: bytes) -> bytes:
    try:
        body.decode()
    except UnicodeDecodeError:
        return b"\n".join(_line(line) for line in body.split(b"\n"))
    return body


def _line(line: bytes) -> bytes:
    try:
        line.decode()
    except UnicodeDecodeError:
        try:
            return line.decode("cp1252").encode()
        except UnicodeDecodeError:
            return line.decode("latin-1").encode()
    return line
