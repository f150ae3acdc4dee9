"""Whether a value is what an annotation says, and what to say if it is not."""

import collections.abc
import dataclasses
import functools
import numbers
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from backsight.description._ranges import FINITE, Called, Distinct, Range
from backsight.description._says import NUMBERS, described, either, is_union, many, plain, shown
from backsight.errors import nearest


@dataclasses.dataclass(frozen=True)
class Fault:
    """Why a value does not fit.

    Parameters
    ----------
    say : callable
        Gives the text. Of a union most options do not fit, and nobody asks why.
    kind : bool
        The value is of another kind altogether, so that another option may be meant.
    """

    say: Callable[[], str]
    kind: bool = False


def fault(hint: Any, value: object, name: str) -> str | None:
    """Say what is wrong with a value, None if it is what the annotation says.

    Parameters
    ----------
    hint : annotation
        As `typing.get_type_hints` gives it with ``include_extras=True``.
    value : object
    name : str
        Of the field or argument, for the message.
    """
    if type(value) in PLAIN and _sound(hint, value):
        return None
    found = _fault(hint, value, Called(name), None)
    return found.say() if found else None


PLAIN = (types.NoneType, bool, int, float, str)
"""Kinds of values whose answers are kept: a model of hundreds of states has thousands of fields."""


@functools.lru_cache(maxsize=4096, typed=True)
def _sound(hint: Any, value: object) -> bool:
    """Whether a value fits."""
    return _fault(hint, value, Called(""), None) is None


def _fault(hint: Any, value: object, called: Called, within: Range | None) -> Fault | None:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return _annotated(args, value, called, within)
    if hint == ArrayLike:
        # Without a range it is data, whose readers say which sample is wrong.
        return _array(value, called, within) if within else _complex(value, called)
    if is_union(hint):
        return _union(args, value, called, within)
    if origin is Literal:
        return _word(args, value, called)
    if hint in NUMBERS:
        return _number(hint, value, called, within)
    if hint is bool:
        return None if isinstance(value, bool | np.bool_) else _other(hint, value, called, within)
    if origin is np.ndarray:
        return _array(value, called, within)
    if origin is tuple:
        return _tuple(args, value, called, within)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(hint, value, called, within)
    if isinstance(origin, type) and issubclass(origin, Sequence):
        if isinstance(value, Sequence) and not isinstance(value, str):
            return _entries(args[0], value, called, within)
        return _other(hint, value, called, within)
    if origin is collections.abc.Callable:
        return None if callable(value) else _other(hint, value, called, within)
    kind = types.NoneType if hint is None else origin or hint
    if not isinstance(kind, type) or kind is object or isinstance(value, kind):
        return None
    return _other(hint, value, called, within)


def _other(hint: Any, value: object, called: Called, within: Range | None) -> Fault:
    """The value is of another kind than the annotation."""
    return Fault(
        lambda: f"{called.name} is {shown(value)}; it must be {described(hint, within)}", True
    )


def _annotated(
    args: tuple[Any, ...], value: object, called: Called, within: Range | None
) -> Fault | None:
    hint, *extras = args
    for extra in extras:
        if isinstance(extra, Range):
            within = extra
        if isinstance(extra, Called):
            called = extra
    found = _fault(hint, value, called, within)
    if found is None and any(isinstance(e, Distinct) for e in extras):
        twice = [v for i, v in enumerate(value) if v in value[:i]]  # type: ignore[arg-type, index]
        return Fault(lambda: f"{called.name}: '{twice[0]}' is named twice") if twice else None
    return found


def _union(
    options: Sequence[Any], value: object, called: Called, within: Range | None
) -> Fault | None:
    faults = []
    for option in options:
        found = _fault(option, value, called, within)
        if found is None:
            return None
        faults.append(found)
    # The value is wrong within its kind: that is what to tell.
    near = [f for f in faults if not f.kind]
    if near:
        return near[0]
    wanted = [o for o in options if o is not types.NoneType]
    one = wanted[0] if len(wanted) == 1 else typing.Union[tuple(wanted)]  # noqa: UP007
    return _other(one, value, called, within)


def _word(known: Sequence[Any], value: object, called: Called) -> Fault | None:
    if not isinstance(value, str):
        return Fault(
            lambda: f"{called.name} is {shown(value)}; it must be {either(map(repr, known))}", True
        )
    return None if value in known else Fault(lambda: _unknown(value, known, called))


