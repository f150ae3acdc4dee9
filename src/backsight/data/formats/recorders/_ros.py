"""Bags of ROS 1 and ROS 2, by rosbags."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from backsight.data._request import Contents, Listed, Request
from backsight.data.formats.libraries import library
from backsight.data.formats.recorders._messages import Messages, list_messages, read_messages
from backsight.errors import DataError

Definition: TypeAlias = tuple[str, str, str]
"""Of a type of messages: its name, its language ("msg" or "idl"), and its text."""

_TYPE, _WORD = re.compile(r"[A-Za-z]\w*(?:/[A-Za-z]\w*)+"), re.compile(r"\w+")


def read_bag(path: Path, request: Request) -> Contents:
    """Read fields of messages, ``/topic.field``, of a bag: a folder, ``.db3``, ROS 1 ``.bag``."""
    with _opened(path) as (topics, messages):
        return read_messages(topics, messages, request)


def list_bag(path: Path, _: Request) -> list[Listed]:
    """List the fields of all topics."""
    with _opened(path) as (topics, messages):
        return list_messages(topics, messages)


def decoder(definitions: Iterable[Definition], *, version: int) -> Callable[[str, Any], Any]:
    """Return what makes a message of its type and bytes, in ROS 1 or 2.

    The library turns definitions into a program: names that are none are refused before.
    """
    typesys = library("rosbags.typesys")
    types: dict[str, Any] = {}
    for name, language, text in definitions:
        if not _TYPE.fullmatch(name):
            raise DataError(f"'{name}' is no name of a type of messages")
        parsed = (
            typesys.get_types_from_idl(text)
            if language == "idl"
            else typesys.get_types_from_msg(text, name)
        )
        _check_names(parsed)
        types |= parsed
    if types:
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(types)
    else:  # bags of old recorders tell no types; those of ROS itself are known
        store = typesys.get_typestore(typesys.Stores.LATEST)
    decode = store.deserialize_ros1 if version == 1 else store.deserialize_cdr

    def message(name: str, data: Any) -> Any:
        if name not in store.types:
            raise DataError(f"the bag does not tell what a message of the type '{name}' is")
        return decode(data, name)

    return message


def _check_names(types: Mapping[str, Any]) -> None:
    for name, (constants, fields) in types.items():
        words = [entry[0] for entry in (*constants, *fields)]
        if not _TYPE.fullmatch(name) or not all(_WORD.fullmatch(word) for word in words):
            raise DataError(f"the type of messages '{name}' has names that are none")


@contextmanager
def _opened(path: Path) -> Iterator[tuple[list[str], Messages]]:
    with path.open("rb") if path.is_file() else _nothing() as file:
        version = 1 if file is not None and file.read(9) == b"#ROSBAG V" else 2
    bag = library(f"rosbags.rosbag{version}").Reader(path)
    with bag:
        told = [c for c in bag.connections if c.msgdef.format.name != "NONE"]
        decode = decoder(
            ((c.msgtype, c.msgdef.format.name.lower(), c.msgdef.data) for c in told),
            version=version,
        )

        def messages(topic: str) -> Iterator[tuple[int, Any]]:
            own = [c for c in bag.connections if c.topic == topic]
            for connection, time, data in bag.messages(own):
                yield time, decode(connection.msgtype, data)

        yield list(dict.fromkeys(c.topic for c in bag.connections)), messages


@contextmanager
def _nothing() -> Iterator[None]:
    yield None
