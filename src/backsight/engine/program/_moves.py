"""Copies that are meant to happen all at once, in an order that does so."""

import dataclasses
from collections.abc import Callable, Iterable

from backsight.engine.program.program import Copy, Slice


def in_order(copies: Iterable[Copy], scratch: Callable[[int], Slice]) -> list[Copy]:
    """Order simultaneous copies so that none overwrites what is still to be read.

    No copy then moves numbers up within the memory that it reads, so that each may be written as
    a loop that counts up.

    Parameters
    ----------
    copies : iterable of Copy
        Their targets do not overlap.
    scratch : callable
        Makes a slice of a new buffer, for copies that wait for each other in a circle.
    """
    waiting = [c for c in copies if c.source != c.target and c.source.size]
    ordered: list[Copy] = []
    while waiting:
        free = [c for c in waiting if not _is_read(c.target, waiting, c)]
        first = (free or waiting)[0]
        if free and not _moves_up(first):
            ordered.append(first)
            waiting.remove(first)
        else:
            saved = scratch(first.source.size)
            ordered.append(Copy(first.source, saved))
            waiting[waiting.index(first)] = dataclasses.replace(first, source=saved)
    return ordered


def _moves_up(copy: Copy) -> bool:
    return copy.source.overlaps(copy.target) and copy.target.offset > copy.source.offset


def _is_read(target: Slice, copies: list[Copy], itself: Copy) -> bool:
    return any(c is not itself and c.source.overlaps(target) for c in copies)