def _unknown(value: str, known: Sequence[Any], called: Called) -> str:
    hint = nearest(value, known)
    allowed = "" if hint.startswith("known") else f" It must be {either(map(repr, known))}"
    return f"unknown {called.name.removeprefix('the ')} '{value}': {hint}{allowed}"


def _number(hint: Any, value: object, called: Called, within: Range | None) -> Fault | None:
    kind, _ = NUMBERS[hint]
    wrong_kind = isinstance(value, bool | np.bool_) or not isinstance(value, kind)
    if hint is int and wrong_kind and isinstance(value, float | np.floating) and within:
        # Half a sample is a wrong number rather than another kind of thing.
        return _outside(value, called, within)
    if wrong_kind:
        return _other(hint, value, called, within)
    if hint is complex:
        return None if np.isfinite(value) else _outside(value, called, FINITE)  # type: ignore
    allowed = within or FINITE
    return None if value in allowed else _outside(value, called, allowed)  # type: ignore[operator]


def _outside(value: object, called: Called, within: Range) -> Fault:
    unit = f" {called.unit}" if called.unit else ""
    must = within.must if isinstance(value, complex) else within.wanted(float(value))  # type: ignore[arg-type]
    return Fault(lambda: f"{called.name} is {shown(value)}{unit}; it must {must}")


def _complex(value: object, called: Called) -> Fault | None:
    """NumPy makes real numbers of complex ones by leaving off a half, and hardly says so."""
    if getattr(getattr(value, "dtype", None), "kind", "") != "c":
        return None
    return Fault(lambda: f"{called.name} holds complex numbers; it must be real ones")


def _array(value: object, called: Called, within: Range | None) -> Fault | None:
    name = called.name
    try:
        numbers_of = np.asarray(value)
    except ValueError:  # rows of different lengths
        numbers_of = np.asarray(None)
    if numbers_of.dtype.kind not in "fiu":
        return Fault(lambda: f"{name} is {shown(value)}; it must be an array of numbers", True)
    allowed = within or FINITE
    bad = [v for v in numbers_of.ravel() if v not in allowed]
    if not bad:
        return None
    if numbers_of.ndim == 0:
        return _outside(float(numbers_of), called, allowed)
    if allowed is FINITE:
        return Fault(lambda: f"{name} has an entry that is not finite")
    return Fault(lambda: f"{name} must {allowed.wanted(bad[0])}, but an entry is {bad[0]:g}")


def _tuple(
    args: tuple[Any, ...], value: object, called: Called, within: Range | None
) -> Fault | None:
    entries = args[:1] if args[-1:] == (Ellipsis,) else args
    if not isinstance(value, tuple | list):
        return Fault(
            lambda: f"{called.name} is {shown(value)}; it must be a tuple of {many(entries)}", True
        )
    if args[-1:] == (Ellipsis,):
        return _entries(args[0], value, called, within)
    if len(value) != len(args):
        count = {1: "one", 2: "two", 3: "three"}.get(len(args), str(len(args)))
        return Fault(lambda: f"{called.name} is {shown(value)}; give {count} entries")
    for i, (hint, entry) in enumerate(zip(args, value, strict=True)):
        found = _fault(hint, entry, Called(f"{called.name}[{i}]"), within)
        if found:
            return Fault(found.say)
    return None


def _entries(hint: Any, value: Sequence[Any], called: Called, within: Range | None) -> Fault | None:
    for i, entry in enumerate(value):
        found = _fault(hint, entry, Called(f"{called.name}[{i}]"), within)
        if found:
            return Fault(found.say)
    return None


def _mapping(hint: Any, value: object, called: Called, within: Range | None) -> Fault | None:
    if not isinstance(value, Mapping):
        return _other(hint, value, called, within)
    names, entries = typing.get_args(hint)
    outside = []
    for key, entry in value.items():
        found = _fault(names, key, Called(f"a name in {called.name}"), None)
        if found:
            return Fault(found.say)
        wanted = next((e for e in typing.get_args(entries)[1:] if isinstance(e, Called)), called)
        found = _fault(
            plain(entries), entry, Called(f"{wanted.name} of '{key}'"), _range(entries, within)
        )
        if found and within and isinstance(entry, numbers.Real) and not isinstance(entry, bool):
            outside.append(f"{key} ({float(entry):g})")
        elif found:
            return Fault(found.say)
    if outside and within:
        return Fault(lambda: f"{called.name} must {within.whole} for {', '.join(outside)}")
    return None


def _range(hint: Any, within: Range | None) -> Range | None:
    return next((e for e in typing.get_args(hint)[1:] if isinstance(e, Range)), within)
