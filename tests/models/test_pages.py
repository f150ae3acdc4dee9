"""The examples of the pages on models are executed."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ["forces-with-dynamics.md", "implicit-models.md"]


@pytest.mark.parametrize("page", PAGES)
def test_examples_run_and_print_what_the_page_shows(page, capsys):
    text = (DOCS / page).read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(block, names)
    for line in capsys.readouterr().out.splitlines():
        assert f"    {line}".rstrip() in text.splitlines(), line
