"""Messages on topics, as robots record them, as columns: ``topic.field``, ``topic.field[2]``."""

import dataclasses
import datetime
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from backsight.data._pick import MOST_CHANNELS, no_column
from backsight.data._request import Contents, Listed, Request
from backsight.errors import DataError
from backsight.types import Array

Messages: TypeAlias = Callable[[str], Iterable[tuple[int, Any]]]
"""Topic to its messages in the order of their log time: ``(log time [ns], message)``.

A message is an object or a mapping, whose fields are numbers, words, sequences or messages.
"""

LOGGED, STAMP = "log_time", "header.stamp"
"""When a message was written, and when, by its sender, that was measured which it tells."""

_STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"}, {"secs", "nsecs"}, {"seconds", "nanos"})
"""Fields of moments: seconds and nanoseconds since 1970."""

_MOMENTS = "moments, which can be time"

_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")

_BILLION = 1_000_000_000


@dataclasses.dataclass(frozen=True)
class _Place:
    """A column: its topic, and the way to the value in a message."""

    topic: str
    field: str

    @property
    def steps(self) -> list[str | int]:
        """Names of fields and places in sequences."""
        return [int(k) if k else name for name, k in _STEP.findall(self.field)]


def read_messages(topics: Sequence[str], messages: Messages, request: Request) -> Contents:
    """Read columns of messages, which must come at the same times.

    Time is the stamp of the headers where all have one, else the log time; ``topic.header.stamp``
    and ``topic.log_time`` can be asked for.
    """
    places = {name: _place(name, topics, messages) for name in request.wanted}
    _check_fields(places, messages)
    found: dict[str, Array] = {}
    stamped: dict[str, np.ndarray] = {}
    logged: dict[str, np.ndarray] = {}
    for topic in dict.fromkeys(place.topic for place in places.values()):
        own = {name: place for name, place in places.items() if place.topic == topic}
        columns, stamps, logged[topic] = _columns(topic, messages(topic), own)
        found |= columns
        if stamps is not None:
            stamped[topic] = stamps
    if request.clock is not None and places[request.clock].field == LOGGED:
        stamped = {}
    told = len(stamped) == len(logged)
    times = stamped if told else logged
    first = next(iter(times))
    for topic, own in times.items():
        if not np.array_equal(own, times[first]):
            raise DataError(
                f"'{first}' and '{topic}' come at different times; read each by itself and merge "
                "them"
            )
    zero = int(times[first][0])
    if request.clock is not None:
        return Contents(found)
    kind = "the headers' stamps" if told else "the log's"
    return Contents(
        found,
        understood=f"time is {kind}",
        time=(times[first] - zero) * 1e-9,
        begin=_moment(zero),
    )


def list_messages(topics: Sequence[str], messages: Messages) -> list[Listed]:
    """List the fields of every topic, as its first message has them."""
    found: list[Listed] = []
    for topic in topics:
        try:
            first = next(((message,) for _, message in messages(topic)), ())
        except DataError as error:
            found.append(Listed(topic, "other", str(error)))
            continue
        for message in first:
            found += [*_listed(topic, message), Listed(f"{topic}.{LOGGED}", "other", _MOMENTS)]
    return found


def _place(name: str, topics: Sequence[str], messages: Messages) -> _Place:
    """The longest topic that a name begins with, with or without its first stroke."""
    for topic in sorted(topics, key=len, reverse=True):
        for label in (topic, topic.removeprefix("/")):
            if name.startswith(f"{label}."):
                return _Place(topic, name.removeprefix(f"{label}."))
    listed = [column.name for column in list_messages(topics, messages)]
    raise DataError(no_column(name, listed))


def _check_fields(places: Mapping[str, _Place], messages: Messages) -> None:
    """Raise `DataError` if the first messages have no such fields."""
    for topic in dict.fromkeys(place.topic for place in places.values()):
        _, first = next(iter(messages(topic)), (0, None))
        for name, place in places.items():
            if place.topic == topic and place.field != LOGGED and _at(first, place.steps) is None:
                listed = [column.name for column in list_messages([topic], messages)]
                raise DataError(no_column(name, listed))


