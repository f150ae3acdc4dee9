"""Whether two descriptions say the same, arrays in them too, which `==` cannot compare."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np


def alike(a: object, b: object) -> bool:
    """Whether two descriptions, or values of their fields, are the same."""
    if dataclasses.is_dataclass(a) and not isinstance(a, type):
        fields = (f.name for f in dataclasses.fields(a))
        return type(a) is type(b) and all(alike(getattr(a, n), getattr(b, n)) for n in fields)
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return type(a) is type(b) and np.array_equal(a, b)  # type: ignore[arg-type]
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(alike(a[k], b[k]) for k in a)
    if isinstance(a, Sequence) and isinstance(b, Sequence) and not isinstance(a, str):
        return len(a) == len(b) and all(alike(x, y) for x, y in zip(a, b, strict=True))
    return bool(a == b)
