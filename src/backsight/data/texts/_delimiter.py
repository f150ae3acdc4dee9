"""What separates the cells of a text."""

import re
from collections.abc import Sequence

from backsight.data._request import TextForm
from backsight.data.texts._cells import Line
from backsight.data.texts._numbers import NumberForm
from backsight.errors import DataError

DELIMITERS = ";\t|,"
"""The first that is in nearly every line; without any, cells are separated by blanks."""

_WORDS = re.compile(r'[^",;\t|]*[A-Za-z][^",;\t|]*')
_PLAIN_COMMA = re.compile(r"[+-]?\d+,\d+")


def quoted(body: Sequence[Line]) -> bool:
    """Whether a line has quotes."""
    return any('"' in line.text for line in body)


def delimiter_of(body: Sequence[Line], form: TextForm, wanted: Sequence[str]) -> str | None:
    """Sign between cells; None for blanks. Raises `DataError` if that could be either way."""
    if form.delimiter is not None:
        return None if form.delimiter.strip(" ") == "" else form.delimiter
    sample = body[len(body) // 3 :] if len(body) > 6 else body[1:] or body
    # What stands before and after the numbers is prose.
    sample = [line for line in sample if any(map(str.isdigit, line.text))] or sample
    found = _common(sample, body)
    if found == "," and _only_decimal(body, sample, form, wanted):
        return None
    return found


def _common(sample: Sequence[Line], body: Sequence[Line]) -> str | None:
    """The sign that is in nearly all lines; in all but one, which may be cut off, second best."""
    second = None
    for sign in DELIMITERS if sample else ():
        lacking = sum(sign not in line.text for line in sample)
        named = lacking <= 1 < len(sample) and sign in body[0].text
        if named or lacking <= 0.1 * len(sample):
            return sign
        if lacking == 1 and len(sample) > 3:
            second = second or sign
    return second


def _only_decimal(
    body: Sequence[Line], sample: Sequence[Line], form: TextForm, wanted: Sequence[str]
) -> bool:
    """Whether commas are decimal signs: between blanks, or in the only column."""
    if form.decimal == "," and not quoted(sample):
        return True
    if form.decimal == ".":
        return False
    if any("," in line.text and re.search("[A-Za-z]", line.text) for line in body):
        return False  # names with commas between them
    rows = [line.text.split() for line in sample]
    cells = [cell for row in rows for cell in row]
    if any(not _PLAIN_COMMA.fullmatch(c) and NumberForm().value(c) is None for c in cells):
        return False
    if len({len(row) for row in rows}) != 1:
        return False
    if len(rows[0]) > 1:
        return True
    head = body[0].text.strip()
    if _WORDS.fullmatch(head):
        return True  # one name for what would be two columns
    if not _PLAIN_COMMA.fullmatch(head):
        return False
    halves = [row[0].split(",") for row in ([head], *rows)]
    known = set(wanted)
    if "1" in known:
        return False
    digits = {len(fraction) for _, fraction in halves}
    padded = any(len(f) > 1 and f.startswith("0") for _, f in halves)
    still = len({whole.lstrip("+-") for whole, _ in halves}) == 1
    if any(w.startswith("-0") for w, _ in halves) or (len(digits) == 1 and (padded or still)):
        return True
    raise DataError(
        f"'{head}' may be one number with a decimal comma or two numbers; say decimal = \",\" or "
        'delimiter = ","'
    )
