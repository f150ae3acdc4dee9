"""Messages of a broker, acknowledged when they are safe."""

import collections
import os
import threading
from typing import Any

from backsight.errors import PluginError
from backsight.live._publishing import PASSWORD
from backsight.live.sources._decoding import payload_decoder
from backsight.live.sources.base import ReceivingSource
from backsight.problem.reading.tables import MqttFeed

_LOOK_UP = 0.2
_KEEPALIVE = 20


class MqttSource(ReceivingSource):
    """Messages of a topic.

    With quality of service 1 the broker keeps what was not acknowledged, also while nobody is
    connected under this name, and sends it again.
    """

    def __init__(self, name: str, feed: MqttFeed) -> None:
        super().__init__(name, feed, payload_decoder(feed, f"source.{name}"))
        self._table = feed
        self.durable = feed.qos == 1
        self._unacknowledged: collections.deque[int] = collections.deque()
        self._taken = self._acknowledged = 0
        self._lock = threading.Lock()

    def open(self) -> None:
        """See `LiveSource.open`."""
        try:
            from paho.mqtt import client as mqtt
        except ModuleNotFoundError:
            raise PluginError("MQTT needs paho-mqtt: pip install 'backsight[live]'") from None
        table = self._table
        client = mqtt.Client(
            mqtt.CallbackAPIVersion.VERSION2,  # type: ignore[attr-defined]
            client_id=table.client,
            clean_session=not self.durable,
            manual_ack=self.durable,
        )
        if table.user:
            client.username_pw_set(table.user, os.environ.get(PASSWORD))
        if table.tls:
            client.tls_set()
        client.on_connect = self._connected
        client.on_message = self._arrived
        self._client, self._fine = client, mqtt.MQTT_ERR_SUCCESS

    def start(self) -> None:
        """See `LiveSource.start`."""
        self._acknowledged = self._taken  # what was taken before came from a journal
        super().start()

    def receive(self) -> None:
        """See `ReceivingSource.receive`."""
        self.state = "connects"
        self._client.connect(self._table.host, self._table.port, keepalive=_KEEPALIVE)
        try:
            while not self.stopping.is_set():
                if self._client.loop(timeout=_LOOK_UP) != self._fine:
                    self.state = "lost the broker, tries again"
                    return
        finally:
            self._client.disconnect()

    def _connected(self, client: Any, _data: Any, _flags: Any, reason: Any, _more: Any) -> None:
        if reason.is_failure:
            self.state = f"the broker refuses: {reason}"
            return
        # The broker sends again what was not acknowledged on the last connection. Mosquitto counts
        # a second acknowledgement as room for another message, and lets a new one overtake.
        with self._lock:
            self._acknowledged += len(self._unacknowledged)
            self._unacknowledged.clear()
        client.subscribe(self._table.topic, self._table.qos)
        self.state = f"reads {self._table.topic}"

    def _arrived(self, _client: Any, _data: Any, message: Any) -> None:
        if self.inbox.put(message.payload) and self.durable:
            self._unacknowledged.append(message.mid)

    def mark(self) -> int:
        """See `LiveSource.mark`."""
        return self._taken

    def noted(self, payloads: int) -> None:
        """See `ReceivingSource.noted`."""
        self._taken += payloads

    def acknowledge(self, mark: int) -> None:
        """See `LiveSource.acknowledge`."""
        with self._lock:  # the thread of the store and that of the run
            while self.durable and self._acknowledged < mark and self._unacknowledged:
                self._client.ack(self._unacknowledged.popleft(), 1)
                self._acknowledged += 1
