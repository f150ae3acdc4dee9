"""The estimators and their settings, as a problem file gives them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from backsight.description import words
from backsight.estimators import ESTIMATORS
from backsight.problem._settings import fields_of, parts_of, required

_TABLES = ("noise", "prior")
"""Fields that come from tables of their own."""


def methods() -> str:
    """List every kind of estimator with the defaults of its settings, as entries of TOML."""
    blocks = []
    for key, kind in sorted(ESTIMATORS.items()):
        settings = [f for f in fields_of(kind) if f.name not in _TABLES]
        lines = [f"# {kind.title}", f'kind = "{key}"', *map(_line, settings)]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def _line(field: dataclasses.Field[Any]) -> str:
    if required(field):
        return f"{field.name} = ...  # must be given"
    if field.default_factory is not dataclasses.MISSING:
        return f"{field.name} = {_toml(field.default_factory())}"
    if field.default is None:
        example = "".join(_toml(part()) for part in parts_of(field.type)[:1] if _complete(part))
        return f"# {field.name} = {example or '...'}  # not used if not given"
    others = [f'"{word}"' for word in words(field.type) if word != field.default]
    also = f"  # or {', '.join(others)}" if others else ""
    return f"{field.name} = {_toml(field.default)}{also}"


def _complete(part: type) -> bool:
    return not any(required(f) for f in fields_of(part))


def _toml(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str() | complex():
            return f'"{value}"'
        case tuple():
            return f"[{', '.join(map(_toml, value))}]"
        case Mapping():
            return f"{{ {', '.join(f'{k} = {_toml(v)}' for k, v in value.items())} }}"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: getattr(value, f.name) for f in fields_of(value)}
        return _toml({name: entry for name, entry in fields.items() if entry is not None})
    return str(value)
