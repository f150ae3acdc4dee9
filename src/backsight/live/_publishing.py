"""Messages to a broker, which is connected to again when it was away."""

import os
from typing import Any

from backsight.errors import PluginError
from backsight.problem.reading.tables import TopicTable

PASSWORD = "BACKSIGHT_MQTT_PASSWORD"
"""Environment variable with the password at a broker."""

_AGAIN = (1, 5)
"""First and longest time between two attempts to connect [s], whole seconds."""


class Publisher:
    """A connection in a thread of its own.

    Parameters
    ----------
    table : TopicTable

    Raises
    ------
    PluginError
        If the package that speaks to brokers is not installed.
    """

    def __init__(self, table: TopicTable) -> None:
        try:
            from paho.mqtt import client as mqtt
        except ModuleNotFoundError:
            raise PluginError("MQTT needs paho-mqtt: pip install 'backsight[live]'") from None
        self._topic = table.topic
        self._client: Any = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)  # type: ignore[attr-defined]
        if table.user:
            self._client.username_pw_set(table.user, os.environ.get(PASSWORD))
        if table.tls:
            self._client.tls_set()
        self._client.reconnect_delay_set(*_AGAIN)
        self._client.connect_async(table.host, table.port)
        self._client.loop_start()

    def publish(self, message: bytes, *, qos: int) -> Any:
        """Publish a message; with `qos` 1 it waits for a broker that is away."""
        return self._client.publish(self._topic, message, qos=qos)

    def stop(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()
