"""Files of the (invented) block logger.

A text header, one line each for the names and the resolution of the channels, then rows of 32-bit
integers, little endian. The largest integer is "no reading".
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from backsight.errors import DataError

MAGIC = b"BLOCKLOG 1\n"
NO_READING = np.iinfo("<i4").max


def read_blk(path: Path, wanted: Sequence[str]) -> dict[str, np.ndarray]:
    """Read columns of a file; see `backsight.read`.

    Raises
    ------
    DataError
        If it is no such file, or is cut off.
    """
    del wanted  # all of it is read at once
    magic, names, steps, counts = _split(path.read_bytes())
    if magic + b"\n" != MAGIC:
        raise DataError("is no file of a block logger")
    channels = names.decode().split()
    if len(counts) % (4 * len(channels)):
        raise DataError("is cut off in the middle of a row")
    rows = np.frombuffer(counts, "<i4").reshape(-1, len(channels))
    values = np.where(rows == NO_READING, np.nan, rows * np.array(steps.split(), float))
    return dict(zip(channels, values.T, strict=True))


def write_blk(path: Path, columns: Mapping[str, np.ndarray], steps: Mapping[str, float]) -> None:
    """Write columns with the resolution of each; NaN is "no reading"."""
    rows = np.stack([columns[name] / step for name, step in steps.items()], axis=1)
    counts = np.where(np.isnan(rows), NO_READING, np.rint(rows)).astype("<i4")
    header = f"{' '.join(steps)}\n{' '.join(map(str, steps.values()))}\n"
    path.write_bytes(MAGIC + header.encode() + counts.tobytes())


def _split(content: bytes) -> list[bytes]:
    parts = content.split(b"\n", 3)
    return [*parts, *[b""] * (4 - len(parts))]
