"""What a problem file says of those who get the estimates while samples come."""

from collections.abc import Mapping

import pydantic

from backsight.problem.reading.tables._strict import StrictTable
from backsight.problem.reading.tables._topic import TopicTable


class SinkTable(StrictTable):
    """``[sink.NAME]``: estimates as JSON, an object of names and numbers for a sample.

    Parameters
    ----------
    of : list of str
        States, virtual quantities, forces, outputs; all states if not given.
    every : float
        Time between two samples that are sent [s]; 0: every sample.
    """

    kind: str
    of: list[str] = pydantic.Field(default_factory=list)
    every: float = pydantic.Field(default=0.1, ge=0)


class StdoutSink(SinkTable):
    """Lines on standard output."""


class UdpSink(SinkTable):
    """Datagrams.

    Parameters
    ----------
    host : str
        Address to send to.
    port : int
        Port to send to.
    """

    host: str = "127.0.0.1"
    port: int = pydantic.Field(ge=1, le=65535)


class MqttSink(TopicTable, SinkTable):
    """Messages to a broker."""


SINKS: Mapping[str, type[SinkTable]] = {"stdout": StdoutSink, "udp": UdpSink, "mqtt": MqttSink}
"""Kind of a sink to its table."""
