"""Counted loops inside a CasADi function.

`scan` and `iterate` wrap a loop body in a function whose *name* says what loop it is. CasADi's
virtual machine runs the wrapper as it stands; other back ends recognise the name (`loop_of`), take
the body out and write a real loop, so that nothing is ever unrolled. The name is used because it
is the only thing that survives pickling.
"""

import dataclasses
import itertools
import re
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from backsight.errors import EngineError


@dataclasses.dataclass(frozen=True)
class LoopFunction:
    """What a loop function stands for.

    Parameters
    ----------
    kind : {"scan", "back", "iterate"}
        ``back`` is a scan that takes the columns from the last to the first.
    length : int
        Number of passes, for ``iterate`` the largest number.
    n_carry, n_xs, n_constants : int
        Groups of inputs of the body, in this order.
    body : casadi.Function
        ``(carry, xs, constants) -> (carry, ys)``.
    """

    kind: str
    length: int
    n_carry: int
    n_xs: int
    n_constants: int
    body: ca.Function


DIRECT = 16
"""Passes that are written one after the other: building halves of few takes longer."""

_NAME = re.compile(r"(scan|back|iterate)_(\d+)_(\d+)_(\d+)_(\d+)_of_(\w+)")


def scan(
    body: ca.Function,
    length: int,
    *,
    carry: Sequence[ca.MX],
    xs: Sequence[ca.MX] = (),
    constants: Sequence[ca.MX] = (),
    backward: bool = False,
) -> tuple[list[ca.MX], list[ca.MX]]:
    """Run ``carry, y = body(carry, x_k, constants)`` for k = 0 ... length - 1.

    Parameters
    ----------
    body : casadi.Function
        ``(*carry, *xs, *constants) -> (*carry, *ys)``.
    length : int
        Number of passes.
    carry : sequence of MX
        Start values.
    xs : sequence of MX
        The inputs of all passes, side by side in the columns.
    constants : sequence of MX
        The same in every pass.
    backward : bool
        Go from k = length - 1 to 0; the results of pass k are still in the columns of pass k.

    Returns
    -------
    carry : list of MX
        After the last pass.
    ys : list of MX
        Outputs of all passes, side by side in the columns.
    """
    body = _with_name_of_its_own(body)
    inputs = [*carry, *xs, *constants]
    over = _Over(body, len(carry), len(xs), backward)
    kind = "back" if backward else "scan"
    name = f"{kind}_{length}_{len(carry)}_{len(xs)}_{len(constants)}_of_{body.name()}"
    outputs = over.all_of(length, name).call(inputs)
    return outputs[: len(carry)], outputs[len(carry) :]


class _Over:
    """A body over columns as a function: over one half of them, and then over the other.

    So many functions as the length has digits, in binary, do what as many calls as there are
    passes would need: that is what makes a function of many numbers and passes fast to build.
    """

    def __init__(self, body: ca.Function, n_carry: int, n_xs: int, backward: bool) -> None:
        self._body, self._n, self._m, self._backward = body, n_carry, n_carry + n_xs, backward
        self._known = {1: body}

    def all_of(self, length: int, name: str | None = None) -> ca.Function:
        """``(carry, stacks, constants) -> (carry, stacks of results)``."""
        if name is None and length in self._known:
            return self._known[length]
        body, n, m = self._body, self._n, self._m
        symbols = [
            ca.MX.sym(f"i{k}", rows, columns * (length if n <= k < m else 1))
            for k, (rows, columns) in enumerate(map(body.size_in, range(body.n_in())))
        ]
        half = length // 2
        sizes = [half, length - half] if length > DIRECT else [1] * length
        parts = [self._cut(stack, sizes) for stack in symbols[n:m]]
        carry, found = symbols[:n], []
        order = reversed(range(len(sizes))) if self._backward else range(len(sizes))
        for k in order:
            results = self.all_of(sizes[k]).call(
                [*carry, *(part[k] for part in parts), *symbols[m:]]
            )
            carry = results[:n]
            found.append(results[n:])
        joined = [ca.horzcat(*pieces) for pieces in zip(*found[:: self._step], strict=True)]
        made = ca.Function(name or f"{body.name()}_times_{length}", symbols, [*carry, *joined])
        if name is None:
            self._known[length] = made
        return made

    @property
    def _step(self) -> int:
        return -1 if self._backward else 1

    def _cut(self, stack: ca.MX, sizes: list[int]) -> list[ca.MX]:
        """A stack as pieces for so many passes each."""
        width = stack.shape[1] // sum(sizes)
        ends = [0, *(width * end for end in itertools.accumulate(sizes))]
        return ca.horzsplit(stack, ends)


