"""What a problem file says for `backsight live`: how samples come, and where results go."""

from collections.abc import Mapping
from typing import Literal

import pydantic

from backsight.problem.reading.tables._recorded import (
    ColumnTable,
    CommandColumnTable,
    FileTable,
    RecordingTable,
    SensorColumnTable,
)
from backsight.problem.reading.tables._strict import StrictTable


class LiveTable(StrictTable):
    """``[live]``: the grid of samples, and how long it is waited for those that are late.

    Parameters
    ----------
    dt : float
        Sampling period [s]; not needed where a recording is replayed.
    estimator : str
        Which of the file; the first one if not given.
    block : float
        Samples are taken in and estimated so often [s].
    reorder : float
        Time that a sample waits for others that are older [s].
    lag : float
        Time by which a sample may come after that and is still used exactly [s].
    bridge : float
        Longest gap that the model bridges; after a longer one the estimator begins anew [s].
    freeze : float
        Time over which it is judged whether parameters with a random walk can be seen; such as
        cannot are frozen [s]. Nothing is frozen if not given.
    """

    dt: float | None = pydantic.Field(default=None, gt=0)
    estimator: str | None = None
    block: float = pydantic.Field(default=0.05, ge=1e-3, le=60.0)
    reorder: float = pydantic.Field(default=0.0, ge=0, le=3600.0)
    lag: float = pydantic.Field(default=1.0, ge=0, le=3600.0)
    bridge: float = pydantic.Field(default=60.0, gt=0)
    freeze: float | None = pydantic.Field(default=None, gt=0)


class FeedTable(StrictTable):
    """``[source.NAME]``: where samples come from, and what is in them.

    Parameters
    ----------
    inputs, outputs : dict
        Signal of the model to its column.
    time : column
        Of time stamps [s]; without it, the time of arrival counts.
    clock : common or own
        Stamps of an own clock are put to that of this computer.
    delay : float
        By which the clock of the source is late [s].
    silent : float
        Time without a sample after which the source is called silent [s].
    """

    kind: str
    inputs: dict[str, CommandColumnTable] = pydantic.Field(default_factory=dict)
    outputs: dict[str, SensorColumnTable] = pydantic.Field(default_factory=dict)
    time: ColumnTable | None = None
    clock: Literal["common", "own"] = "common"
    delay: float = 0.0
    silent: float = pydantic.Field(default=5.0, gt=0)

    @property
    def columns_wanted(self) -> dict[str, ColumnTable]:
        """Columns of signals."""
        return {**self.inputs, **self.outputs}


class MessageTable(FeedTable):
    """A source of messages: how numbers are read from them.

    Parameters
    ----------
    format : json, text, packed or cbor
        An object of names and numbers; numbers in a line; bytes as of the C language; CBOR.
    columns : list
        Names of the numbers, in the order of a line or a record; of text and packed.
    delimiter : str
        Between the numbers of a line.
    struct : str
        Of packed records, as of Python's struct: "<dff".
    """

    format: Literal["json", "text", "packed", "cbor"] = "json"
    columns: list[str] = pydantic.Field(default_factory=list)
    delimiter: str = pydantic.Field(default=",", min_length=1, max_length=1)
    struct: str = ""


class UdpFeed(MessageTable):
    """Datagrams that are sent to this computer.

    Parameters
    ----------
    host : str
        Address to listen on.
    port : int
        Port to listen on; 0: any that is free.
    """

    host: str = "127.0.0.1"
    port: int = pydantic.Field(ge=0, le=65535)


class TcpFeed(MessageTable):
    """A stream of lines or records, from a server or from whoever connects.

    Parameters
    ----------
    host : str
        Address of the server, or to listen on.
    port : int
        Port of the server, or to listen on; 0: any that is free.
    listen : bool
        Whether others connect to this computer.
    """

    host: str = "127.0.0.1"
    port: int = pydantic.Field(ge=0, le=65535)
    listen: bool = False


class StdinFeed(MessageTable):
    """Lines or records on standard input."""


