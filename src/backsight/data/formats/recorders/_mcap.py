"""MCAP files of robots, by mcap: messages in JSON, Protobuf, or as ROS 1 and ROS 2 write them."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density
from backsight.data.formats.libraries import library
from backsight.data.formats.recorders._messages import Messages, list_messages, read_messages
from backsight.data.formats.recorders._ros import decoder
from backsight.errors import DataError

_LANGUAGES = {"ros1msg": ("msg", 1), "ros2msg": ("msg", 2), "ros2idl": ("idl", 2)}
"""Of schemas: the language of their text, and the version of ROS."""


def read_mcap(path: Path, request: Request) -> Contents:
    """Read fields of messages, ``/topic.field``; of a file that is cut off, what is whole."""
    topics, messages = _opened(path)
    return read_messages(topics, messages, request)


def list_mcap(path: Path, _: Request) -> list[Listed]:
    """List the fields of all topics."""
    topics, messages = _opened(path)
    return list_messages(topics, messages)


def _opened(path: Path) -> tuple[list[str], Messages]:
    def messages(topic: str) -> Iterator[tuple[int, Any]]:
        decoders: dict[int, Callable[[bytes], Any]] = {}
        for schema, channel, message in _records(path, topic):
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(schema, channel)
            yield message.log_time, decoders[channel.id](message.data)

    return _topics(path), messages


def _topics(path: Path) -> list[str]:
    with path.open("rb") as file:
        summary = _summary(library("mcap.reader").make_reader(file))
    if summary is not None:
        return [channel.topic for channel in summary.channels.values()]
    return list(dict.fromkeys(channel.topic for _, channel, _ in _records(path, None)))


def _records(path: Path, topic: str | None) -> Iterator[tuple[Any, Any, Any]]:
    """Messages on a topic, or on all; from the front where the end with the index is missing."""
    reader, exceptions = library("mcap.reader"), library("mcap.exceptions")
    with path.open("rb") as file:
        indexed = reader.make_reader(file)
        if _summary(indexed) is not None:
            yield from indexed.iter_messages(topics=topic)
            return
        file.seek(0)
        try:
            stream = reader.NonSeekingReader(file)
            yield from stream.iter_messages(topics=topic, log_time_order=False)
        except exceptions.EndOfFile:  # the recorder lost its power
            return


def _summary(reader: Any) -> Any:
    """The index at the end of a file, None if there is none."""
    try:
        summary = reader.get_summary()
    except (library("mcap.exceptions").McapError, OSError):
        return None
    if summary is None or not summary.channels:
        return None
    for chunk in summary.chunk_indexes:
        check_density(chunk.uncompressed_size, chunk.compressed_size, "a chunk")
    return summary


def _decoder(schema: Any, channel: Any) -> Callable[[bytes], Any]:
    form = channel.message_encoding
    if form == "json":
        return json.loads
    if schema is not None and form == "protobuf":
        return _protobuf(schema)
    if schema is not None and form in ("cdr", "ros1") and schema.encoding in _LANGUAGES:
        language, version = _LANGUAGES[schema.encoding]
        text = schema.data.decode()
        decode = decoder([(schema.name, language, text)], version=version)
        return lambda data: decode(schema.name, data)
    raise DataError(f"messages on '{channel.topic}' are written in '{form}', which is not read")


def _protobuf(schema: Any) -> Callable[[bytes], Any]:
    """By the descriptors of the types, which the file brings along."""
    pools = library("google.protobuf.descriptor_pool")
    pool = pools.DescriptorPool()
    files = library("google.protobuf.descriptor_pb2").FileDescriptorSet.FromString(schema.data)
    for file in files.file:
        pool.Add(file)
    kind = pool.FindMessageTypeByName(schema.name)
    return library("google.protobuf.message_factory").GetMessageClass(kind).FromString
