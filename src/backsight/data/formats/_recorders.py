"""What recorders and simulators write: LVM, TDMS, UFF 58, WAV, OpenFAST's binary.

They know the times of their samples, so that neither a column of time nor a period is needed.
"""

import dataclasses
import re
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io.wavfile

from backsight.data._pick import no_column, pick
from backsight.data._request import Contents, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats.libraries import library
from backsight.data.texts.content import content_of
from backsight.data.texts.reading import read_content
from backsight.errors import DataError
from backsight.types import Array

CLOSE = 1e-9
"""Sampling periods that differ by less, relatively, are the same."""


def read_tdms(path: Path, request: Request) -> Contents:
    """Read channels of a TDMS file (LabVIEW): ``group/channel``, or the channel alone if unique."""
    nptdms = library("nptdms")
    columns, units, clocks, begins = {}, {}, [], []
    with nptdms.TdmsFile.open(path) as file:
        channels = _by_name({f"{g.name}/{c.name}": c for g in file.groups() for c in g.channels()})
        for name in _present(request.wanted, channels):
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
    begin = "" if not begins or begins[0] is None else str(np.datetime64(begins[0], "us"))
    time = _even(clocks, columns)
    return Contents(columns, units, time=time, begin=begin if time is not None else "")


def read_uff(path: Path, request: Request) -> Contents:
    """Read functions of time (data sets 58) of a universal file, by number from 0 on or by name.

    Names are the first line of a set, or the label of its ordinate, where these are unique.
    """
    pyuff = library("pyuff")
    check_room(path.stat().st_size * 2, "the file")
    file = pyuff.UFF(str(path))
    columns, units, clocks, sets = {}, {}, [], {}
    heads = {}
    for k, kind in enumerate(file.get_set_types()):
        if int(kind) == 58:
            sets[str(len(sets))] = k
    for number, k in sets.items():
        heads[number] = file.read_sets(k)
    labels: dict[str, list[str]] = {}
    for number, head in heads.items():
        for key in ("id1", "rsp_ent_name", "ordinate_axis_lab"):
            label = str(head.get(key, "")).strip()
            if label and label != "NONE":
                labels.setdefault(label, []).append(number)
    named = {label: heads[n[0]] for label, n in labels.items() if len(set(n)) == 1} | heads
    for name in _present(request.wanted, named):
        head = named[name]
        if np.iscomplexobj(head["data"]):
            raise DataError(f"'{name}' is a spectrum, not a function of time")
        if int(head.get("abscissa_spec_data_type", 17)) not in (0, 17):
            over = head.get("abscissa_axis_lab")
            raise DataError(f"'{name}' is not a function of time, but of '{over}'")
        columns[name] = np.asarray(head["data"], float)
        unit = str(head.get("ordinate_axis_units_lab", "")).strip()
        units[name] = "" if unit == "NONE" else unit
        if int(head["abscissa_spacing"]) == 1:
            clocks.append((name, float(head["abscissa_min"]), float(head["abscissa_inc"])))
    uneven = [np.asarray(named[n]["x"], float) for n in columns if n not in {c[0] for c in clocks}]
    if uneven and (clocks or any(not np.array_equal(x, uneven[0]) for x in uneven)):
        raise DataError("the functions are at different times; read each by itself and merge them")
    return Contents(columns, units, time=uneven[0] if uneven else _even(clocks, columns))


def read_wav(path: Path, request: Request) -> Contents:
    """Read channels of a sound, ``data[0]``, ...: whole numbers are counts as they are stored."""
    check_room(path.stat().st_size * 8, "the sound")
    rate, values = scipy.io.wavfile.read(path)
    matrix = np.asarray(values).reshape(len(values), -1)
    arrays = {str(k): matrix[:, k] for k in range(matrix.shape[1])} | {"data": matrix}
    columns = pick(arrays, request.wanted, axis=0)
    return Contents(columns, time=np.arange(len(matrix)) / rate)


