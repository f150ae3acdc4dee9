"""What a window shows of itself, see `backsight.solve_window`."""

import dataclasses
from collections.abc import Callable

import casadi as ca

from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Inspection:
    """The whole window of a sample.

    Parameters
    ----------
    solve : casadi.Function
        ``(memory, u, y, mask) -> (present, x, P, w, v, multiplier, side, course)`` of the newest
        sample, see `backsight.estimators.mhe._inspect`.
    limits : tuple of str
        Names of its limits, the rows of ``multiplier`` and ``side``.
    filled : callable
        u (n, nu), y (n, ny) and mask (n, ny) of all samples but the newest one, physical, to the
        memory of a window that begins with the first of them. None of the windows before is
        solved: all that is taken from them is where to start.
    """

    solve: ca.Function
    limits: tuple[str, ...]
    filled: Callable[[Array, Array, Array], Array]
