"""Every Python block of README and pages runs, page by page, from top to bottom."""

import re
import shutil
import sys
import types
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
PAGES = [
    page.relative_to(ROOT).as_posix()
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if BLOCK.search(page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize("page", PAGES)
def test_every_block_runs(page, tmp_path, monkeypatch):
    shutil.copytree(ROOT / "examples" / "stage", tmp_path / "examples" / "stage")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / page).read_text(encoding="utf-8")
    module = types.ModuleType("page")  # in sys.modules, so that its classes can be pickled
    monkeypatch.setitem(sys.modules, "page", module)
    for block in BLOCK.finditer(text):
        before = text[: block.start(1)].count("\n")
        exec(compile("\n" * before + block[1], page, "exec"), vars(module))


def test_there_are_pages_with_blocks():
    assert len(PAGES) > 15
