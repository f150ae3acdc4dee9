"""How much a step of a program may cost at most: loops counted to their ends."""

import dataclasses
from collections import Counter
from collections.abc import Iterable

from backsight.engine.program.leaf import Leaf
from backsight.engine.program.program import (
    Call,
    Copy,
    Foreign,
    Loop,
    Program,
    Statement,
    While,
)
from backsight.kernels.effort import kernel_effort

NOTHING = {"input", "const"}
"""Kinds that are no operation."""

PLAIN = {
    "add": 1, "sub": 1, "mul": 1, "neg": 1, "fabs": 1, "fmin": 1, "fmax": 1, "copysign": 1,
    "lt": 1, "le": 1, "eq": 1, "ne": 1, "not": 1, "select": 1, "sign": 2, "and": 2, "or": 2,
}  # fmt: skip
"""Kinds that take about the time of an addition, with the comparisons that they are made of."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """Largest number of operations of one step.

    Parameters
    ----------
    plain : int
        Additions, multiplications, comparisons.
    divisions, roots : int
    functions : int
        Calls of other functions of ``<math.h>``.
    copies : int
        Numbers that are moved, but for those within kernels.
    uncounted : int
        Calls of kernels from elsewhere, of which nothing is known.
    """

    plain: int
    divisions: int
    roots: int
    functions: int
    copies: int
    uncounted: int = 0

    @property
    def arithmetic(self) -> int:
        """All operations on numbers."""
        return self.plain + self.divisions + self.roots + self.functions


def effort(program: Program) -> Effort:
    """Count what a step does if every search goes to its limit."""
    count = _block((*program.body, *program.update))
    return Effort(**{f.name: count[f.name] for f in dataclasses.fields(Effort)})


def _block(statements: Iterable[Statement]) -> Counter[str]:
    total: Counter[str] = Counter()
    for statement in statements:
        match statement:
            case Call(leaf=leaf):
                total += _leaf(leaf)
            case Foreign(kernel=kernel):
                known = kernel_effort(kernel.name, kernel.sizes)
                total += Counter({"uncounted": 1} if known is None else dataclasses.asdict(known))
            case Copy(source=source):
                total["copies"] += source.size
            case Loop(length=length, body=body):
                total += _times(_block(body), length)
            case While(limit=limit, body=body, update=update):
                total += _times(_block((*body, *update)), limit)
                total["plain"] += limit  # is there more to do?
    return total


def _times(count: Counter[str], passes: int) -> Counter[str]:
    return Counter({kind: passes * n for kind, n in count.items()})


def _leaf(leaf: Leaf) -> Counter[str]:
    count: Counter[str] = Counter()
    for operation in leaf.operations:
        kind = operation.kind
        if kind in PLAIN:
            count["plain"] += PLAIN[kind]
        elif kind not in NOTHING:
            count[{"div": "divisions", "sqrt": "roots"}.get(kind, "functions")] += 1
    # Results of a leaf are stored.
    count["copies"] += sum(len(output) for output in leaf.outputs)
    return count
