"""The page of promises is that of the list, and every file that it names is there."""

import importlib.util
from pathlib import Path

PAGES = Path(__file__).parents[2] / "docs"


def test_the_page_of_promises_is_that_of_the_list():
    found = importlib.util.spec_from_file_location("promises", PAGES / "promises.py")
    assert found is not None
    assert found.loader is not None
    promises = importlib.util.module_from_spec(found)
    found.loader.exec_module(promises)
    assert promises.PAGE.read_text(encoding="utf-8") == promises.page(), "run docs/promises.py"
