"""From the table of a source to the source."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from backsight.errors import ProblemError
from backsight.live.sources._mqtt import MqttSource
from backsight.live.sources._streams import SerialSource, StdinSource, TcpSource
from backsight.live.sources._udp import UdpSource
from backsight.live.sources.base import LiveSource
from backsight.live.sources.replay import ReplaySource
from backsight.problem.reading.tables import (
    FeedTable,
    MqttFeed,
    OpcuaFeed,
    ReplayFeed,
    SerialFeed,
    StdinFeed,
    TcpFeed,
    UdpFeed,
)

if TYPE_CHECKING:
    import xarray as xr


def source_of(name: str, feed: FeedTable, recording: Callable[[], xr.Dataset]) -> LiveSource:
    """Return the source of a table.

    Parameters
    ----------
    name : str
    feed : FeedTable
    recording : callable
        Gives the recording that is replayed.

    Raises
    ------
    ProblemError, PluginError
        If the table does not say how to read what comes, or a package is missing.
    """
    match feed:
        case UdpFeed():
            return UdpSource(name, feed)
        case TcpFeed():
            return TcpSource(name, feed)
        case StdinFeed():
            return StdinSource(name, feed)
        case SerialFeed():
            return SerialSource(name, feed)
        case MqttFeed():
            return MqttSource(name, feed)
        case OpcuaFeed():
            from backsight.live.sources._opcua import OpcuaSource

            return OpcuaSource(name, feed)
        case ReplayFeed():
            return ReplaySource(name, feed, recording)
    raise ProblemError(f"source.{name}.kind: there is nothing that receives '{feed.kind}'")
