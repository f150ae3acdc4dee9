"""Cut a stream of bytes into lines or records."""

from backsight.errors import ProblemError
from backsight.live.sources._decoding import LONGEST, record_of
from backsight.problem.reading.tables import MessageTable


class Cutter:
    """Pieces of a stream that come in any sizes.

    Parameters
    ----------
    feed : MessageTable
    where : str
        Its key, for messages.

    Raises
    ------
    ProblemError
        If what comes has no ends.
    """

    def __init__(self, feed: MessageTable, where: str) -> None:
        if feed.format == "cbor":
            raise ProblemError(f"{where}.format: cbor is for messages, a stream has no ends of it")
        self._size = record_of(feed, where).itemsize if feed.format == "packed" else 0
        self._rest = b""
        self.oversized = 0
        """Lines that were too long and thrown away."""

    def cut(self, chunk: bytes) -> list[bytes]:
        """Whole lines or records; the rest is kept."""
        self._rest += chunk
        if self._size:
            whole = len(self._rest) // self._size * self._size
            found, self._rest = self._rest[:whole], self._rest[whole:]
            return [found] if found else []
        *lines, self._rest = self._rest.split(b"\n")
        if len(self._rest) > LONGEST:
            self._rest, self.oversized = b"", self.oversized + 1
        return [line for line in lines if line.strip()]

    def forget(self) -> bytes:
        """What is left at the end of the stream; a record that is not whole is thrown away."""
        rest, self._rest = self._rest, b""
        return b"" if self._size else rest.strip()
