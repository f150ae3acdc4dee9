"""Datagrams."""

import socket

from backsight.live.sources._decoding import payload_decoder
from backsight.live.sources._streams import bound
from backsight.live.sources.base import ReceivingSource
from backsight.problem.reading.tables import UdpFeed

_ROOM = 8 * 2**20
"""Bytes that the system shall keep while nobody receives; it may give less."""


class UdpSource(ReceivingSource):
    """Datagrams, each with one or more lines, objects or records."""

    def __init__(self, name: str, feed: UdpFeed) -> None:
        super().__init__(name, feed, payload_decoder(feed, f"source.{name}"))
        self._place, self._lines = (feed.host, feed.port), feed.format in ("text", "json")
        self.port = feed.port
        """Port that is listened on."""

    def open(self) -> None:
        """See `LiveSource.open`."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _ROOM)
        bound(self._socket, self._place, self.name)
        self._socket.settimeout(0.2)
        self.port = self._socket.getsockname()[1]
        self.state = f"listens on {self._place[0]}:{self.port}"

    def receive(self) -> None:
        """See `ReceivingSource.receive`."""
        receive, put = self._socket.recv, self.inbox.put
        while not self.stopping.is_set():
            try:
                datagram = receive(65536)
            except TimeoutError:
                continue
            if self._lines and b"\n" in datagram:
                self.inbox.put_many([line for line in datagram.split(b"\n") if line.strip()])
            else:
                put(datagram)

    def stop(self) -> None:
        """See `LiveSource.stop`."""
        super().stop()
        self._socket.close()
