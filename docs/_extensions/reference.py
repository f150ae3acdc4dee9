"""The pages of the reference: one a namespace, one a name, from the table of public names."""

import inspect
import sys
from pathlib import Path
from types import ModuleType

from sphinx.application import Sphinx
from sphinx.config import Config

sys.path.insert(0, str(Path(__file__).parents[1]))
import names  # docs/names.py, which lists what is public

import backsight as bs

INDEX = """Reference
=========

Every public name, from its docstring. ``import backsight as bs`` has models, estimators and verbs;
the rest is in namespaces.

.. toctree::
   :maxdepth: 1

{rows}
"""

SPACE = """{title}

.. currentmodule:: {module}

{about}

.. autosummary::
   :nosignatures:

{rows}

.. toctree::
   :hidden:
   :glob:

   {folder}/*
"""

NAME = """{title}

.. currentmodule:: {module}

.. auto{kind}:: {name}
{options}
"""


def write_pages(app: Sphinx, _: Config) -> None:
    """Write the pages into the folder ``reference``; what is no longer public goes."""
    out = Path(app.srcdir, "reference")
    pages = {}
    for space, module in names.spaces().items():
        shown = listed(module)
        pages[f"{space}.rst"] = SPACE.format(
            title=heading(space),
            module=module.__name__,
            about=names.first_line_of_module(module),
            rows="\n".join(f"   {n}" for n in shown),
            folder=space,
        )
        for n in shown:
            pages[f"{space}/{n}.rst"] = page(module, n, title=f"{space}.{n}")
    rows = "\n".join(f"   {space}" for space in names.spaces())
    pages["index.rst"] = INDEX.format(rows=rows)
    for old in out.rglob("*.rst"):
        if str(old.relative_to(out)) not in pages:
            old.unlink()
    for path, text in pages.items():
        replace(out / path, text)


def listed(module: ModuleType) -> list[str]:
    """Names with a page in this namespace: a name has one page, that of the shorter path."""
    shown = [n for n in names.names(module) if callable(getattr(module, n))]
    if module is bs:
        return shown
    return [n for n in shown if getattr(bs, n, None) is not getattr(module, n)]


def page(module: ModuleType, name: str, *, title: str) -> str:
    """Page of one name."""
    is_class = inspect.isclass(getattr(module, name))
    kind = "class" if is_class else "function"
    where = module.__name__
    # Sizes such as nx in docstrings lead to the model's, and nowhere else.
    options = "   :members:\n" if is_class and module is not bs.testing else ""
    return NAME.format(title=heading(title), module=where, kind=kind, name=name, options=options)


def heading(title: str) -> str:
    """Title of a page."""
    return f"{title}\n{'=' * len(title)}"


def replace(path: Path, text: str) -> None:
    """Write a page if it has changed, so that Sphinx builds no page for nothing."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for sources."""
    app.connect("config-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
