"""Results of HAWC2: a ``.sel`` that names the channels, and a ``.dat`` with the numbers."""

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd

from backsight.data._pick import present
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_room
from backsight.errors import DataError
from backsight.types import Array

_SIZES, _FIRST, _AFTER = 8, 12, 2
"""Lines before the sizes, before the channels, and between these and the scale factors."""

_NAME, _UNIT, _ABOUT = slice(12, 43), slice(43, 54), slice(54, None)
"""Columns of a channel's line."""

_MOST = 1 << 26  # bytes of a .sel


def read_hawc2(path: Path, request: Request) -> Contents:
    """Read channels of a HAWC2 result, given its ``.sel`` or its ``.dat``.

    Names are those of the channels where these are unique, otherwise their descriptions, or the
    numbers of the channels, from 1 on. The binary form holds 16 bits with a factor for each
    channel, one channel after the other. Its time is a channel like others, rounded; the samples
    are an even grid, whose offset is taken from there.
    """
    head = _Head.read(path)
    data = _sibling(path, ".dat")
    places = head.places
    wanted = {name: places[name] for name in present(request.wanted, places)}
    table = _binary if head.factors is not None else _text
    numbers = table(data, head, {0, *wanted.values()})
    period = head.duration / head.samples
    begin = period * round(
        float(np.median(numbers[0] - period * np.arange(len(numbers[0])))) / period
    )
    time = begin + period * np.arange(len(numbers[0]))
    is_time = head.names[0].lower().startswith("time")
    columns = {n: time if k == 0 and is_time else numbers[k] for n, k in wanted.items()}
    units = {name: head.units[k] for name, k in wanted.items()}
    return Contents(columns, units, time=time if is_time else None)


def list_hawc2(path: Path, _: Request) -> list[Listed]:
    """List the channels."""
    names: dict[int, str] = {}
    for name, k in _Head.read(path).places.items():
        names.setdefault(k, name)
    return [Listed(names[k]) for k in sorted(names)]


@dataclasses.dataclass(frozen=True)
class _Head:
    """What the ``.sel`` says.

    Parameters
    ----------
    samples : int
    duration : float
        Of all samples [s].
    names, units, descriptions : tuple of str
        Of the channels.
    factors : (channels,) array or None
        From 16 bits to numbers; None if these are text.
    """

    samples: int
    duration: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    descriptions: tuple[str, ...]
    factors: Array | None

    @property
    def places(self) -> dict[str, int]:
        """Channels by name, description and number, where these are unique."""
        found: dict[str, int] = {}
        for labels in (self.names, self.descriptions):
            for k, label in enumerate(labels):
                if label and labels.count(label) == 1:
                    found.setdefault(label, k)
        return {
            **found,
            **{str(k + 1): k for k in range(len(self.names)) if str(k + 1) not in found},
        }

    @classmethod
    def read(cls, path: Path) -> "_Head":
        """Read it; raises `DataError` if this is something else."""
        sel = _sibling(path, ".sel")
        if sel.stat().st_size > _MOST:
            raise DataError("this is not the list of channels of HAWC2: it is too long")
        lines = sel.read_text(encoding="latin-1").splitlines()
        try:
            samples, channels, duration, form = lines[_SIZES].split()[:4]
            n, count = int(samples), int(channels)
            rows = lines[_FIRST : _FIRST + count]
            scales = lines[_FIRST + count + _AFTER : _FIRST + 2 * count + _AFTER]
            binary = form.lower() == "binary"
            factors = np.array([float(line) for line in scales]) if binary else None
            length = float(duration)
        except (IndexError, ValueError) as error:
            raise DataError(f"this is not the list of channels of HAWC2: {error}") from None
        if len(rows) < count or count < 1 or n < 1 or not length > 0:
            raise DataError(
                f"the list of channels is cut off: {count} are told, {len(rows)} listed"
            )
        if factors is not None and len(factors) < count:
            raise DataError(f"the list of channels has {len(factors)} of {count} scale factors")
        names, units, descriptions = (
            tuple(row[part].strip() for row in rows) for part in (_NAME, _UNIT, _ABOUT)
        )
        return cls(n, length, names, units, descriptions, factors)


def _binary(data: Path, head: _Head, wanted: set[int]) -> dict[int, Array]:
    assert head.factors is not None
    claimed = 2 * head.samples * len(head.names)
    if claimed != data.stat().st_size:
        raise DataError(
            f"{data.name} has {data.stat().st_size} bytes, but {head.samples} samples of "
            f"{len(head.names)} channels are {claimed}; the run was cut off, or the files do not "
            "belong together"
        )
    check_room(8 * head.samples * len(wanted), "the result")
    packed = np.memmap(data, "<i2", "r", shape=(len(head.names), head.samples))
    return {k: packed[k] * head.factors[k] for k in wanted}


def _text(data: Path, head: _Head, wanted: set[int]) -> dict[int, Array]:
    check_room(8 * head.samples * len(wanted), "the result")
    table = pd.read_csv(data, sep=r"\s+", header=None, usecols=sorted(wanted), dtype=float)
    if len(table) > head.samples:
        raise DataError(f"{data.name} has {len(table)} rows, but {head.samples} samples are told")
    return {k: table[k].to_numpy() for k in wanted}


def _sibling(path: Path, suffix: str) -> Path:
    """The file of the same name with another suffix, whatever the case of its letters."""
    if path.suffix.lower() == suffix:
        return path
    for form in (suffix, suffix.upper()):
        if (found := path.with_suffix(form)).is_file():
            return found
    raise DataError(f"the results of HAWC2 are two files; there is no '{path.with_suffix(suffix)}'")