def _columns(
    topic: str, messages: Iterable[tuple[int, Any]], places: Mapping[str, _Place]
) -> tuple[dict[str, Array], np.ndarray | None, np.ndarray]:
    """Columns of a topic, the stamps of the headers, if there are, and the log times [ns]."""
    ways = {name: place.steps for name, place in places.items() if place.field != LOGGED}
    kept: dict[str, list[Any]] = {name: [] for name in ways}
    logged: list[int] = []
    stamps: list[int] | None = []
    header = _Place(topic, STAMP).steps
    for time, message in messages:
        for name, steps in ways.items():
            kept[name].append(_number(message, steps, name, len(logged)))
        if stamps is not None:
            stamp = _nanoseconds(_at(message, header))
            stamps = _appended(stamps, stamp)
        logged.append(time)
    if not logged:
        raise DataError(f"there is no message on '{topic}'")
    log = np.array(logged, np.int64)
    columns = {name: _column(values, name) for name, values in kept.items()}
    columns |= {
        name: log.astype("datetime64[ns]") for name, p in places.items() if p.field == LOGGED
    }
    return columns, None if stamps is None else np.array(stamps, np.int64), log


def _appended(stamps: list[int], stamp: int | None) -> list[int] | None:
    """None if a message has no stamp, or one that was never set."""
    if not stamp:
        return None
    stamps.append(stamp)
    return stamps


def _at(message: Any, steps: Sequence[str | int]) -> Any:
    """What a message has at the end of the way, None if there is nothing."""
    for step in steps:
        if isinstance(step, str):
            message = (
                message.get(step) if isinstance(message, Mapping) else getattr(message, step, None)
            )
        elif isinstance(message, (Sequence, np.ndarray)) and step < len(message):
            message = message[step]
        else:
            return None
    return message


def _number(message: Any, steps: Sequence[str | int], name: str, k: int) -> Any:
    """A number, or a moment in nanoseconds as ``datetime64``."""
    value = _at(message, steps)
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        return value
    if (moment := _nanoseconds(value)) is not None:
        return np.datetime64(moment, "ns")
    if value is None and isinstance(message, Mapping):
        return math.nan  # JSON leaves out what is not known, and has no NaN
    if value is None:
        raise DataError(f"'{name}': message {k} has no such field")
    raise DataError(f"'{name}' is no number, but {_kind(value)}")


def _column(values: Sequence[Any], name: str) -> Array:
    column = np.array(values)
    if column.dtype.kind not in "fiubM":
        raise DataError(f"'{name}' mixes numbers and moments")
    if column.dtype.kind == "f" and not np.isfinite(column).any():
        raise DataError(f"no message has a field '{name}'")
    return column


def _nanoseconds(value: Any) -> int | None:
    """Of a moment since 1970, None if it is none."""
    fields = _fields(value)
    if set(fields) not in _STAMPS or str(getattr(value, "__msgtype__", "")).endswith("Duration"):
        return None
    seconds, nanoseconds = fields.values()
    return int(seconds) * _BILLION + int(nanoseconds)


def _fields(value: Any) -> dict[str, Any]:
    """Fields of a message, none of anything else."""
    if isinstance(value, Mapping):
        return dict(value)
    # Classes that rosbags makes have their own name among the fields.
    if hasattr(value, "DESCRIPTOR"):  # Protobuf
        return {name: getattr(value, name) for name in value.DESCRIPTOR.fields_by_name}
    if dataclasses.is_dataclass(value):
        return {n: getattr(value, n) for n in vars(value) if not n.startswith("__")}
    return {}


def _listed(name: str, value: Any) -> Iterator[Listed]:
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        yield Listed(name)
    elif _nanoseconds(value) is not None:
        yield Listed(name, "other", _MOMENTS)
    elif fields := _fields(value):
        for field, inner in fields.items():
            yield from _listed(f"{name}.{field}", inner)
    elif isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, (str, bytes)):
        if len(value) > MOST_CHANNELS:
            yield Listed(name, "other", f"{len(value)} values: {name}[0], ...")
        else:
            for k, inner in enumerate(value):
                yield from _listed(f"{name}[{k}]", inner)
    else:
        yield Listed(name, "other", _kind(value))


def _kind(value: Any) -> str:
    if isinstance(value, str):
        return "text"
    if isinstance(value, (Sequence, np.ndarray)):
        return f"{len(value)} values: take one, as [0]"
    fields = list(_fields(value))
    return f"a message with the fields {', '.join(fields)}" if fields else type(value).__name__


def _moment(nanoseconds: int) -> str:
    seconds, rest = divmod(nanoseconds, _BILLION)
    moment = datetime.datetime.fromtimestamp(seconds, datetime.UTC).replace(tzinfo=None)
    return f"{moment.isoformat()}.{rest:09d}" if rest else moment.isoformat()
