"""The rules of accessibility of axe, on a page of the browser.

`AXE` in the environment names another axe.min.js, such as a newer one from npm.
"""

import functools
import importlib.resources
import importlib.util
import os
from pathlib import Path

from tests.workbench.browser import Page

THERE = "AXE" in os.environ or importlib.util.find_spec("axe_core_python") is not None


@functools.cache
def _rules() -> str:
    if given := os.environ.get("AXE"):
        return Path(given).read_text(encoding="utf-8")
    own = importlib.resources.files("axe_core_python").joinpath("axe.min.js")
    return own.read_text(encoding="utf-8")


def findings(page: Page) -> list[str]:
    """What axe finds wrong with the page as it is now: the rule, and the first element.

    What a plot draws is left out, which takes minutes; it is a group with a name.
    """
    page.value(_rules() + ";1")
    found = page.value(
        "axe.run({ exclude: ['figure', 'script'] }).then((r) => r.violations.map("
        "(v) => [v.id, v.impact, v.help, v.nodes[0].html.slice(0, 120)].join(': ')))"
    )
    return list(found)
