"""The estimators and their settings, as a problem file gives them."""

import dataclasses
import textwrap
from collections.abc import Callable, Mapping
from typing import Any

from backsight.data.formats.loading import READERS
from backsight.description import first_sentence, meanings_of, without_marks, words
from backsight.errors import PluginError, ProblemError
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


def method(key: str) -> str:
    """Return what every setting of a kind of estimator means, with the words that it may be.

    Parameters
    ----------
    key : str
        A kind, such as ``ekf``, or the name of its class.

    Raises
    ------
    ProblemError
        If there is no such kind.
    """
    by_class = {ALL_ESTIMATORS[k].__name__.lower(): k for k in ALL_ESTIMATORS}
    found = by_class.get(key.lower(), key.lower())
    if found not in ALL_ESTIMATORS:
        raise ProblemError(f"there is no estimator '{key}', {ALL_ESTIMATORS.hint(key)}")
    kind = ALL_ESTIMATORS[found]
    meanings = meanings_of(kind)
    settings = [f for f in fields_of(kind) if f.name not in _TABLES]
    lines = [f"# {kind.title}: {without_marks(first_sentence(kind))}", f'kind = "{found}"']
    for field in settings:
        lines += ["", *_comment(meanings.get(field.name, "")), _line(field)]
    return "\n".join(lines)


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, 96, initial_indent="# ", subsequent_indent="# ")


def refusals() -> list[str]:
    """Sentences about what extensions bring under a name that is taken."""
    return [s for table in (ALL_ESTIMATORS, ALL_KINDS, READERS) for s in table.refusals()]


def _from(maker: str | None) -> str:
    return f" (from {maker})" if maker else ""


def _line(field: dataclasses.Field[Any]) -> str:
    if required(field):
        return f"{field.name} = ...  # must be given"
    if field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
        parts = dataclasses_in(field.type)
        if len(parts) < 2:
            return f"{field.name} = {_toml(value)}"
        given = {n: v for n, v in _fields(value).items() if v is not None}
        named = _toml({"kind": type(value).__name__, **given})
        others = ", ".join(part.__name__ for part in parts if not isinstance(value, part))
        return f"{field.name} = {named}  # or the kinds {others}"
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
        return _toml({name: entry for name, entry in _fields(value).items() if entry is not None})
    return str(value)


def _fields(value: Any) -> dict[str, object]:
    return {f.name: getattr(value, f.name) for f in fields_of(type(value))}
