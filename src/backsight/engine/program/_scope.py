"""Names that a loop program has given away."""

import copy
import dataclasses
import itertools
import re
from collections.abc import Hashable
from typing import Self

import casadi as ca

from backsight.engine.program.leaf import Leaf, Part, Repeated, entries_of, leaf_of, leaf_parts
from backsight.engine.program.program import Buffer, Slice, Table


class Scope:
    """Makes the buffers, leaves and counters of one program, each with a name of its own."""

    def __init__(self, recursion: str) -> None:
        self.recursion = recursion
        self._names: set[str] = set()
        self._constants: dict[tuple[float, ...], Slice] = {}
        self._tables: dict[tuple[int, ...], Table] = {}
        # The functions are kept, since the address of one that is gone may be used again.
        self._leaves: dict[int, tuple[ca.Function, Leaf]] = {}
        self._parts: dict[str, list[Part]] = {}
        self._entries: dict[str, tuple[list[Repeated], Leaf]] = {}
        self._calls: dict[Hashable, tuple[ca.Function, list[list[Slice]]]] = {}

    def inside(self) -> Self:
        """The scope within a loop: the same names, and calls that are known there only."""
        inner = copy.copy(self)
        inner._calls = dict(self._calls)
        return inner

    def keep(self, call: Hashable, function: ca.Function, results: list[list[Slice]]) -> None:
        """Keep the results of a call; values are never changed once they are written."""
        self._calls[call] = function, results

    def results(self, call: Hashable) -> list[list[Slice]] | None:
        """Results of a call that was made already, None of another one."""
        return self._calls[call][1] if call in self._calls else None

    def name(self, wish: str) -> str:
        """Return the name itself or, if it is taken, with the first free number."""
        base = re.sub(r"\W+", "_", wish)
        numbered = (f"{base}_{k}" for k in itertools.count(2))
        name = next(n for n in itertools.chain([base], numbered) if n not in self._names)
        self._names.add(name)
        return name

    def buffer(self, wish: str, size: int) -> Buffer:
        """Return a new buffer."""
        return Buffer(self.name(wish), size)

    def scratch(self, size: int) -> Slice:
        """Return a new buffer for a moment."""
        return self.buffer("saved", size).whole()

    def constant(self, values: tuple[float, ...]) -> Slice:
        """Return the buffer that holds the values."""
        if values not in self._constants:
            buffer = Buffer(self.name("constant"), len(values), values)
            self._constants[values] = buffer.whole()
        return self._constants[values]

    def table(self, wish: str, values: tuple[int, ...]) -> Table:
        """Return the table that holds the values."""
        if values not in self._tables:
            self._tables[values] = Table(self.name(wish), values)
        return self._tables[values]

    def leaf(self, function: ca.Function) -> Leaf:
        """Return the leaf of an SX function; of the same function always the same."""
        key = function.__hash__()
        if key not in self._leaves:
            leaf = leaf_of(function)
            self._leaves[key] = function, dataclasses.replace(leaf, name=self.name(leaf.name))
        return self._leaves[key][1]

    def entries(self, leaf: Leaf) -> tuple[list[Repeated], Leaf]:
        """Results of a leaf that loops make, and the leaf without them."""
        if leaf.name not in self._entries:
            found, left = entries_of(leaf)
            ones = [dataclasses.replace(e.leaf, name=self.name(e.leaf.name)) for e in found]
            named = [dataclasses.replace(e, leaf=one) for e, one in zip(found, ones, strict=True)]
            self._entries[leaf.name] = named, left
        return self._entries[leaf.name]

    def parts(self, leaf: Leaf) -> list[Part]:
        """Return the parts of a leaf, see `backsight.engine.program.leaf.leaf_parts`."""
        if leaf.name not in self._parts:
            parts = leaf_parts(leaf)
            self._parts[leaf.name] = (
                parts
                if len(parts) == 1
                else [
                    (dataclasses.replace(part, name=self.name(leaf.name)), places)
                    for part, places in parts
                ]
            )
        return self._parts[leaf.name]
