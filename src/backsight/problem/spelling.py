"""How names and values are written in TOML."""

import json
import re
from collections.abc import Mapping

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def as_table(entries: Mapping[str, str | float]) -> str:
    """A table on one line: ``{ name = value }``."""
    listed = (f"{as_key(name)} = {as_value(value)}" for name, value in entries.items())
    return f"{{ {', '.join(listed)} }}"


def as_key(name: str) -> str:
    """A name, in quotes where it needs them."""
    return name if _BARE.fullmatch(name) else in_quotes(name)


def as_value(value: str | float) -> str:
    """A text or a number."""
    return in_quotes(value) if isinstance(value, str) else repr(value)


def in_quotes(text: str) -> str:
    """A string of TOML, whose escapes are those of JSON."""
    return json.dumps(text, ensure_ascii=False)
