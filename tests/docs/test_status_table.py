"""The page of symbols has every status of a sample."""

import re
from pathlib import Path

from backsight.schema import Status

NOTATION = Path(__file__).parents[2] / "docs" / "notation.md"


def test_every_status_is_in_the_table():
    rows = re.findall(r"^\| (\d+) \| ([a-z ]+) \|", NOTATION.read_text("utf-8"), re.MULTILINE)
    named = {int(bit): name.replace(" ", "_").upper() for bit, name in rows}
    assert named == {bit.value: bit.name for bit in Status}
