"""What docstrings say of the fields of a class, for people who do not read code."""

import inspect
import re
from collections.abc import Callable

_ENTRY = re.compile(r"(?P<names>[\w, ]+?) *:(?P<kind>.*)|(?P<alone>\w+)")
_MARKS = (
    (re.compile(r":math:`([^`]*)`"), r"\1"),
    (re.compile(r"``([^`]*)``"), r"\1"),
    (re.compile(r"`(?:~?[\w.]+\.)?(\w+)`"), r"\1"),
    (re.compile(r"\\,|\\;"), " "),
)


def meanings_of(kind: type | Callable[..., object]) -> dict[str, str]:
    """Return the text of every entry under Parameters of a class or function, in one line each.

    Parameters
    ----------
    kind : type or function
        Its docstring, and those of the classes that it derives from, are in numpydoc.
    """
    found: dict[str, str] = {}
    for owner in reversed(kind.__mro__) if isinstance(kind, type) else (kind,):
        found |= _entries(inspect.cleandoc(owner.__doc__ or ""))
    return found


def first_sentence(kind: type) -> str:
    """Return the first paragraph of a docstring, in one line."""
    return " ".join(inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())


def without_marks(text: str) -> str:
    """Return text without the marks of reStructuredText."""
    for mark, bare in _MARKS:
        text = mark.sub(bare, text)
    return text


def _entries(docstring: str) -> dict[str, str]:
    """Entries of the section Parameters: a line ``names : type`` and what is indented below it."""
    _, _, section = docstring.partition("Parameters\n----------\n")
    found: dict[str, str] = {}
    names: list[str] = []
    for line in section.splitlines():
        if line.startswith("---"):  # the heading of the next section was no entry
            for name in names:
                found.pop(name, None)
            break
        if line[:1].strip():
            entry = _ENTRY.fullmatch(line.strip())
            names = re.findall(r"\w+", (entry["names"] or entry["alone"]) if entry else "")
            found |= dict.fromkeys(names, "")
        else:
            for name in names:
                found[name] = f"{found[name]} {without_marks(line.strip())}".strip()
    return found
