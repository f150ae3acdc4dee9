"""How a text is laid out: what separates cells, where names, units and numbers are."""

import collections
import dataclasses
from collections.abc import Sequence

from backsight.data._request import TextForm
from backsight.data.texts._cells import Line, cells_of, is_blank, lines, trimmed
from backsight.data.texts._delimiter import delimiter_of, quoted
from backsight.data.texts._numbers import MISSING, NumberForm, is_numeric, signs
from backsight.data.texts._units import split, units_of
from backsight.data.times.dates import is_date
from backsight.errors import DataError

COMMENTS = ("#", "%", "!", "//")
"""What comments begin with; all but the first only where the first line does so."""

_HEAD, _SPOT, _MOST = 1 << 18, 1 << 14, 300


@dataclasses.dataclass(frozen=True)
class Layout:
    """Names and units of columns; delimiter (None: blanks); the bytes that the numbers take.

    Columns of `numeric` hold numbers or dates.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    delimiter: str | None
    numbers: NumberForm
    numeric: tuple[int, ...]
    comment: str
    start: int
    first_line: int
    stop: int
    understood: str

    def position(self, name: str) -> int | None:
        """Of a column by its name, also without the unit behind it; None if there is none."""
        return _place(self.names, name)


@dataclasses.dataclass(frozen=True)
class _Spread:
    """Lines from the top, and some from the middle and the end, to judge the whole by."""

    top: list[Line]
    all: list[Line]


def layout_of(content: bytes, form: TextForm, wanted: Sequence[str]) -> Layout:
    """Look at a text and see how it is laid out; what `form` says is not asked.

    Raises
    ------
    DataError
        If it holds zeros, or could be understood in two ways.
    """
    spread = _spread(content, form.skip_lines)
    begins = spread.top[0].text.lstrip() if spread.top else ""
    comment = next((sign for sign in COMMENTS if begins.startswith(sign)), "#")
    top = [line for line in spread.top if not _is_comment(line, comment)]
    remarks = [line for line in spread.top if _is_comment(line, comment)]
    body = [line for line in spread.all if not _is_comment(line, comment)]
    delimiter = delimiter_of(body, form, wanted)
    table = {line.start: trimmed(cells_of(line.text, delimiter)) for line in (*top, *body)}
    width, numeric = _columns([table[line.start] for line in body])
    first = _first_data(top, table, numeric, form)
    names, units, noted = _names(top[:first], remarks, width, delimiter, form, wanted)
    begin = top[first] if first < len(top) else None
    stop, footer = _footer(content, begin, delimiter, numeric, comment)
    places = [p for name in wanted if (p := _place(names, name)) is not None] or list(numeric)
    seen = [
        cells[j]
        for line in body
        if begin is not None and begin.start <= line.start < stop
        for cells in (table[line.start],)
        for j in places
        if j < len(cells) and not is_date(cells[j])
    ]
    decimal, thousands = form.decimal, form.thousands
    if decimal is None and not (thousands is None and delimiter == "," and not quoted(body)):
        if thousands is None:
            decimal, thousands = signs(seen)
        else:
            decimal = "," if thousands == "." else "."
    decimal = decimal or "."
    notes = [
        *noted,
        f"decimal sign '{decimal}'" if decimal != "." else "",
        f"thousands '{thousands}'" if thousands else "",
        f"the end left off: '{footer}'" if footer else "",
    ]
    numbers = NumberForm(decimal, thousands, MISSING + tuple(map(str, _words(form))))
    return Layout(
        names=tuple(names),
        units=tuple(units),
        delimiter=delimiter,
        numbers=numbers,
        numeric=tuple(numeric),
        comment=comment,
        start=begin.start if begin else len(content),
        first_line=begin.number if begin else 1,
        stop=stop,
        understood="; ".join(filter(None, notes)),
    )


def _place(names: Sequence[str], name: str) -> int | None:
    if name in names:
        return names.index(name)
    bare = [split(full)[0] for full in names]
    return bare.index(name) if bare.count(name) == 1 else None


def _words(form: TextForm) -> list[str]:
    return [code for code in form.missing if isinstance(code, str)]


def _spread(content: bytes, skip: int) -> _Spread:
    top = []
    for line in lines(content):
        if line.start > _HEAD or len(top) == _MOST:
            break
        if line.number <= skip or is_blank(line.text):
            continue
        if "\0" in line.text and not top:
            raise DataError("this is not plain text; export it again as such, or say its encoding")
        top.append(line)
    rest = []
    for start in (len(content) // 2, len(content) - _SPOT):
        if top and start > top[-1].start + len(top[-1].text) + 1:
            spot = [*lines(content, start=start, stop=min(start + _SPOT, len(content)))]
            rest += [line for line in spot[1:-1] if not is_blank(line.text)]
    return _Spread(top, top + rest)


def _is_comment(line: Line, comment: str) -> bool:
    text = line.text.lstrip()
    return text.startswith(("#", comment))


def _columns(rows: Sequence[list[str]]) -> tuple[int, list[int]]:
    """Number of cells in most lines, and the columns that hold numbers or dates in most."""
    later = rows[len(rows) // 3 :] if len(rows) > 6 else rows[1:] or rows
    widths = collections.Counter(len(row) for row in later if row)
    width = max(widths, key=lambda w: widths[w], default=0)
    shares = []
    for j in range(max(widths, default=0)):
        known = [row[j] for row in later if j < len(row) and row[j]]
        values = sum(map(_is_value, known))
        # The cells at the end of most lines may be blank: of a slow channel, the last one.
        beyond = j >= width and not (known and values == len(known))
        shares.append(not beyond and 2 * values >= len(known))
    return width, [j for j, share in enumerate(shares) if share]


def _is_value(cell: str) -> bool:
    return is_numeric(cell) or is_date(cell)


def _first_data(
    top: Sequence[Line], table: dict[int, list[str]], numeric: Sequence[int], form: TextForm
) -> int:
    """Index of the first line of numbers."""
    if form.header is not None:
        return next((k for k, line in enumerate(top) if line.number > form.header), len(top))
    if not numeric:
        return min(1, len(top))
    for k, line in enumerate(top):
        cells = table[line.start]
        if _is_row(cells, numeric):
            return k
    return len(top)


def _is_row(cells: Sequence[str], numeric: Sequence[int]) -> bool:
    there = [cells[j] for j in numeric if j < len(cells)]
    known = [cell for cell in there if cell]
    values = sum(_is_value(cell) for cell in known)
    return values > 0 and _is_value(there[0]) and 2 * values >= len(known)


def _names(
    above: Sequence[Line],
    remarks: Sequence[Line],
    width: int,
    delimiter: str | None,
    form: TextForm,
    wanted: Sequence[str],
) -> tuple[list[str], list[str], list[str]]:
    """Names, units, and what to say about where they were."""
    candidates = [*above]
    if form.header:
        named = [line for line in above if line.number == form.header]
        if not named:
            raise DataError(f"line {form.header}, the header, is blank, a comment or skipped")
        candidates = named
    elif form.header == 0:
        candidates = []
    if candidates:
        cells = cells_of(candidates[-1].text, delimiter)
        cells = _with_units(cells) if delimiter is None and len(cells) > width else cells
        rows = [cells_of(line.text, delimiter) for line in candidates[-2:]]
        units = units_of(trimmed(rows[-1])) if len(rows) == 2 else None
        is_units = units is not None and not set(wanted) & set(rows[-1])
        if is_units and units is not None and len(trimmed(rows[0])) >= len(units):
            names = rows[0]
            return names, _padded(units, names), ["a line of units", *_preamble(candidates[:-2])]
        if len(trimmed(cells)) < width:
            raise DataError(
                f"the line of names has {len(cells)} cells, the first line of numbers {width}"
            )
        return cells, [split(n)[1] for n in cells], _preamble(candidates[:-1])
    numbered = [str(k) for k in range(width)]
    if form.header == 0:
        return numbered, [""] * width, []
    rows = [cells_of(line.text.strip(" #%!/"), delimiter) for line in remarks]
    for k in range(len(rows) - 1, -1, -1):
        if len(rows[k]) == width and not (units_of(rows[k]) and not set(wanted) & set(rows[k])):
            below = rows[k + 1] if k + 1 < len(rows) else []
            units = units_of(below) if len(below) == width else None
            return rows[k], units or [split(n)[1] for n in rows[k]], []
    for row in reversed(rows):  # a single comment that looks like units may be names as well
        if len(row) == width:
            return row, [""] * width, []
    return numbered, [""] * width, []


def _with_units(words: Sequence[str]) -> list[str]:
    """Names and their units in brackets together, where blanks separate both."""
    names: list[str] = []
    for word in words:
        if names and word[0] in "([" and word[-1] in ")]":
            names[-1] += f" {word}"
        else:
            names.append(word)
    return names


def _preamble(before: Sequence[Line]) -> list[str]:
    if not before:
        return []
    text = before[0].text.strip()[:40]
    count = "1 line" if len(before) == 1 else f"{len(before)} lines"
    return [f"{count} before the names left off, from '{text}' on"]


def _padded(units: list[str], names: Sequence[str]) -> list[str]:
    return units + [""] * (len(names) - len(units))


def _footer(
    content: bytes,
    begin: Line | None,
    delimiter: str | None,
    numeric: Sequence[int],
    comment: str,
) -> tuple[int, str]:
    """Where the numbers end, and the first line after them.

    Lines without any number in a cell; statistics, too, which have a word where all rows have a
    value: several of them, or behind a blank line. A single one may be a code for "not measured".
    """
    if begin is None or not numeric:
        return len(content), ""
    start = max(begin.start, len(content) - _SPOT)
    last = [*lines(content, start=start)]
    last = last if start == begin.start else last[1:]
    stop, first = len(content), ""
    words: dict[str, tuple[int, str]] = {}
    for line in reversed(last):
        if is_blank(line.text):
            stop, first = next(reversed(words.values()), (stop, first))
            words = {}
            continue
        if _is_comment(line, comment):
            continue
        cells = cells_of(line.text, delimiter)
        known = [cell for cell in cells if cell]
        if "\0" in line.text or not known:
            break
        here = line.start, line.text.strip()[:60]
        if any(map(_is_value, known)):
            word = cells[numeric[0]] if numeric[0] < len(cells) else ""
            if not word[:1].isalpha() or _is_value(word) or word in MISSING or word in words:
                break
            words[word] = here
        else:
            (stop, first), words = here, {}
    return next(reversed(words.values())) if len(words) > 1 else (stop, first)