def read_lvm(path: Path, request: Request) -> Contents:
    """Read channels of a LabVIEW measurement file; ``X_Value`` is exact, not rounded as written."""
    content = content_of(path, request.text.encoding)
    mark = b"***End_of_Header***"
    if not content.startswith(b"LabVIEW") or mark not in content:
        raise DataError("this is no LabVIEW measurement: there is no header")
    end = content.rindex(mark)
    head = content[:end].decode(errors="replace").splitlines()
    sign = "\t" if any(re.match(r"Separator\tTab", line) for line in head) else ","
    fields: dict[str, list[str]] = {}
    for line in head:
        key, *values = line.split(sign)
        fields[key] = values
    start = content.index(b"\n", end) + 1
    if re.search(rb"\nX_Value", content[content.index(mark) : end]):
        raise DataError("the file has several segments; save each as a file of its own")
    decimal = (fields.get("Decimal_Separator") or ["."])[0] or "."
    names_line = content[start : content.index(b"\n", start)].decode(errors="replace")
    names = [name.strip() for name in names_line.split(sign)]
    text = dataclasses.replace(request.text, delimiter=sign, decimal=decimal, header=1)
    found = read_content(content[start:], dataclasses.replace(request, text=text))
    places = {name: names.index(name) for name in request.wanted if name in names}
    one = (fields.get("X_Columns") or ["One"])[0]
    lead = 1 if one == "One" else 0

    def of(key: str, name: str) -> str:
        values, k = fields.get(key, []), places[name] - lead
        return values[k].strip() if 0 <= k < len(values) else ""

    units = {name: of("Y_Unit_Label", name) for name in places if name != request.clock}
    clocks = [
        (name, _number(of("X0", name), decimal), _number(of("Delta_X", name), decimal))
        for name in places
        if name != request.clock and of("Delta_X", name)
    ]
    time = _even(clocks, found.columns) if one != "Multi" else None
    columns = dict(found.columns)
    if time is not None and request.clock in columns and request.clock == "X_Value":
        columns[request.clock] = time
    return Contents(columns, units, found.understood, time=time)


def read_outb(path: Path, request: Request) -> Contents:
    """Read channels of OpenFAST's binary output; ``Time`` is one of them.

    Values are packed in 16 bits with a scale and an offset per channel, or doubles; the layout is
    that of OpenFAST's ``WrBinFAST``.
    """
    size = path.stat().st_size
    with path.open("rb") as file:

        def take(code: str, count: int = 1) -> Any:
            needed = struct.calcsize(code) * count
            if needed < 0 or file.tell() + needed > size:
                raise DataError("the file is cut off, or not of OpenFAST")
            return np.frombuffer(file.read(needed), f"<{code}", count)

        kind = int(take("h")[0])
        if kind not in (1, 2, 3, 4):
            raise DataError(f"this is not OpenFAST's binary output: its kind is {kind}")
        width = int(take("h")[0]) if kind == 4 else 10
        channels, samples = (int(n) for n in take("i", 2))
        if channels < 0 or samples < 0 or width < 1:
            raise DataError("the file claims a negative size")
        scale = take("d", 2)
        packing = None if kind == 3 else (take("f", channels), take("f", channels))
        take("b", int(take("i")[0]))  # description
        labels = [_label(take("b", width)) for _ in range(2 * (channels + 1))]
        names, units = labels[: channels + 1], labels[channels + 1 :]
        check_room(8 * channels * samples, "the output")
        if kind == 1:
            time = (take("i", samples) - scale[1]) / scale[0]
        else:
            time = scale[0] + scale[1] * np.arange(samples)
        table = take("d" if kind == 3 else "h", channels * samples).reshape(samples, channels)
    places = {name: k for k, name in enumerate(names)}
    columns: dict[str, Array] = {}
    for name in _present(request.wanted, places):
        k = places[name] - 1
        if k < 0:
            columns[name] = time
        elif packing is None:
            columns[name] = table[:, k].astype(float)
        else:
            columns[name] = (table[:, k] - packing[1][k].astype(float)) / packing[0][k]
    found = {name: units[places[name]].strip("()") for name in columns}
    return Contents(columns, found, time=time)


def _label(characters: np.ndarray) -> str:
    return characters.tobytes().decode("latin-1").strip(" \0")


def _number(text: str, decimal: str) -> float:
    try:
        return float(text.replace(decimal, "."))
    except ValueError:
        raise DataError(f"the header has '{text}' in the place of a number") from None


def _by_name(channels: Mapping[str, Any]) -> dict[str, Any]:
    """Channels by group and name, and by name alone where that is unique."""
    bare = [full.partition("/")[2] for full in channels]
    return {
        name: channel
        for name, channel in zip(bare, channels.values(), strict=True)
        if bare.count(name) == 1
    } | dict(channels)


def _present(wanted: Iterable[str], known: Mapping[str, Any]) -> list[str]:
    wanted = list(wanted)
    absent = [no_column(name, known) for name in wanted if name not in known]
    if absent:
        raise DataError("; ".join(absent))
    return wanted


def _even(clocks: list[tuple[str, float, float]], columns: Mapping[str, Array]) -> Array | None:
    """Times of channels that say their first time and period, which must be the same [s]."""
    if not clocks:
        return None
    name, start, step = clocks[0]
    for other, begin, period in clocks[1:]:
        if abs(period - step) > CLOSE * abs(step) or abs(begin - start) > CLOSE * abs(step):
            raise DataError(
                f"'{name}' has a sample every {step:g} s from {start:g} s on, '{other}' every "
                f"{period:g} s from {begin:g} s on; read each by itself and merge them"
            )
    return start + step * np.arange(len(columns[name]), dtype=float)
