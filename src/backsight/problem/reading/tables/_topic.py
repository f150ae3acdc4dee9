"""What a problem file says of a broker to which something is published."""

import pydantic

from backsight.problem.reading.tables._strict import StrictTable


class TopicTable(StrictTable):
    """A topic of a broker.

    Parameters
    ----------
    topic : str
        Under which messages are published.
    host : str
        Address of the broker.
    port : int
        Port of the broker.
    user : str
        Name at the broker; the password is in the environment variable BACKSIGHT_MQTT_PASSWORD.
    tls : bool
        Whether the connection is encrypted.
    """

    topic: str = pydantic.Field(min_length=1, pattern=r"^[^#+]*$")
    host: str = "127.0.0.1"
    port: int = pydantic.Field(default=1883, ge=1, le=65535)
    user: str = ""
    tls: bool = False
