"""MDF files of vehicle and test-bench recorders (ASAM, versions 3 and 4), by asammdf."""

import collections
import dataclasses
import io
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from backsight.data._pick import present
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats.libraries import library
from backsight.errors import DataError
from backsight.types import Array

_TIME = (0, 1)
"""What the master of a group may count: not told (version 3), or time; not angle, nor distance."""

_SIGN = 16  # bytes

_WORDS = frozenset({7, 8, 10})
"""Conversions of version 4 from numbers or words to words."""


@dataclasses.dataclass(frozen=True)
class _Channel:
    """Where a channel is: its group and its place there; `fault` says why it cannot be taken."""

    group: int
    place: int
    unit: str
    dtype: np.dtype | None
    fault: str = ""


def read_mdf(path: Path, request: Request) -> Contents:
    """Read channels of an MDF file: ``group/channel``, or the channel alone if unique.

    Time is that of the group of the channels. Samples that the file marks as invalid are NaN.
    """
    with _opened(path) as file:
        channels = _channels(file)
        columns, units = {}, {}
        for name in present(request.wanted, channels):
            channel = channels[name]
            if channel.fault:
                raise DataError(f"'{name}' is {channel.fault}")
            claimed = 8 * int(file.groups[channel.group].channel_group.cycles_nr)
            check_density(claimed, path.stat().st_size, f"'{name}'")
            check_room(claimed, f"'{name}'")
            columns[name] = _values(file, channel, name)
            units[name] = channel.unit
        groups = {name: channels[name].group for name in columns}
        time = _common_time(file, groups)
        begin = file.start_time.replace(tzinfo=None).isoformat() if file.start_time else ""
    return Contents(columns, units, time=time, begin=begin if time is not None else "")


def list_mdf(path: Path, _: Request) -> list[Listed]:
    """List the channels; the clocks of groups are the file's own time."""
    with _opened(path) as file:
        channels = _channels(file)
        masters = set(file.masters_db.items())
    named: dict[tuple[int, int], tuple[str, _Channel]] = {}
    for name, channel in channels.items():
        named.setdefault((channel.group, channel.place), (name, channel))
    return [
        Listed(name, "other", channel.fault) if channel.fault else Listed.of(name, channel.dtype)
        for place, (name, channel) in named.items()
        if place not in masters
    ]


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    check_room(path.stat().st_size // 2, "the file")
    with path.open("rb") as stream:
        unfinished = stream.read(_SIGN).startswith(b"UnFin")
        stream.seek(0)
        # A recording that was not finished is finished in memory.
        source = io.BytesIO(path.read_bytes()) if unfinished else stream
        try:
            file = library("asammdf").MDF(source)
        except Exception as error:
            _let_go(error)
            raise
        with file:
            yield file


def _let_go(error: Exception) -> None:
    """Close what the library was building, which does not close itself if the file is cut off."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        builder: Any = frame.f_locals.get("self")
        if hasattr(builder, "_closed"):
            builder._closed = True
            if (scratch := getattr(builder, "_tempfile", None)) is not None:
                scratch.close()


def _channels(file: Any) -> dict[str, _Channel]:
    """Channels by name alone where that is unique, and by group and name."""
    labels = _labels(file.groups)
    words = _WORDS if file.version >= "4" else frozenset[int]()
    found: dict[str, list[_Channel]] = {}
    full: dict[str, list[_Channel]] = {}
    for g, group in enumerate(file.groups):
        for k, channel in enumerate(group.channels):
            if not int(group.channel_group.cycles_nr):
                continue
            fault = "a channel of words" if words & {_conversion(channel)} else ""
            own = _Channel(g, k, _unit(channel), _dtype(channel), fault)
            found.setdefault(channel.name, []).append(own)
            full.setdefault(f"{labels[g]}/{channel.name}", []).append(own)
    twice = {
        name: dataclasses.replace(own[0], fault=f"the name of {len(own)} channels of a group")
        for name, own in full.items()
        if len(own) > 1
    }
    bare = {name: own[0] for name, own in found.items() if len(own) == 1}
    return bare | {name: own[0] for name, own in full.items()} | twice


def _unit(channel: Any) -> str:
    """Of a channel; version 3 keeps it with the conversion."""
    found = getattr(channel, "unit", "") or getattr(channel.conversion, "unit", "") or ""
    found = found.decode("latin-1") if isinstance(found, bytes) else str(found)
    return found.strip(" \0")


def _labels(groups: Sequence[Any]) -> list[str]:
    """Names of groups, numbers where they have none or share it."""
    names = [(getattr(group.channel_group, "acq_name", "") or "").strip() for group in groups]
    count = collections.Counter(names)
    return [name if name and count[name] == 1 else str(k) for k, name in enumerate(names)]


def _conversion(channel: Any) -> int:
    return -1 if channel.conversion is None else int(channel.conversion.conversion_type)


def _dtype(channel: Any) -> np.dtype | None:
    return channel.dtype_fmt if channel.conversion is None else np.dtype(float)


def _values(file: Any, channel: _Channel, name: str) -> Array:
    # Otherwise the library leaves invalid samples out, and the others are at wrong times.
    signal = file.get(group=channel.group, index=channel.place, ignore_invalidation_bits=True)
    samples = np.asarray(signal.samples)
    if samples.dtype.kind not in "fiub" or samples.ndim != 1:
        raise DataError(f"'{name}' is not a channel of real numbers, but of {samples.dtype}")
    if signal.invalidation_bits is None or not np.any(signal.invalidation_bits):
        return samples
    return np.where(np.asarray(signal.invalidation_bits, bool), np.nan, samples)


def _common_time(file: Any, groups: Mapping[str, int]) -> Array | None:
    """Times of the groups [s], which must be the same; None if their master is not time."""
    times: dict[int, Array] = {}
    for name, group in groups.items():
        master = file.masters_db.get(group)
        if master is None:
            return None
        kind = getattr(file.groups[group].channels[master], "sync_type", 1)
        if kind not in _TIME:
            return None
        times[group] = np.asarray(file.get_master(group), float)
        first = next(iter(groups))
        if not np.array_equal(times[group], times[groups[first]]):
            raise DataError(
                f"'{first}' and '{name}' are sampled at different times, in groups of their own; "
                "read each by itself and merge them"
            )
    return next(iter(times.values()), None)
