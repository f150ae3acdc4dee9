"""What functions are known to be linear, so that it need not be found out again.

Of a model with many states to find that out takes seconds, and whoever makes the function from
matrices knows it.
"""

from collections import OrderedDict

import casadi as ca

from backsight.types import Array

Affine = tuple[Array, Array, Array]
"""Matrices of x and u, and constants, of an equation that is linear in both."""

_REMEMBERED: OrderedDict[tuple[int, bytes], tuple[ca.Function, Affine, Array | None]] = (
    OrderedDict()
)
"""By address and parameters. Functions are kept, since an address may be used again."""

MOST = 64
"""Functions that are remembered."""


def remember(function: ca.Function, theta: Array, known: Affine, by_p: Array | None = None) -> None:
    """Note what a function ``(x, u, p)`` is at these parameters.

    `by_p` is the matrix of the parameters, if the function is linear in all three together.
    """
    _REMEMBERED[function.__hash__(), theta.tobytes()] = function, known, by_p
    if len(_REMEMBERED) > MOST:
        _REMEMBERED.popitem(last=False)


def remembered(function: ca.Function, theta: Array) -> Affine | None:
    """What a function is known to be at these parameters, None if nothing is known."""
    found = _REMEMBERED.get((function.__hash__(), theta.tobytes()))
    return found[1] if found else None


def by_parameters(function: ca.Function, theta: Array) -> Array | None:
    """Matrix of the parameters of a function, None if nothing is known of it."""
    found = _REMEMBERED.get((function.__hash__(), theta.tobytes()))
    return found[2] if found else None