class SerialFeed(MessageTable):
    """Lines or records from a serial line.

    Parameters
    ----------
    device : str
        Name of the line, as /dev/ttyUSB0 or COM3.
    baud : int
        Bits per second.
    """

    device: str
    baud: int = pydantic.Field(default=115200, gt=0)


class MqttFeed(MessageTable):
    """Messages of a broker.

    Parameters
    ----------
    topic : str
        What is subscribed to; ``+`` and ``#`` stand for any.
    host : str
        Address of the broker.
    port : int
        Port of the broker.
    client : str
        Name by which the broker keeps messages while nobody is connected.
    qos : 0 or 1
        With 1, a message is acknowledged when it is stored.
    user : str
        Name at the broker; the password is in the environment variable BACKSIGHT_MQTT_PASSWORD.
    tls : bool
        Whether the connection is encrypted.
    """

    topic: str
    host: str = "127.0.0.1"
    port: int = pydantic.Field(default=1883, ge=1, le=65535)
    client: str = "backsight"
    qos: Literal[0, 1] = 1
    user: str = ""
    tls: bool = False


class OpcuaFeed(FeedTable):
    """Variables of an OPC UA server; columns are node identifiers, as "ns=2;s=speed".

    Parameters
    ----------
    url : str
        Address of the server, opc.tcp://HOST:PORT/PATH.
    period : float
        At which the server samples [s].
    """

    url: str
    period: float = pydantic.Field(default=0.05, gt=0)


class ReplayFeed(FeedTable, FileTable):
    """A recording of any kind that is read, played as if it were measured now.

    Parameters
    ----------
    path : str
        File or bag, relative to the problem file; that of `[recording]` if not given.
    speed : float
        By how much faster than it was recorded; 0: as fast as possible.
    """

    path: str = ""
    speed: float = pydantic.Field(default=1.0, ge=0)

    @property
    def as_recording(self) -> RecordingTable:
        """The table of a recording that says the same."""
        keys = FileTable.model_fields.keys() & self.model_fields_set
        return RecordingTable(**self.model_dump(include=set(keys), exclude_unset=True))


FEEDS: Mapping[str, type[FeedTable]] = {
    "udp": UdpFeed,
    "tcp": TcpFeed,
    "stdin": StdinFeed,
    "serial": SerialFeed,
    "mqtt": MqttFeed,
    "opcua": OpcuaFeed,
    "replay": ReplayFeed,
}
"""Kind of a source to its table."""


class DashboardTable(StrictTable):
    """``[dashboard]``: a page in the browser that shows how it stands.

    Parameters
    ----------
    host : str
        Address to listen on; another one than 127.0.0.1 is seen from other computers.
    port : int
        0: any that is free.
    certificate, key : str
        Files for https, relative to the problem file.
    token_file : str
        File with the secret part of the address, made if it is not there; else it is new each time.
    minutes : float
        Time whose samples are kept in memory to be saved as a recording [min].
    saved : str
        Folder for saved recordings and their reports, relative to the problem file.
    """

    host: str = "127.0.0.1"
    port: int = pydantic.Field(default=0, ge=0, le=65535)
    certificate: str | None = None
    key: str | None = None
    token_file: str | None = None
    minutes: float = pydantic.Field(default=10.0, gt=0, le=1440)
    saved: str = "saved"


class StoreTable(StrictTable):
    """``[store]``: a folder of Parquet files to which results are appended.

    Parameters
    ----------
    path : str
        Folder, relative to the problem file.
    every : float
        Time between two parts [s]; what came since the last one is lost when the power fails.
    keep_days : float
        Parts that are older are removed [days].
    keep_mb : float
        The oldest parts are removed beyond this size [MB].
    """

    path: str
    every: float = pydantic.Field(default=10.0, ge=0.05, le=3600.0)
    keep_days: float | None = pydantic.Field(default=None, gt=0)
    keep_mb: float | None = pydantic.Field(default=None, gt=0)
