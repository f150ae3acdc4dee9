"""Text files of LabVIEW (LVM): a header for the file, one for the channels, and numbers."""

import dataclasses
import datetime
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight.data._request import Contents, Listed, Request
from backsight.data.texts.content import content_of
from backsight.data.texts.reading import read_content
from backsight.data.times.grid import even_times
from backsight.errors import DataError


@dataclasses.dataclass(frozen=True)
class _Header:
    """What the two headers say.

    Parameters
    ----------
    names : tuple of str
        Of the columns.
    fields : dict
        Key to its entries, one per channel in the second header.
    numbers : bytes
        The line of names and the numbers.
    sign, decimal : str
        Between cells and in numbers.
    """

    names: tuple[str, ...]
    fields: Mapping[str, Sequence[str]]
    numbers: bytes
    sign: str
    decimal: str

    @property
    def clocks(self) -> str:
        """Columns of time: "No", "One" for all, or "Multi", one for each channel."""
        return (self.fields.get("X_Columns") or ["One"])[0]

    def entry(self, key: str, name: str) -> str:
        """Of a channel, "" if there is none."""
        lead = 1 if self.clocks == "One" else 0
        values, k = self.fields.get(key, []), self.names.index(name) - lead
        return values[k].strip() if 0 <= k < len(values) else ""

    def number(self, key: str, name: str) -> float:
        """Of a channel; raises `DataError`."""
        text = self.entry(key, name)
        try:
            return float(text.replace(self.decimal, "."))
        except ValueError:
            raise DataError(f"the header has '{text}' in the place of a number") from None


def read_lvm(path: Path, request: Request) -> Contents:
    """Read channels of a LabVIEW measurement file; ``X_Value`` is exact, not rounded as written."""
    header = _header(content_of(path, request.text.encoding))
    text = dataclasses.replace(
        request.text, delimiter=header.sign, decimal=header.decimal, header=1
    )
    found = read_content(header.numbers, dataclasses.replace(request, text=text))
    channels = [n for n in request.wanted if n in header.names and n != request.clock]
    units = {name: header.entry("Y_Unit_Label", name) for name in channels}
    clocks = [
        (name, header.number("X0", name), header.number("Delta_X", name))
        for name in channels
        if header.entry("Delta_X", name)
    ]
    time = even_times(clocks, found.columns) if header.clocks != "Multi" else None
    columns = dict(found.columns)
    if time is not None and request.clock in columns and request.clock == "X_Value":
        columns[request.clock] = time
    begins = {(header.entry("Date", name), header.entry("Time", name)) for name, *_ in clocks}
    begin = _moment(*begins.pop()) if time is not None and len(begins) == 1 else ""
    return Contents(columns, units, found.understood, time=time, begin=begin)


def list_lvm(path: Path, request: Request) -> list[Listed]:
    """List the channels."""
    header = _header(content_of(path, request.text.encoding))
    names = [name for name in header.names if name not in ("", "X_Value", "Comment")]
    return [
        Listed(name)
        if header.names.count(name) == 1
        else Listed(name, "other", f"{header.names.count(name)} columns are called so")
        for name in dict.fromkeys(names)
    ]


def _header(content: bytes) -> _Header:
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
    line = content[start : content.index(b"\n", start)].decode(errors="replace")
    return _Header(
        names=tuple(name.strip() for name in line.split(sign)),
        fields=fields,
        numbers=content[start:],
        sign=sign,
        decimal=(fields.get("Decimal_Separator") or ["."])[0] or ".",
    )


def _moment(date: str, clock: str) -> str:
    """Date of the zero of time, "" if the header does not say it; fractions to microseconds."""
    whole, _, fraction = clock.replace(",", ".").partition(".")
    try:
        moment = datetime.datetime.strptime(f"{date} {whole}", "%Y/%m/%d %H:%M:%S")
        return moment.replace(microsecond=int(fraction.ljust(6, "0")[:6])).isoformat()
    except ValueError:
        return ""
