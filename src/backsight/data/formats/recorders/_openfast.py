"""Binary output of OpenFAST; its text output is a text like others."""

import dataclasses
import struct
from pathlib import Path
from typing import IO

import numpy as np

from backsight.data._pick import present
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_room
from backsight.errors import DataError
from backsight.types import Array


def read_outb(path: Path, request: Request) -> Contents:
    """Read channels of OpenFAST's binary output; ``Time`` is one of them.

    Values are packed in 16 bits with a scale and an offset per channel, or doubles; the layout is
    that of OpenFAST's ``WrBinFAST``.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = _Head.read(file, size)
        channels, samples = len(head.names) - 1, head.samples
        check_room(8 * channels * samples, "the output")
        if head.kind == 1:
            time = (_take(file, size, "i", samples) - head.clock[1]) / head.clock[0]
        else:
            time = head.clock[0] + head.clock[1] * np.arange(samples)
        code = "d" if head.kind == 3 else "h"
        table = _take(file, size, code, channels * samples).reshape(samples, channels)
    places = {name: k for k, name in enumerate(head.names)}
    columns: dict[str, Array] = {}
    for name in present(request.wanted, places):
        k = places[name] - 1
        if k < 0:
            columns[name] = time
        elif head.packing is None:
            columns[name] = table[:, k].astype(float)
        else:
            scale, offset = head.packing
            columns[name] = (table[:, k] - offset[k].astype(float)) / scale[k]
    found = {name: head.units[places[name]].strip("()") for name in columns}
    return Contents(columns, found, time=time)


def list_outb(path: Path, _: Request) -> list[Listed]:
    """List the channels."""
    with path.open("rb") as file:
        return [Listed(name) for name in _Head.read(file, path.stat().st_size).names]


@dataclasses.dataclass(frozen=True)
class _Head:
    """What stands before the values.

    Parameters
    ----------
    kind : int
        1: times are packed, too; 2: even times; 3: values are doubles; 4: long names.
    names, units : tuple of str
        Of time and the channels.
    samples : int
    clock : (2,) array
        Scale and offset of time, or first time and period [s].
    packing : pair of arrays or None
        Scale and offset of every channel.
    """

    kind: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: int
    clock: np.ndarray
    packing: tuple[np.ndarray, np.ndarray] | None

    @classmethod
    def read(cls, file: IO[bytes], size: int) -> "_Head":
        """Read it; raises `DataError` if this is something else."""
        kind = int(_take(file, size, "h")[0])
        if kind not in (1, 2, 3, 4):
            raise DataError(f"this is not OpenFAST's binary output: its kind is {kind}")
        width = int(_take(file, size, "h")[0]) if kind == 4 else 10
        channels, samples = (int(n) for n in _take(file, size, "i", 2))
        if channels < 0 or samples < 0 or width < 1:
            raise DataError("the file claims a negative size")
        clock = _take(file, size, "d", 2)
        packing = None
        if kind != 3:
            packing = _take(file, size, "f", channels), _take(file, size, "f", channels)
        _take(file, size, "b", int(_take(file, size, "i")[0]))  # description
        labels = [_label(_take(file, size, "b", width)) for _ in range(2 * (channels + 1))]
        names, units = tuple(labels[: channels + 1]), tuple(labels[channels + 1 :])
        return cls(kind, names, units, samples, clock, packing)


def _take(file: IO[bytes], size: int, code: str, count: int = 1) -> np.ndarray:
    needed = struct.calcsize(code) * count
    if needed < 0 or file.tell() + needed > size:
        raise DataError("the file is cut off, or not of OpenFAST")
    return np.frombuffer(file.read(needed), f"<{code}", count)


def _label(characters: np.ndarray) -> str:
    return characters.tobytes().decode("latin-1").strip(" \0")
