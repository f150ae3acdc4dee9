"""The estimators and their settings, as a problem file gives them."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from backsight.data.reader import READERS
from backsight.description import words
from backsight.errors import PluginError
from backsight.estimators import ALL_ESTIMATORS
from backsight.kernels import library
from backsight.problem.reading.kinds import ALL_KINDS
from backsight.problem.reading.settings import dataclasses_in, fields_of, required

_TABLES = ("noise", "prior")
"""Fields that come from tables of their own."""


def methods(*, tell: Callable[[str], None] = lambda _: None) -> str:
    """List every kind of estimator with the defaults of its settings, as entries of TOML.

    After them, kinds of models and of recordings that installed extensions bring.

    Parameters
    ----------
    tell : callable
        Told, a sentence at a time, which extensions are broken or refused.
    """
    blocks = []
    for key in sorted(ALL_ESTIMATORS):
        try:
            kind = ALL_ESTIMATORS[key]
        except PluginError as error:
            tell(str(error))
            continue
        settings = [f for f in fields_of(kind) if f.name not in _TABLES]
        title = [f"# {kind.title}{_from(ALL_ESTIMATORS.maker(key))}"]
        if kind.kernels and (absent := library.missing()):
            title.append(f"# not available: {absent}")
        blocks.append("\n".join([*title, f'kind = "{key}"', *map(_line, settings)]))
    brought = [
        f'# [model] kind = "{key}"{_from(ALL_KINDS.maker(key))}'
        for key in ALL_KINDS
        if ALL_KINDS.maker(key)
    ]
    brought += [
        f'# [recording] path = "...{key}"{_from(READERS.maker(key))}'
        for key in READERS
        if READERS.maker(key)
    ]
    for sentence in refusals():
        tell(sentence)
    return "\n\n".join([*blocks, "\n".join(brought)] if brought else blocks)


def refusals() -> list[str]:
    """Sentences about what extensions bring under a name that is taken."""
    return [s for table in (ALL_ESTIMATORS, ALL_KINDS, READERS) for s in table.refusals()]


def _from(maker: str | None) -> str:
    return f" (from {maker})" if maker else ""


def _line(field: dataclasses.Field[Any]) -> str:
    if required(field):
        return f"{field.name} = ...  # must be given"
    if field.default_factory is not dataclasses.MISSING:
        return f"{field.name} = {_toml(field.default_factory())}"
    if field.default is None:
        example = "".join(
            _toml(part()) for part in dataclasses_in(field.type)[:1] if _complete(part)
        )
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
