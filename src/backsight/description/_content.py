"""What descriptions say, as a key: to find again what was made of the same ones."""

import io
import pickle
import types
from collections.abc import Hashable
from typing import Any

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


class _Content(pickle.Pickler):
    def __init__(self, file: io.BytesIO, protocol: int) -> None:
        super().__init__(file, protocol)
        self.met: list[Hashable] = []

    def persistent_id(self, obj: Any) -> int | None:
        if not isinstance(obj, _BY_IDENTITY):
            return None
        if getattr(obj, "__closure__", None):
            raise pickle.PicklingError("what a closure holds cannot be told")
        self.met.append(obj)
        return len(self.met)
