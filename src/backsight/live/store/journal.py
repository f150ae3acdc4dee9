"""What came and is in no part yet, for sources that are told when it is safe.

A broker waits for an acknowledgement before it sends much more, far less than the time between two
parts. So payloads are written to a journal as they are taken, and acknowledged when that is on the
disk. A part that holds what became of them makes the journal before it superfluous.
"""

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from backsight.output import writing

_HEAD = struct.Struct("<IdI")
"""Length of what follows, time of arrival, checksum of what follows."""

_PREFIX = ".journal-"


class Journal:
    """Payloads in the order in which they were taken.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.left = self._files()
        """Journals of the run before."""
        self._number = 1 + max((int(p.name.removeprefix(_PREFIX)) for p in self.left), default=0)
        self._open()

    def _files(self) -> list[Path]:
        found = [p for p in self._folder.glob(f"{_PREFIX}*") if p.name[len(_PREFIX) :].isdigit()]
        return sorted(found, key=lambda p: int(p.name.removeprefix(_PREFIX)))

    def _open(self) -> None:
        self._path = self._folder / f"{_PREFIX}{self._number}"
        with writing(self._folder):
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)

    def append(self, source: str, payloads: Sequence[tuple[float, bytes]]) -> Callable[[], None]:
        """Write payloads of a source; what is returned waits until they are on the disk.

        Raises
        ------
        OutputError
            If the disk is full.
        """
        name = json.dumps(source).encode() + b"\n"
        content = bytearray()
        for moment, payload in payloads:
            body = name + payload
            content += _HEAD.pack(len(body), moment, zlib.crc32(body)) + body
        number = self._file
        with writing(self._folder):
            written = 0
            while written < len(content):
                written += os.write(number, memoryview(content)[written:])

        def wait() -> None:
            with writing(self._folder):
                os.fsync(number)

        return wait

    def turn(self) -> Callable[[], None]:
        """Begin a new journal; what is returned removes those before it."""
        old, files = self._file, [*self.left, self._path]
        self.left = []
        self._number += 1
        self._open()

        def remove() -> None:
            os.close(old)
            for file in files:
                file.unlink(missing_ok=True)

        return remove

    def close(self) -> None:
        """Close it; what is in it stays."""
        os.close(self._file)


def journaled(files: Sequence[Path]) -> Iterator[tuple[str, float, bytes]]:
    """Source, time of arrival and payload of all that is whole in journals, in order."""
    for file in files:
        content, at = file.read_bytes(), 0
        while at + _HEAD.size <= len(content):
            length, moment, checksum = _HEAD.unpack_from(content, at)
            body = content[at + _HEAD.size : at + _HEAD.size + length]
            if len(body) < length or zlib.crc32(body) != checksum:
                break  # the end was not written, and was not acknowledged either
            name, _, payload = body.partition(b"\n")
            yield json.loads(name), moment, payload
            at += _HEAD.size + length
