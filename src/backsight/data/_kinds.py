"""What kind of file a file is: by what is in it, and by its suffix where that does not tell."""

import re
import zipfile
from pathlib import Path
from typing import Any

from backsight.errors import DataError, nearest
from backsight.plugins import Extended

TEXT = (".csv", ".tsv", ".txt")
"""Suffixes of text files."""

PACKED = {b"\x1f\x8b": ".gz", b"BZh": ".bz2", b"\xfd7zXZ\0": ".xz", b"PK\x03\x04": ".zip"}
"""First bytes of compressed files."""

SIGNS = {
    b"MATLAB 5.0 MAT-file": ".mat",
    b"MATLAB 7.3 MAT-file": ".mat",
    b"\x89HDF\r\n\x1a\n": ".h5",
    b"CDF\x01": ".nc",
    b"CDF\x02": ".nc",
    b"CDF\x05": ".nc",
    b"\x93NUMPY": ".npy",
    b"LabVIEW Measurement": ".lvm",
    b"TDSm": ".tdms",
    b"PAR1": ".parquet",
    b"ARROW1": ".feather",
    b"MDF     ": ".mf4",
    b"UnFinMF ": ".mf4",
    b"\x89MCAP0\r\n": ".mcap",
    b"SQLite format 3\0": ".db3",
    b"#ROSBAG V2": ".bag",
}
"""First bytes of files, to the suffix whose reader takes them."""

_LOOK = 4096


def kind_of(path: Path, wish: str | None, known: Extended[Any]) -> str:
    """Suffix whose reader takes a file.

    Raises
    ------
    DataError
        If the kind that is wished for, or that the file is, is not read.
    """
    suffix = path.suffix.lower()
    if wish is not None:
        kind = TEXT[0] if wish == "text" else f".{wish.lstrip('.').lower()}"
        if kind not in known:
            hint = nearest(wish, ["text", *(k[1:] for k in known)])
            raise DataError(f"{path}: there is no format '{wish}': {hint}")
        return kind
    if suffix in known and suffix not in known.own:
        return suffix  # an extension knows its files best
    if path.is_dir():
        return ".db3" if is_bag_folder(path) else ".parquet"
    with path.open("rb") as file:
        head = file.read(_LOOK)
    found = _by_content(path, head, suffix)
    kind = found or suffix
    if kind not in known:
        hint = known.hint(kind)
        raise DataError(f"{path}: files of the kind '{kind}' are not read: {hint}")
    return kind


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def begins_with(path: Path, sign: bytes) -> bool:
    """Whether a file has these first bytes."""
    with path.open("rb") as file:
        return file.read(len(sign)) == sign


def _by_content(path: Path, head: bytes, suffix: str) -> str | None:
    for sign, kind in SIGNS.items():
        if head.startswith(sign):
            return suffix if (kind, suffix) in ((".h5", ".nc"), (".h5", ".hdf5")) else kind
    if head.startswith((b"RIFF", b"RIFX")) and head[8:12] == b"WAVE":
        return ".wav"
    if re.match(rb"\s*-1\s*\r?\n\s*(15|55|58b?|82|151|164)\b", head):
        return ".uff"
    if suffix in (".dat", ".sel") and _is_hawc2(path, head):
        return ".sel"
    for sign, kind in PACKED.items():
        if head.startswith(sign):
            return _in_archive(path) if kind == ".zip" else TEXT[0]
    if suffix in TEXT or not head:
        return None
    return TEXT[0] if _is_text(head) else None


def members(archive: zipfile.ZipFile) -> list[str]:
    """Files in an archive, without what systems put beside them."""
    names = [name for name in archive.namelist() if not name.endswith("/")]
    return [n for n in names if not n.startswith("__MACOSX/") and not n.endswith(".DS_Store")]


def kind_inside(head: bytes) -> str:
    """What unpacked bytes are if they are no text: the suffix of their kind, or ""."""
    return next((kind for sign, kind in SIGNS.items() if head.startswith(sign)), "")


def _is_hawc2(path: Path, head: bytes) -> bool:
    """Whether this is a result of HAWC2: a list of channels, or numbers beside one."""
    if path.suffix.lower() == ".sel":
        return b"Scans" in head
    for suffix in (".sel", ".SEL"):
        if (beside := path.with_suffix(suffix)).is_file():
            with beside.open("rb") as file:
                return b"Scans" in file.read(_LOOK)
    return False


def _in_archive(path: Path) -> str | None:
    try:
        with zipfile.ZipFile(path) as archive:
            names = members(archive)
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):
        return None
    if names and all(name.endswith(".npy") for name in names):
        return ".npz"
    if "[Content_Types].xml" in names:
        return ".xlsx"
    # Of several, the reader of texts says that one is wanted.
    return TEXT[0] if names else None


def _is_text(head: bytes) -> bool:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    printable = sum(byte >= 32 or byte in b"\t\r\n\f\v" for byte in head)
    return b"\0" not in head and printable == len(head)
