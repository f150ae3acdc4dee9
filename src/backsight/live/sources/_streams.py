"""Sources that bring one stream of bytes: standard input, serial lines, TCP."""

import os
import select
import socket
import sys
from typing import Any

from backsight.errors import OutputError, PluginError, ProblemError
from backsight.live.sources._cutting import Cutter
from backsight.live.sources._decoding import LONGEST, payload_decoder
from backsight.live.sources.base import ReceivingSource
from backsight.problem.reading.tables import MessageTable, SerialFeed, TcpFeed

_CHUNK = 1 << 18
_LOOK_UP = 0.2
"""Seconds after which a thread that waits looks whether it shall stop."""


class StreamSource(ReceivingSource):
    """Bytes in any pieces, of which lines or records are made."""

    def __init__(self, name: str, feed: MessageTable) -> None:
        where = f"source.{name}"
        super().__init__(name, feed, payload_decoder(feed, where))
        self.cutter = Cutter(feed, where)
        self._oversized = 0

    def took(self, chunk: bytes) -> None:
        """Take in a piece."""
        self.inbox.put_many(self.cutter.cut(chunk))
        if self.cutter.oversized > self._oversized:
            self._oversized = self.cutter.oversized
            self.fault(chunk, f"is a line of more than {LONGEST} bytes")

    def broke(self) -> None:
        """Take in what is left at the end."""
        if rest := self.cutter.forget():
            self.inbox.put(rest)


class StdinSource(StreamSource):
    """Standard input; when it ends, so does the run."""

    def receive(self) -> None:
        """See `ReceivingSource.receive`."""
        number = sys.stdin.fileno()
        self.state = "reads"
        while not self.stopping.is_set():
            if not select.select([number], [], [], _LOOK_UP)[0]:
                continue
            chunk = os.read(number, _CHUNK)
            if not chunk:
                self.broke()
                self.state, self.ended = "has ended", True
                return
            self.took(chunk)


class SerialSource(StreamSource):
    """A serial line."""

    def open(self) -> None:
        """See `LiveSource.open`."""
        try:
            import serial
        except ModuleNotFoundError:
            raise PluginError(
                "a serial line needs pyserial: pip install 'backsight[live]'"
            ) from None
        self._library: Any = serial

    def receive(self) -> None:
        """See `ReceivingSource.receive`."""
        feed = self.feed
        assert isinstance(feed, SerialFeed)
        try:
            with self._library.Serial(feed.device, feed.baud, timeout=_LOOK_UP) as line:
                self.state = "reads"
                while not self.stopping.is_set():
                    chunk = line.read(max(1, line.in_waiting))
                    if chunk:
                        self.took(chunk)
        except ValueError as error:  # a rate that the line does not know
            raise OSError(str(error)) from None
        finally:
            self.cutter.forget()


class TcpSource(StreamSource):
    """A server that is connected to, or one peer after the other that connects."""

    def __init__(self, name: str, feed: TcpFeed) -> None:
        super().__init__(name, feed)
        self._place, self._listens = (feed.host, feed.port), feed.listen
        self._listening: socket.socket | None = None
        self.port = feed.port
        """Port that is listened on."""

    def open(self) -> None:
        """See `LiveSource.open`."""
        if not self._listens:
            if not self.port:
                raise ProblemError(f"source.{self.name}.port: a server has a port, not 0")
            return
        self._listening = socket.socket()
        self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound(self._listening, self._place, self.name)
        self._listening.listen(1)
        self.port = self._listening.getsockname()[1]
        self.state = f"listens on {self._place[0]}:{self.port}"

    def receive(self) -> None:
        """See `ReceivingSource.receive`."""
        if self._listening is None:
            self.state = "connects"
            with socket.create_connection(self._place, timeout=5.0) as peer:
                self._read(peer)
            return
        while not self.stopping.is_set():
            if select.select([self._listening], [], [], _LOOK_UP)[0]:
                peer, address = self._listening.accept()
                with peer:
                    self.state = f"reads from {address[0]}"
                    self._read(peer)
                self.state = f"listens on {self._place[0]}:{self.port}"

    def _read(self, peer: socket.socket) -> None:
        if not self._listens:
            self.state = "reads"
        peer.settimeout(_LOOK_UP)
        try:
            while not self.stopping.is_set():
                try:
                    chunk = peer.recv(_CHUNK)
                except TimeoutError:
                    continue
                if not chunk:
                    break
                self.took(chunk)
        finally:
            self.broke()
        if not self._listens:
            self.state = "was closed by the other side, tries again"

    def stop(self) -> None:
        """See `LiveSource.stop`."""
        super().stop()
        if self._listening is not None:
            self._listening.close()


def bound(listening: socket.socket, place: tuple[str, int], name: str) -> None:
    """Bind a socket; raises `OutputError` that names the source."""
    try:
        listening.bind(place)
    except OSError as error:
        listening.close()
        raise OutputError(
            f"source.{name}: cannot listen on {place[0]}:{place[1]}: {error.strerror or error}; "
            "take another port, or end the program that has it"
        ) from None
