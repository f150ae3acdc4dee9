"""Sounds (WAV)."""

import struct
from pathlib import Path

import numpy as np
import scipy

from backsight.data._pick import pick
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_room
from backsight.errors import DataError

_MIDDLE = 128
"""What 8 bits, which have no sign, hold at rest."""


def read_wav(path: Path, request: Request) -> Contents:
    """Read channels of a sound, ``data[0]``, ...: whole numbers are counts of the converter."""
    check_room(path.stat().st_size * 8, "the sound")
    rate, values = scipy.io.wavfile.read(path)
    matrix = _counts(np.asarray(values).reshape(len(values), -1), _bits(path))
    arrays = {str(k): matrix[:, k] for k in range(matrix.shape[1])} | {"data": matrix}
    columns = pick(arrays, request.wanted, axis=0)
    return Contents(columns, time=np.arange(len(matrix)) / rate)


def list_wav(path: Path, _: Request) -> list[Listed]:
    """List the channels."""
    _, values = scipy.io.wavfile.read(path, mmap=_bits(path) != 24)
    channels = np.reshape(values, (len(values), -1)).shape[1]
    return [Listed(f"data[{k}]") for k in range(channels)]


def _counts(values: np.ndarray, bits: int) -> np.ndarray:
    """SciPy moves 24 bits up to 32, and leaves 8 bits without a sign."""
    if values.dtype == np.uint8:
        return values.astype(np.int16) - _MIDDLE
    return values >> 8 if values.dtype == np.int32 and bits == 24 else values


def _bits(path: Path) -> int:
    """Bits of a sample in the file."""
    with path.open("rb") as file:
        order = ">" if file.read(12)[:4] == b"RIFX" else "<"
        while len(head := file.read(8)) == 8:
            name, size = head[:4], struct.unpack(f"{order}I", head[4:])[0]
            if name == b"fmt ":
                return int(struct.unpack(f"{order}H", file.read(16)[14:])[0])
            file.seek(size + size % 2, 1)
    raise DataError("the sound does not say how its samples are stored")