def iterate(
    body: ca.Function, limit: int, *, carry: Sequence[ca.MX], constants: Sequence[ca.MX] = ()
) -> list[ca.MX]:
    """Run ``carry = body(carry, constants)`` while the first element of the carry is not zero.

    Parameters
    ----------
    body : casadi.Function
        ``(go, *carry, *constants) -> (go, *carry)``.
    limit : int
        Largest number of passes.
    carry, constants : sequence of MX
        As in `scan`; ``carry[0]`` is the scalar `go`.

    Returns
    -------
    list of MX
        The carry after the last pass.
    """
    body = _with_name_of_its_own(body)
    n_carry = len(carry)
    inputs = [*carry, *constants]
    symbols = [ca.MX.sym(f"i{k}", *i.shape) for k, i in enumerate(inputs)]
    skip = ca.Function(f"{body.name()}_skip", symbols, symbols[:n_carry])
    name = f"iterate_{limit}_{n_carry}_0_{len(constants)}_of_{body.name()}"
    final = _passes(body, skip, limit).call(symbols)
    return ca.Function(name, symbols, final).call(inputs)


def _passes(body: ca.Function, skip: ca.Function, limit: int) -> ca.Function:
    """So many passes at most; where there are none, nothing of a half of them is looked at."""
    powers = {1: _unless_done(body, skip)}

    def power(count: int) -> ca.Function:
        if count not in powers:
            half = count // 2
            symbols = [ca.MX.sym(f"i{k}", *body.size_in(k)) for k in range(body.n_in())]
            first = power(half).call(symbols)
            last = power(count - half).call([*first, *symbols[len(first) :]])
            made = ca.Function(f"{body.name()}_upto_{count}", symbols, last)
            powers[count] = _unless_done(made, skip)
        return powers[count]

    return power(limit)


def _unless_done(function: ca.Function, skip: ca.Function) -> ca.Function:
    """The function where its first argument is not zero."""
    guarded = ca.Function.if_else(f"{function.name()}_or_skip", function, skip)
    symbols = [ca.MX.sym(f"i{k}", *function.size_in(k)) for k in range(function.n_in())]
    return ca.Function(f"{function.name()}_guarded", symbols, guarded.call([symbols[0], *symbols]))


PIECE = 64
"""Numbers that `all_finite` and `smallest` look at in one pass."""


def all_finite(values: ca.MX) -> ca.MX:
    """1 if no number is infinite or none, else 0; in a loop, so that the code for many is short."""
    # NaN is not below infinity either.
    return ca.if_else(_over_pieces(values, 0.0, lambda s, v: s + ca.norm_1(v)) < np.inf, 1, 0)


def smallest(values: ca.MX) -> ca.MX:
    """The smallest number; in a loop, as `all_finite`."""
    return _over_pieces(values, np.inf, lambda s, v: ca.fmin(s, ca.mmin(v)))


def _over_pieces(values: ca.MX, start: float, step: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.MX:
    """Numbers taken together, piece by piece."""
    column = ca.vec(ca.densify(values))
    pieces, rest = divmod(values.numel(), PIECE)
    total, end = ca.MX(start), values.numel() - rest
    if pieces:
        stack = ca.reshape(column[:end], PIECE, pieces)
        total = scan(_piece(PIECE, step), pieces, carry=[total], xs=[stack])[0][0]
    return _piece(rest, step)(total, column[end:]) if rest else total


def _piece(n: int, step: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.Function:
    so_far, piece = ca.SX.sym("so_far"), ca.SX.sym("piece", n)
    return ca.Function("piece", [so_far, piece], [step(so_far, piece)])


def loop_of(function: ca.Function) -> LoopFunction | None:
    """What loop a function stands for, or None if it is an ordinary function."""
    match = _NAME.fullmatch(function.name())
    if match is None:
        return None
    kind, *sizes, name = match.groups()
    length, n_carry, n_xs, n_constants = map(int, sizes)
    bodies = [f for f in function.find_functions() if f.name() == name]
    if len(bodies) != 1 or bodies[0].n_in() != function.n_in():
        raise EngineError(
            f"'{function.name()}' has the name of a loop, but is none; give it another name"
        )
    return LoopFunction(kind, length, n_carry, n_xs, n_constants, bodies[0])


def _with_name_of_its_own(body: ca.Function) -> ca.Function:
    """Return the body under a name that no function inside it has: loops are found by names."""
    inside = {f.name() for f in body.find_functions()}
    if body.name() not in inside:
        return body
    numbered = (f"{body.name()}_{k}" for k in itertools.count(2))
    free = next(name for name in numbered if name not in inside)
    symbols = [ca.MX.sym(body.name_in(i), body.sparsity_in(i)) for i in range(body.n_in())]
    return ca.Function(free, symbols, body.call(symbols, True, False))
