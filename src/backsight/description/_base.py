"""The base of all descriptions: checked when it is built, printed as a tree."""

import dataclasses
import functools
import typing
from collections.abc import Callable, Iterable
from typing import Annotated, Any, ClassVar, TypeAlias

from backsight.description._fits import fault
from backsight.description._html import page_of
from backsight.description._says import plain
from backsight.description._tree import Printed
from backsight.errors import BacksightError, TuningError

Sound: TypeAlias = Callable[..., bool]
"""Whether the fields of these names are what their annotations say: ``sound("N", "every")``."""


class Description(Printed):
    """Base of frozen dataclasses that a user writes down; checks every field when it is built.

    The annotations say what the fields may be, see `backsight.description`; what several fields
    must have in common is said by `conflicts`. A list where a tuple is meant is kept as a tuple.

    Raises
    ------
    TuningError
        (or `refusal`) with all that is wrong, each with field, value and what is allowed.
    """

    refusal: ClassVar[type[BacksightError]] = TuningError
    called: ClassVar[str] = ""
    """What messages call it; the name of the class if not given."""

    def __post_init__(self) -> None:
        wrong = {}
        for name, hint in _hints(type(self)).items():
            value = getattr(self, name)
            if message := fault(hint, value, name):
                wrong[name] = message
            elif (kept := _kept(hint, value)) is not value:
                object.__setattr__(self, name, kept)
        found = self.conflicts(lambda *names: wrong.keys().isdisjoint(names))
        if problems := [*wrong.values(), *found]:
            of = self.called or type(self).__name__
            raise self.refusal.about(of, "; ".join(problems))

    def conflicts(self, sound: Sound) -> Iterable[str]:
        """Say what is wrong beyond the single fields; `sound` tells which may be relied on."""
        del sound
        return ()

    def _repr_html_(self) -> str:
        return page_of(type(self), str(self))


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    fields: Any = kind
    hints = typing.get_type_hints(kind, include_extras=True)
    return {f.name: hints[f.name] for f in dataclasses.fields(fields) if f.init}


def _kept(hint: Any, value: object) -> object:
    """Lists become tuples, and their entries plain numbers."""
    if typing.get_origin(hint) is Annotated:
        return _kept(plain(hint), value)
    if typing.get_origin(hint) is not tuple or not isinstance(value, list | tuple):
        return value
    kind = plain(typing.get_args(hint)[0])
    entries = (kind(v) if kind in (int, float, complex) else v for v in value)
    return tuple(entries)
