"""What every source does: it receives in the background and hands over what came since."""

import abc
import collections
import dataclasses
import threading
import time
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from backsight.problem.reading.tables import FeedTable
from backsight.types import Array

ROOM = 64 * 2**20
"""Bytes that may wait to be taken; what comes beyond is counted and lost."""

RETRY = (0.2, 5.0)
"""First and longest time between two attempts to connect [s]."""


@dataclasses.dataclass(frozen=True)
class Batch:
    """Samples of a source.

    Parameters
    ----------
    arrival : (n,) array
        When they arrived [s since 1970].
    values : (n, m) array
        Columns of the source in the order of `wanted_columns`, as they came.
    """

    arrival: Array
    values: Array


@dataclasses.dataclass(frozen=True)
class Unreadable:
    """A payload that cannot be read, and why."""

    payload: bytes
    reason: str


def wanted_columns(feed: FeedTable) -> list[str]:
    """Names of the columns that a source is asked for: the time, if it has one, and signals."""
    time_column = [] if feed.time is None else [feed.time.column]
    return list(dict.fromkeys([*time_column, *(c.column for c in feed.columns_wanted.values())]))


class Inbox:
    """Payloads that arrived and were not taken yet; for one thread on each side."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[tuple[float, bytes]] = []
        self._bytes = 0
        self.lost = 0
        """Payloads for which there was no room."""

    def put(self, payload: bytes) -> bool:
        """Take in a payload that arrives now; whether there was room."""
        return self.put_many([payload])

    def put_many(self, payloads: Sequence[bytes], *, moment: float | None = None) -> bool:
        """Take in payloads that arrive together, now if no moment [s since 1970] is given.

        Whether there was room.
        """
        now, size = time.time() if moment is None else moment, sum(map(len, payloads))
        with self._lock:
            if self._bytes + size > ROOM:
                self.lost += len(payloads)
                return False
            self._bytes += size
            self._waiting += [(now, payload) for payload in payloads]
        return True

    def take(self) -> list[tuple[float, bytes]]:
        """Everything that is there."""
        with self._lock:
            taken, self._waiting, self._bytes = self._waiting, [], 0
        return taken


class LiveSource(abc.ABC):
    """A source of samples.

    Parameters
    ----------
    name : str
    feed : FeedTable
    """

    stamped: ClassVar[bool] = False
    """Whether the first column is the time of the sample [s], whatever the table says."""
    durable = False
    """Whether it sends again what was not acknowledged."""

    def __init__(self, name: str, feed: FeedTable) -> None:
        self.name, self.feed = name, feed
        self.columns = wanted_columns(feed)
        self.taken: list[tuple[float, bytes]] = []
        """Times of arrival and payloads of the last `take`, of one that is durable."""
        self.state = "starts"
        """What it does, in a word or two."""
        self.ended = False
        """Whether nothing will come any more."""
        self.faults: collections.deque[Unreadable] = collections.deque(maxlen=100)
        self.malformed = 0
        self.lost = 0

    def open(self) -> None:  # noqa: B027 - some need nothing
        """Do what must work before anything else, once.

        Raises
        ------
        BacksightError
            If that cannot work: a port is taken, a file is missing, a package is not installed.
        """

    @abc.abstractmethod
    def start(self) -> None:
        """Begin to receive; it has been opened."""

    @abc.abstractmethod
    def take(self) -> Batch | None:
        """What came since the last call, None if nothing did."""

    @abc.abstractmethod
    def stop(self) -> None:
        """Receive no more."""

    def mark(self) -> int:
        """By which `acknowledge` knows what was taken so far."""
        return 0

    def acknowledge(self, mark: int) -> None:  # noqa: B027 - most have nobody to tell
        """Everything that was taken before the mark is stored."""

    def fault(self, payload: bytes, reason: str) -> None:
        """Count a payload that cannot be read."""
        self.malformed += 1
        self.faults.append(Unreadable(payload[:200], reason))


Decode = Callable[[Sequence[bytes]], tuple[Array, np.ndarray, list[Unreadable]]]
"""Payloads to values (n, m), the payload of each row (n,), and what cannot be read."""


class ReceivingSource(LiveSource):
    """A source whose payloads a thread receives, and which connects again by itself.

    Parameters
    ----------
    name, feed
    decode : callable
    """

    def __init__(self, name: str, feed: FeedTable, decode: Decode) -> None:
        super().__init__(name, feed)
        self._decode, self.inbox = decode, Inbox()
        self.stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"source {name}", daemon=True)

    def start(self) -> None:
        """See `LiveSource.start`."""
        self._thread.start()

    @abc.abstractmethod
    def receive(self) -> None:
        """Receive until `stopping` is set or the connection breaks; OSError may be raised."""

    def _run(self) -> None:
        wait = RETRY[0]
        while not self.stopping.is_set() and not self.ended:
            began = time.monotonic()
            try:
                self.receive()
            except OSError as error:
                self.state = f"{error.strerror or error}, tries again"
            if time.monotonic() - began > RETRY[1]:
                wait = RETRY[0]
            if not self.ended:
                self.stopping.wait(wait)
                wait = min(2 * wait, RETRY[1])

    def take(self) -> Batch | None:
        """See `LiveSource.take`."""
        taken = self.inbox.take()
        self.lost = self.inbox.lost
        self.noted(len(taken))
        self.taken = taken if self.durable else []
        if not taken:
            return None
        values, owner, faults = self._decode([payload for _, payload in taken])
        for found in faults:
            self.fault(found.payload, found.reason)
        arrival = np.array([moment for moment, _ in taken])[owner]
        return Batch(arrival, values) if len(values) else None

    def noted(self, payloads: int) -> None:
        """So many payloads were taken."""

    def stop(self) -> None:
        """See `LiveSource.stop`."""
        self.stopping.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(2.0)
