"""Variables of an OPC UA server, by subscription."""

import asyncio
import logging
import math
import threading
import time
from typing import Any

import numpy as np

from backsight.errors import PluginError
from backsight.live.sources.base import Batch, ReceivingSource, wanted_columns
from backsight.problem.reading.tables import OpcuaFeed

_QUEUE = 1000
"""Values of a variable that the server keeps between two messages."""

_LOOK_UP = 0.2


class OpcuaSource(ReceivingSource):
    """Changes of variables, each with the time at which the server took it."""

    stamped = True

    def __init__(self, name: str, feed: OpcuaFeed) -> None:
        super().__init__(name, feed, _nothing)
        self._table, self._nodes = feed, wanted_columns(feed)
        self.columns = ["time", *self._nodes]
        self._rows: list[tuple[float, float, int, float]] = []
        self._lock = threading.Lock()

    def open(self) -> None:
        """See `LiveSource.open`."""
        try:
            import asyncua
        except ModuleNotFoundError:
            raise PluginError("OPC UA needs asyncua: pip install 'backsight[live]'") from None
        self._library: Any = asyncua
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # what breaks is in the state

    def receive(self) -> None:
        """See `ReceivingSource.receive`."""
        self.state = "connects"
        try:
            asyncio.run(self._subscribed())
        except (TimeoutError, OSError):
            raise
        except Exception as error:  # of whatever a server answers
            raise OSError(str(error).partition("\n")[0] or type(error).__name__) from None

    async def _subscribed(self) -> None:
        async with self._library.Client(self._table.url, timeout=4) as client:
            nodes = [client.get_node(name) for name in self._nodes]
            handler = _Handler(self, {str(n): k for k, n in enumerate(nodes)})
            subscription = await client.create_subscription(1e3 * self._table.period, handler)
            await subscription.subscribe_data_change(nodes, queuesize=_QUEUE)
            self.state = "reads"
            while not self.stopping.is_set():
                await asyncio.sleep(_LOOK_UP)
                await client.check_connection()

    def changed(self, column: int, value: object, stamp: float) -> None:
        """Take in a new value."""
        if isinstance(value, bool) or not isinstance(value, int | float) or math.isinf(value):
            self.fault(str(value).encode(), f"{self._nodes[column]} is no number")
            return
        with self._lock:
            self._rows.append((time.time(), stamp, column, float(value)))

    def take(self) -> Batch | None:
        """See `LiveSource.take`."""
        with self._lock:
            taken, self._rows = self._rows, []
        if not taken:
            return None
        values = np.full((len(taken), len(self.columns)), np.nan)
        for k, (_, stamp, column, value) in enumerate(taken):
            values[k, 0], values[k, 1 + column] = stamp, value
        return Batch(np.array([row[0] for row in taken]), values)


class _Handler:
    """What asyncua calls."""

    def __init__(self, source: OpcuaSource, columns: dict[str, int]) -> None:
        self._source, self._columns = source, columns

    def datachange_notification(self, node: Any, value: object, data: Any) -> None:
        """Take in a change."""
        found = data.monitored_item.Value
        moment = found.SourceTimestamp or found.ServerTimestamp
        stamp = time.time() if moment is None else _seconds(moment)
        self._source.changed(self._columns[str(node)], value, stamp)

    def event_notification(self, event: object) -> None:
        """Events are not subscribed to."""

    def status_change_notification(self, status: object) -> None:
        """Say what the server says of the subscription."""
        self._source.state = f"the server says {status}"


def _seconds(moment: Any) -> float:
    """Seconds since 1970 of a time that may or may not say its zone, which is UTC."""
    import datetime

    zoned = moment if moment.tzinfo else moment.replace(tzinfo=datetime.UTC)
    return zoned.timestamp()


def _nothing(_: object) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    return np.empty((0, 0)), np.empty(0, int), []
