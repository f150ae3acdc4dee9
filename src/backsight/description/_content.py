"""What descriptions say, as a key: to find again what was made of the same ones."""

import collections
import dataclasses
import functools
import hashlib
import io
import pickle
import threading
import types
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np

_PLAIN = (bool, int, float, complex, str, bytes, np.generic)
_BY_IDENTITY = (type, types.FunctionType, types.BuiltinFunctionType, types.ModuleType)


def content(*values: object) -> Hashable | None:
    """Key of what these descriptions, models and numbers say; None if that cannot be told.

    Arrays count by their numbers, also after they were changed in place; classes and functions by
    which they are, so that a class that was defined anew is another one.
    """
    file = io.BytesIO()
    pickler = _Content(file, protocol=5)
    try:
        pickler.dump(values)
    except Exception:  # whatever a class of somebody else raises when it is pickled
        return None
    return file.getvalue(), tuple(pickler.met)


T = TypeVar("T")


class Kept(Generic[T]):
    """What was made of descriptions, to be found again by what they say.

    Parameters
    ----------
    most : int
        Number of things that are kept; the one not used for the longest time goes first.
    """

    def __init__(self, most: int) -> None:
        self._most, self._lock = most, threading.Lock()
        self._made: collections.OrderedDict[Hashable, T] = collections.OrderedDict()

    def of(self, key: Hashable | None, make: Callable[[], T]) -> T:
        """What was made before of the same `content`; without a key it is made each time."""
        if key is None:
            return make()
        with self._lock:
            if key in self._made:
                self._made.move_to_end(key)
                return self._made[key]
        made = make()  # without the lock: it takes long, and made twice does no harm
        with self._lock:
            self._made[key] = made
            while len(self._made) > self._most:
                self._made.popitem(last=False)
        return made


class _Content(pickle.Pickler):
    def __init__(self, file: io.BytesIO, protocol: int) -> None:
        super().__init__(file, protocol)
        self.met: list[Hashable] = []

    def reducer_override(self, obj: Any) -> Any:
        """Put a number in the place of what is not told by its parts, and keep it aside."""
        if type(obj).__name__ == "Function" and hasattr(obj, "serialize"):  # of CasADi
            return self._kept_aside(_serialised(obj))
        if not isinstance(obj, _BY_IDENTITY) or obj is _place:
            return NotImplemented
        if getattr(obj, "__closure__", None):
            raise pickle.PicklingError("what a closure holds cannot be told")
        return self._kept_aside(obj)

    def _kept_aside(self, what: Hashable) -> tuple[Any, tuple[int]]:
        self.met.append(what)
        return _place, (len(self.met),)


def _place(number: int) -> int:
    """Stands for what was kept aside."""
    return number


@functools.lru_cache(maxsize=256)
def _serialised(function: Any) -> str:
    """Text of a function, which never changes; it takes long to write."""
    return function.serialize()


def digest(*values: object) -> str:
    """Digest of what descriptions, models and numbers say, the same in every process.

    Classes count by their names.

    Raises
    ------
    TypeError
        If a value is none of those that descriptions are made of.
    """
    made = hashlib.sha256()
    for token in _tokens(values):
        # With its length, so that no two sequences of tokens are the same bytes.
        made.update(f"{len(token)} ".encode() + token)
    return made.hexdigest()


def _tokens(value: Any) -> Iterator[bytes]:
    kind: type = type(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield f"{kind.__module__}.{kind.__qualname__}".encode()
        for field in dataclasses.fields(value):
            yield field.name.encode()
            yield from _tokens(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, entry in value.items():
            yield from _tokens(key)
            yield from _tokens(entry)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Sequence | set | frozenset) and not isinstance(value, str | bytes):
        entries = sorted(value, key=repr) if isinstance(value, set | frozenset) else value
        yield f"sequence {len(entries)}".encode()
        for entry in entries:
            yield from _tokens(entry)
    elif value is None or isinstance(
        value, bool | int | float | complex | str | bytes | np.generic
    ):
        plain = value.item() if isinstance(value, np.generic) else value
        yield repr(plain).encode()
    elif hasattr(value, "serialize") and not isinstance(value, type):  # a function of CasADi
        yield value.serialize().encode()
    else:
        raise TypeError(f"no digest of {kind.__module__}.{kind.__qualname__}")
