"""Sounds (WAV)."""

from pathlib import Path

import numpy as np
import scipy.io.wavfile

from backsight.data._pick import pick
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_room


def read_wav(path: Path, request: Request) -> Contents:
    """Read channels of a sound, ``data[0]``, ...: whole numbers are counts as they are stored."""
    check_room(path.stat().st_size * 8, "the sound")
    rate, values = scipy.io.wavfile.read(path)
    matrix = np.asarray(values).reshape(len(values), -1)
    arrays = {str(k): matrix[:, k] for k in range(matrix.shape[1])} | {"data": matrix}
    columns = pick(arrays, request.wanted, axis=0)
    return Contents(columns, time=np.arange(len(matrix)) / rate)


def list_wav(path: Path, _: Request) -> list[Listed]:
    """List the channels."""
    _, values = scipy.io.wavfile.read(path, mmap=True)
    channels = np.reshape(values, (len(values), -1)).shape[1]
    return [Listed(f"data[{k}]") for k in range(channels)]
