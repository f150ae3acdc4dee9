"""Estimates for others, as JSON: lines, datagrams, messages of a broker."""

import abc
import collections
import json
import socket
import sys
import threading
from collections.abc import Callable, Mapping

import numpy as np

from backsight.errors import ProblemError
from backsight.live._publishing import Publisher
from backsight.live.alarms import Quantities
from backsight.live.engine import LiveRows
from backsight.problem.reading.tables import MqttSink, SinkTable, StdoutSink, UdpSink
from backsight.types import Array

MOST_WAITING = 10_000
"""Messages that wait for a receiver that is slow; beyond that the oldest are given up."""


class Outgoing(abc.ABC):
    """A way out, in a thread of its own.

    Parameters
    ----------
    name : str
    tell : callable
        Told, once, that it does not work.
    """

    def __init__(self, name: str, tell: Callable[[str], None]) -> None:
        self._name, self._tell, self._told = name, tell, False
        self._waiting: collections.deque[bytes] = collections.deque(maxlen=MOST_WAITING)
        self._more, self._stopping = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"sink {name}", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def put(self, messages: list[bytes]) -> None:
        """Send messages when it is possible."""
        self._waiting.extend(messages)
        self._more.set()

    @abc.abstractmethod
    def send(self, message: bytes) -> None:
        """Send one; OSError may be raised."""

    def _run(self) -> None:
        while True:
            self._more.wait()
            self._more.clear()
            while self._waiting:
                try:
                    self.send(self._waiting.popleft())
                except (OSError, ValueError) as error:
                    if not self._told:
                        self._tell(f"sink {self._name}: cannot send: {error}")
                    self._told = True
            if self._stopping.is_set():
                return

    def stop(self) -> None:
        """Send what waits, and no more."""
        self._stopping.set()
        self._more.set()
        self._thread.join(2.0)


class _Lines(Outgoing):
    def send(self, message: bytes) -> None:
        sys.stdout.write(message.decode() + "\n")
        sys.stdout.flush()


class _Datagrams(Outgoing):
    def __init__(self, name: str, tell: Callable[[str], None], table: UdpSink) -> None:
        super().__init__(name, tell)
        self._place = (table.host, table.port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, message: bytes) -> None:
        self._socket.sendto(message, self._place)

    def stop(self) -> None:
        super().stop()
        self._socket.close()


class _Messages(Outgoing):
    def __init__(self, name: str, tell: Callable[[str], None], table: MqttSink) -> None:
        super().__init__(name, tell)
        self._publisher = Publisher(table)

    def send(self, message: bytes) -> None:
        self._publisher.publish(message, qos=0)

    def stop(self) -> None:
        super().stop()
        self._publisher.stop()


class Sinks:
    """All who get the estimates of a run.

    Parameters
    ----------
    tables : dict
    quantities : Quantities
    states : list of str
        What is sent where nothing is chosen.
    tell : callable

    Raises
    ------
    ProblemError
        If there is no such quantity.
    PluginError
        If a package is not installed.
    """

    def __init__(
        self,
        tables: Mapping[str, SinkTable],
        quantities: Quantities,
        *,
        states: list[str],
        tell: Callable[[str], None],
    ) -> None:
        self._quantities = quantities
        self._outgoing: list[tuple[SinkTable, list[str], Outgoing]] = []
        for name, table in tables.items():
            quantities.check(table.of, f"sink.{name}")
            outgoing = _way_out(name, table, tell)
            self._outgoing.append((table, table.of or states, outgoing))
        self._due = [-np.inf] * len(self._outgoing)
        for _, _, outgoing in self._outgoing:
            outgoing.start()

    def send(self, rows: LiveRows, times: Array) -> None:
        """Send new samples (n,) with their times."""
        for j, (table, names, outgoing) in enumerate(self._outgoing):
            chosen = [k for k in range(len(times)) if self._is_due(j, float(times[k]), table.every)]
            if chosen:
                outgoing.put(self._messages(rows, times, names, chosen))

    def _is_due(self, j: int, time: float, every: float) -> bool:
        if time < self._due[j] - 1e-9:
            return False
        self._due[j] = time + every
        return True

    def _messages(
        self, rows: LiveRows, times: Array, names: list[str], chosen: list[int]
    ) -> list[bytes]:
        columns = {"t": times}
        for name in names:
            values, spread = self._quantities.of(rows, name)
            columns[name] = values
            if self._quantities.has_band(rows, name):
                columns[f"{name}_std"] = spread
        columns["nis"] = rows.values["nis"]
        status = rows.values["status"]
        messages = []
        for k in chosen:
            found = {n: float(v[k]) if np.isfinite(v[k]) else None for n, v in columns.items()}
            messages.append(json.dumps({**found, "status": int(status[k])}).encode())
        return messages

    def close(self) -> None:
        """Send what waits."""
        for _, _, outgoing in self._outgoing:
            outgoing.stop()


def _way_out(name: str, table: SinkTable, tell: Callable[[str], None]) -> Outgoing:
    match table:
        case StdoutSink():
            return _Lines(name, tell)
        case UdpSink():
            return _Datagrams(name, tell, table)
        case MqttSink():
            return _Messages(name, tell, table)
    raise ProblemError(f"sink.{name}.kind: there is nothing that sends by '{table.kind}'")
