"""Packages that import what they hand on when it is used first (PEP 562).

A command that needs one function of a package does not import them all, and not what these stand
on. The table of the names is the package's ``__init__.pyi``, which editors and type checkers read
as well.
"""

import importlib
import re
import sys
from collections.abc import Callable

_LINE = re.compile(r"^from (\S+) import \(?\s*(\w+) as \2\b", re.MULTILINE)


def homes(folder: str) -> dict[str, str]:
    """Name to module, from the ``from MODULE import NAME as NAME`` of a folder's table."""
    with open(f"{folder}/__init__.pyi", encoding="utf-8") as table:
        return {name: module for module, name in _LINE.findall(table.read())}


def found(package: str, name: str, known: dict[str, str]) -> object:
    """A name of a package, imported now and kept there; modules are names of the package itself.

    Raises
    ------
    AttributeError
        If it has no such name.
    """
    if name not in known:
        raise AttributeError(f"module '{package}' has no attribute '{name}'", name=name)
    if known[name] == package:
        value: object = importlib.import_module(f"{package}.{name}")
    else:
        value = getattr(importlib.import_module(known[name]), name)
    setattr(sys.modules[package], name, value)
    return value


def door(
    package: str, folder: str
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package that has a table."""
    known = homes(folder)

    def look_up(name: str) -> object:
        return found(package, name, known)

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *known})

    return look_up, names, sorted(known)
