"""What a notebook shows: the text of a tree and the equations, escaped."""

import html
import inspect
import re
import textwrap
from collections.abc import Iterable

BLOCK = re.compile(r"^([ ]*)\.\. math::(.*(?:\n(?:\1[ ]+.*|[ ]*$))*)", re.MULTILINE)
"""A block of equations in a docstring: the rest of its line, and what is indented below it."""


def preformatted(text: str) -> str:
    """Return text as HTML that keeps its lines."""
    return f"<pre>{html.escape(text)}</pre>"


def equations_of(formulas: Iterable[str]) -> str:
    """Return formulas in LaTeX as HTML that a notebook typesets."""
    return "".join(f"<div>$${html.escape(f)}$$</div>" for f in formulas)


def page_of(kind: type, text: str) -> str:
    """Return a text and, folded away, the equations in the docstring of its class."""
    formulas = formulas_in(inspect.cleandoc(kind.__doc__ or ""))
    if not formulas:
        return preformatted(text)
    folded = f"<details><summary>equations</summary>{equations_of(formulas)}</details>"
    return preformatted(text) + folded


def formulas_in(docstring: str) -> list[str]:
    """Return the equations of a docstring in LaTeX, one per paragraph of its blocks."""
    found = []
    for block in BLOCK.finditer(docstring):
        first, _, rest = block.group(2).partition("\n")
        text = f"{first.strip()}\n{textwrap.dedent(rest)}".strip()
        for paragraph in re.split(r"\n\s*\n", text):
            lines = " ".join(paragraph.split())
            found.append(rf"\begin{{aligned}}{lines}\end{{aligned}}" if "&" in lines else lines)
    return found
