"""A program whose constants follow settings, so that these may be changed where it runs.

A number of a description (a weight, a bound, a standard deviation) goes into a program as
constants. Three programs of other numbers show which constants these are and how they follow
(`Rules`); in the result they are computed from inputs at the beginning of a step. So no method
needs to know which of its numbers are changed, and what does not follow simply, a gain that solves
a Riccati equation, is refused.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import casadi as ca

from backsight.engine.program.following._rules import Rule, Rules
from backsight.engine.program.leaf import Leaf, Operation, leaf_of
from backsight.engine.program.program import (
    Buffer,
    Call,
    Copy,
    Foreign,
    Loop,
    Program,
    Slice,
    Statement,
    While,
)
from backsight.errors import EngineError
from backsight.types import Array

Place = tuple[str, str, int]
"""Where a constant is: in a "leaf" or "buffer", its name, and which number of it."""

FOLLOWS = "follows_settings"
"""Name of the buffer of what follows, and of the leaf that computes it."""

BEGINS = "memory_before"
"""Name of the leaf that computes what of the memory follows."""


@dataclasses.dataclass(frozen=True)
class Beginning:
    """How the memory before the first sample follows settings.

    Parameters
    ----------
    leaf : Leaf
        From the settings to the numbers that follow.
    places : tuple of int
        Where these are in the memory.
    """

    leaf: Leaf
    places: tuple[int, ...]


def following(
    programs: Sequence[Program], settings: Array, fields: Mapping[str, int], *, what: str
) -> Program:
    """Return the program with settings as inputs, before the others.

    Parameters
    ----------
    programs : sequence of Program
        The program at three choices of the settings.
    settings : (3, n) array
        These choices, no number of them zero or simple.
    fields : dict
        Names of the inputs and their sizes, n numbers in all.
    what : str
        The settings, for messages.

    Raises
    ------
    EngineError
        If the programs differ in more than constants, or a constant does not follow.
    """
    found = [dict(_constants(p)) for p in programs]
    if any(_blank(p) != _blank(programs[0]) for p in programs[1:]):
        raise EngineError(f"{what} cannot be made changeable: other steps would be taken")
    rules, known = Rules(settings), dict[tuple[float, ...], Rule]()
    moving: dict[Place, Rule] = {}
    for place, first in found[0].items():
        values = first, *(other[place] for other in found[1:])
        if _same(values):
            continue
        if values not in known:
            rule = rules.rule(values)
            if rule is None:
                raise EngineError(
                    f"{what} cannot be made changeable: a constant of '{place[1]}' is computed "
                    "from it in a way that is not a product of powers, such as a gain or a matrix "
                    "exponential"
                )
            known[values] = rule
        moving[place] = known[values]
    return _opened(programs[0], fields, moving)


def starting(
    memories: Sequence[Array], settings: Array, fields: Mapping[str, int], *, what: str
) -> Beginning | None:
    """How the memory before the first sample follows settings; None if it does not.

    Parameters
    ----------
    memories : sequence of (m,) array
        At three choices of the settings.
    settings, fields, what
        As in `following`.

    Raises
    ------
    EngineError
        If a number does not follow.
    """
    rules, moving = Rules(settings), dict[int, Rule]()
    for place, values in enumerate(zip(*memories, strict=True)):
        if _same(values):
            continue
        rule = rules.rule(values)
        if rule is None:
            raise EngineError(
                f"{what} cannot be made changeable: the memory before the first sample is computed "
                "from it in a way that is not a product of powers"
            )
        moving[place] = rule
    if not moving:
        return None
    return Beginning(_leaf(BEGINS, fields, [*moving.values()]), tuple(moving))


def _same(values: Sequence[float]) -> bool:
    return all(v == values[0] or (v != v and values[0] != values[0]) for v in values)


def _constants(program: Program) -> Iterator[tuple[Place, float]]:
    for leaf in program.leaves:
        for k, operation in enumerate(leaf.operations):
            if operation.kind == "const":
                yield ("leaf", leaf.name, k), operation.value
    for buffer in program.buffers:
        for k, value in enumerate(buffer.values or ()):
            yield ("buffer", buffer.name, k), value


@dataclasses.dataclass(frozen=True)
class _Rewriting:
    """Other leaves and buffers by the names of those that they replace.

    Parameters
    ----------
    leaves, buffers : dict
    follows : Slice, optional
        Further argument of the leaves.
    """

    leaves: Mapping[str, Leaf]
    buffers: Mapping[str, Buffer]
    follows: Slice | None = None

    def statements(self, statements: Sequence[Statement]) -> tuple[Statement, ...]:
        return tuple(self._statement(s) for s in statements)

    def _statement(self, statement: Statement) -> Statement:
        match statement:
            case Call(leaf, inputs, outputs):
                other = self.leaves.get(leaf.name, leaf)
                added = (self.follows,) if self.follows and other is not leaf else ()
                return Call(other, (*self._all(inputs), *added), self._all(outputs))
            case Foreign(inputs=inputs, outputs=outputs):
                return dataclasses.replace(
                    statement, inputs=self._all(inputs), outputs=self._all(outputs)
                )
            case Copy():
                return self.copy(statement)
            case Loop(body=body):
                return dataclasses.replace(statement, body=self.statements(body))
            case While(flag=flag, body=body, update=update):
                return dataclasses.replace(
                    statement,
                    flag=self._slice(flag),
                    body=self.statements(body),
                    update=tuple(self.copy(c) for c in update),
                )

    def copy(self, copy: Copy) -> Copy:
        return Copy(self._slice(copy.source), self._slice(copy.target))

    def _all(self, slices: Sequence[Slice]) -> tuple[Slice, ...]:
        return tuple(self._slice(s) for s in slices)

    def _slice(self, place: Slice) -> Slice:
        other = self.buffers.get(place.buffer.name)
        return place if other is None else dataclasses.replace(place, buffer=other)

    def program(self, program: Program) -> Program:
        return dataclasses.replace(
            program,
            body=self.statements(program.body),
            update=tuple(self.copy(c) for c in program.update),
        )


def _blank(program: Program) -> Program:
    """The program with zeros for its constants."""

    def without(leaf: Leaf) -> Leaf:
        kept = (Operation("const") if o.kind == "const" else o for o in leaf.operations)
        return dataclasses.replace(leaf, operations=tuple(kept))

    return _Rewriting(
        {leaf.name: without(leaf) for leaf in program.leaves},
        {
            b.name: dataclasses.replace(b, values=(0.0,) * b.size)
            for b in program.buffers
            if b.values is not None
        },
    ).program(program)


def _opened(program: Program, fields: Mapping[str, int], moving: Mapping[Place, Rule]) -> Program:
    """The program in which these constants are computed first."""
    inputs = tuple(Buffer(name, size) for name, size in fields.items())
    rules = list(dict.fromkeys(moving.values()))
    at = {rule: k for k, rule in enumerate(rules)}
    follows = Buffer(FOLLOWS, len(rules)).whole()
    before: list[Statement] = []
    if rules:
        compute = _leaf(FOLLOWS, fields, rules)
        before.append(Call(compute, tuple(b.whole() for b in inputs), (follows,)))

    def moving_of(kind: str, name: str) -> dict[int, int]:
        return {place[2]: at[rule] for place, rule in moving.items() if place[:2] == (kind, name)}

    leaves, buffers = {}, {}
    for leaf in program.leaves:
        if own := moving_of("leaf", leaf.name):
            leaves[leaf.name] = _reading(leaf, own, len(rules))
    for buffer in program.buffers:
        if buffer.name in fields:
            buffers[buffer.name] = dataclasses.replace(buffer, name=f"{buffer.name}_of_step")
        if own := moving_of("buffer", buffer.name):
            buffers[buffer.name] = other = Buffer(f"{buffer.name}_now", buffer.size)
            before.append(Call(_filling(buffer, own, len(rules)), (follows,), (other.whole(),)))
    changed = _Rewriting(leaves, buffers, follows).program(program)
    return dataclasses.replace(
        changed, inputs=(*inputs, *program.inputs), body=(*before, *changed.body)
    )


def _leaf(name: str, fields: Mapping[str, int], rules: Sequence[Rule]) -> Leaf:
    """Numbers by their rules, from the fields."""
    symbols = [ca.SX.sym(field, size) for field, size in fields.items()]
    settings = ca.vertcat(*symbols)
    numbers = ca.vertcat(*(rule.at(settings) for rule in rules))
    return leaf_of(ca.Function(name, symbols, [numbers], list(fields), ["numbers"]))


def _reading(leaf: Leaf, own: Mapping[int, int], size: int) -> Leaf:
    """The leaf with one more argument, from which it takes constants."""
    argument = len(leaf.inputs)
    operations = tuple(
        Operation("input", (argument, own[k])) if k in own else o
        for k, o in enumerate(leaf.operations)
    )
    names = (*leaf.names[:argument], FOLLOWS, *leaf.names[argument:])
    return dataclasses.replace(
        leaf, inputs=(*leaf.inputs, size), operations=operations, names=names
    )


def _filling(buffer: Buffer, own: Mapping[int, int], size: int) -> Leaf:
    """A leaf that fills what was a buffer of constants."""
    follows, values = ca.SX.sym(FOLLOWS, size), ca.SX(ca.DM(buffer.values or ()))
    for k, number in own.items():
        values[k] = follows[number]
    return leaf_of(ca.Function(f"fill_{buffer.name}", [follows], [values], [FOLLOWS], ["numbers"]))
