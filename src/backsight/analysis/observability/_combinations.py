"""Directions of the state space in words."""

from collections.abc import Sequence

import numpy as np

from backsight.models.signals import Signal
from backsight.types import Array

NEGLIGIBLE = 1e-6
"""Entries below this share of the largest are rounding errors."""


def combinations(basis: Array, states: Sequence[Signal], size: Array) -> tuple[str, ...]:
    """Name the directions that span a subspace, with as few states in each as possible.

    Parameters
    ----------
    basis : (nx, d) array
        Each entry divided by the size of its state.
    states : sequence of Signal
    size : (nx,) array
        Typical sizes of the states.
    """
    rows = basis.T.copy()
    free = list(range(rows.shape[1]))
    for i in range(len(rows)):
        # The largest remaining entry becomes a one, the others of its column zeros.
        left = np.abs(rows[i:, free])
        row, column = divmod(int(left.argmax()), len(free))
        pivot = free.pop(column)
        rows[[i, i + row]] = rows[[i + row, i]]
        rows[i] /= rows[i, pivot]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, pivot], rows[i])
    order = sorted(rows, key=lambda row: int(np.argmax(np.abs(row) > NEGLIGIBLE)))
    return tuple(direction_in_words(row, states, size) for row in order)


def direction_in_words(direction: Array, states: Sequence[Signal], size: Array) -> str:
    """Name a direction in physical units: ``q``, or ``q1 and q2 in the ratio 1 : -2``.

    Parameters as those of `combinations`, with one direction (nx,).
    """
    relative = np.abs(direction)
    kept = [int(i) for i in np.flatnonzero(relative > NEGLIGIBLE * relative.max())]
    names = [states[i].name for i in kept]
    if len(names) == 1:
        return names[0]
    values = direction[kept] * size[kept]
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} in the ratio {' : '.join(f'{v:.4g}' for v in values / values[0])}"
