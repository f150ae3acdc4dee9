"""TDMS files of LabVIEW, by npTDMS."""

import collections
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backsight.data._pick import present
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats.libraries import library
from backsight.data.times.grid import even_times
from backsight.errors import DataError


def read_tdms(path: Path, request: Request) -> Contents:
    """Read channels of a TDMS file (LabVIEW): ``group/channel``, or the channel alone if unique."""
    nptdms = library("nptdms")
    columns, units, clocks, begins = {}, {}, [], []
    with nptdms.TdmsFile.open(path) as file:
        channels = _by_name([(g.name, c.name, c) for g in file.groups() for c in g.channels()])
        for name in present(request.wanted, channels):
            channel = channels[name]
            claimed = 8 * len(channel)
            check_density(claimed, path.stat().st_size, f"'{name}'")
            check_room(claimed, f"'{name}'")
            columns[name] = np.asarray(channel[:])
            properties = channel.properties
            units[name] = str(properties.get("unit_string", ""))
            if name != request.clock and properties.get("wf_increment"):
                start, step = properties.get("wf_start_offset", 0.0), properties["wf_increment"]
                clocks.append((name, float(start), float(step)))
                begins.append(properties.get("wf_start_time"))
    if len({str(begin) for begin in begins}) > 1:
        raise DataError("the channels begin at different times; read each by itself and merge them")
    begin = "" if not begins or begins[0] is None else pd.Timestamp(begins[0]).isoformat()
    time = even_times(clocks, columns)
    return Contents(columns, units, time=time, begin=begin if time is not None else "")


def list_tdms(path: Path, _: Request) -> list[Listed]:
    """List the channels, each with its group."""
    with library("nptdms").TdmsFile.read_metadata(path) as file:
        channels = [(f"{g.name}/{c.name}", c.dtype) for g in file.groups() for c in g.channels()]
    return [Listed.of(name, dtype) for name, dtype in channels]


def _by_name(channels: Sequence[tuple[str, str, Any]]) -> dict[str, Any]:
    """Channels by group and name, and by name alone where that is unique.

    Names may hold strokes themselves: ``07/09/2012 06:58 PM - All Data``.
    """
    count = collections.Counter(name for _, name, _ in channels)
    bare = {name: channel for _, name, channel in channels if count[name] == 1}
    return bare | {f"{group}/{name}": channel for group, name, channel in channels}
