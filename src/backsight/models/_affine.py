"""What functions are known to be linear, so that it need not be found out again.

Of a model with many states to find that out takes seconds, and whoever makes the function from
matrices knows it.
"""

from collections import OrderedDict

import casadi as ca

from backsight.types import Array

Affine = tuple[Array, Array, Array]
"""Matrices of x and u, and constants, of an equation that is linear in both."""

_REMEMBERED: OrderedDict[int, tuple[ca.Function, Affine]] = OrderedDict()
"""By address. The functions are kept, since an address may be used again."""

MOST = 32
"""Functions that are remembered."""


def remember(function: ca.Function, known: Affine) -> None:
    """Note what a function ``(x, u, p)`` without parameters is."""
    _REMEMBERED[function.__hash__()] = function, known
    if len(_REMEMBERED) > MOST:
        _REMEMBERED.popitem(last=False)


def remembered(function: ca.Function) -> Affine | None:
    """What a function is known to be, None if nothing is known."""
    found = _REMEMBERED.get(function.__hash__())
    return found[1] if found else None
