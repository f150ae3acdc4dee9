"""Every example of docs/structures.md, one after the other."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "structures.md"


def test_the_examples_of_the_page_run(capsys):
    names: dict[str, object] = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)  # our own page
    said = " ".join(capsys.readouterr().out.split())
    assert "up to 3 of 8 places" in said or "observable" in said
    assert str(names["frame"]).startswith("structure (continuous)")
