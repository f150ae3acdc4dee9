"""Rewriting of loop programs, against a plain interpreter."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backsight.engine.foreign import Kernel
from backsight.engine.loops import iterate, scan
from backsight.engine.program import Buffer, Call, Copy, Foreign, Loop, Program, flat, walk
from backsight.engine.program._coalesce import without_copies
from backsight.engine.program._moves import in_order
from backsight.engine.program.leaf import leaf_of
from backsight.errors import EngineError
from engine.examples import location
from engine.interpreter import run

X, Y = ca.SX.sym("x", 4), ca.SX.sym("y", 4)
MIX = leaf_of(ca.Function("mix", [X, Y], [X + Y[::-1], X * Y]))
TURN = Kernel("matrix_turn", (2, 2, 0))
CARRY, OUT = Buffer("carry", 8), Buffer("out", 8)
WORK = [Buffer(name, 4).whole() for name in "abc"]
RESULTS = [OUT.whole().part(0, 4), OUT.whole().part(4, 4)]
MEMORY = [CARRY.whole().part(k, 4) for k in (0, 2, 4)]
READ, WRITTEN = [*WORK, *MEMORY, *RESULTS], [*WORK, *RESULTS]

calls = st.tuples(*[st.sampled_from(READ)] * 2, st.permutations(WRITTEN)).map(
    lambda t: Call(MIX, t[:2], tuple(t[2][:2]))
)
turns = (
    st.tuples(st.sampled_from(READ), st.sampled_from(WRITTEN))
    .filter(lambda t: not t[0].overlaps(t[1]))
    .map(lambda t: Foreign(TURN, t[:1], t[1:], reals=0, ints=0))
)
copies = st.tuples(st.sampled_from(READ), st.sampled_from(WRITTEN)).map(lambda t: Copy(*t))
simple = st.one_of(calls, turns, copies.filter(lambda c: c.source != c.target))
blocks = st.lists(simple, min_size=1, max_size=6).map(tuple)
# What is copied last is what may be computed in its place.
last = st.tuples(st.sampled_from(WORK), st.sampled_from(WRITTEN)).filter(lambda t: t[0] != t[1])
ended = st.tuples(blocks, last.map(lambda t: Copy(*t))).map(lambda t: (*t[0], t[1]))
bodies = st.tuples(
    st.lists(st.one_of(simple, ended.map(lambda block: Loop("k", 2, block))), max_size=2), ended
).map(lambda t: (*t[0], *t[1]))


def copies_in(program: Program) -> int:
    return sum(isinstance(s, Copy) for s in flat(program.body))


@given(bodies)
@settings(max_examples=100)
def test_fewer_copies_same_result(body):
    program = Program("random", CARRY, (), (OUT,), tuple(body), ())
    shorter = without_copies(program)
    assert copies_in(shorter) <= copies_in(program)
    carry = np.random.default_rng(3).standard_normal(8)
    with np.errstate(all="ignore"):
        for new, old in zip(run(shorter, carry, []), run(program, carry, []), strict=True):
            np.testing.assert_array_equal(new, old)


A, B, C = WORK
START = Call(MIX, (MEMORY[0], MEMORY[1]), (A, RESULTS[1]))
"""Fills A and half of the result."""

NEEDED = {
    "used later": (START, Copy(A, RESULTS[0]), Copy(A, RESULTS[1])),
    "target read meanwhile": (Copy(B, C), START, Copy(B, RESULTS[1]), Copy(A, B), Copy(B, C)),
    "target written meanwhile": (START, Copy(B, RESULTS[0]), Copy(A, RESULTS[0])),
    "read before it is filled": (
        Call(MIX, (A, MEMORY[0]), (A, RESULTS[1])),
        Copy(A, B),
        Copy(B, C),
        Call(MIX, (B, C), (RESULTS[0], B)),
    ),
    "target filled at once": (
        Call(MIX, (MEMORY[0], MEMORY[2]), (A, B)),
        Copy(A, B),
        Copy(B, RESULTS[0]),
        Copy(B, RESULTS[1]),
    ),
    "used outside": (Loop("k", 2, (START, Copy(A, B))), Copy(B, C), Copy(A, RESULTS[0])),
    "numbers would move up": (
        Copy(OUT.whole().part(0, 4), A),
        Copy(A, OUT.whole().part(2, 4)),
    ),
    "a kernel must not write what it reads": (
        Copy(MEMORY[0], B),
        Foreign(TURN, (B,), (A,), reals=0, ints=0),
        Copy(A, B),
        Call(MIX, (B, B), (C, RESULTS[0])),
    ),
    "target of the caller used twice": (START, Call(MIX, (A, A), (B, A)), Copy(A, RESULTS[0])),
}


@pytest.mark.parametrize("why", NEEDED)
def test_copies_that_are_needed(why):
    program = Program("needed", CARRY, (), (OUT,), NEEDED[why], ())
    assert without_copies(program) == program


def test_copies_that_are_not():
    block = (START, Call(MIX, (A, MEMORY[0]), (B, C)), Copy(B, RESULTS[0]), Copy(C, RESULTS[1]))
    program = Program("direct", CARRY, (), (OUT,), block, ())
    expected = Call(MIX, (A, MEMORY[0]), (RESULTS[0], RESULTS[1]))
    assert without_copies(program).body == (START, expected)
    turned = Foreign(TURN, (MEMORY[0],), (A,), reals=0, ints=0)
    program = Program("kernel", CARRY, (), (OUT,), (turned, Copy(A, RESULTS[0])), ())
    expected = Foreign(TURN, (MEMORY[0],), (RESULTS[0],), reals=0, ints=0)
    assert without_copies(program).body == (expected,)


@given(st.permutations(range(4)), st.integers(0, 3))
def test_simultaneous_copies(order, extra):
    place = Buffer("m", 12)
    pairs = [*zip(order, range(4), strict=True), (extra, 4)]
    wanted = [Copy(place.whole().part(2 * i, 2), place.whole().part(2 * j, 2)) for i, j in pairs]
    wanted.append(Copy(place.whole().part(7, 2), place.whole().part(10, 2)))
    saved = iter(Buffer(f"saved_{k}", 9).whole() for k in range(9))
    ordered = in_order(wanted, lambda size: next(saved).part(0, size))
    before = np.arange(12.0)
    program = Program("moves", place, (), (), tuple(ordered), ())
    (after,) = run(program, before, [])
    for copy in wanted:
        source, target = (slice(s.offset, s.offset + s.size) for s in (copy.source, copy.target))
        np.testing.assert_array_equal(after[target], before[source])


@pytest.mark.parametrize("step", [1, -1])
def test_window_that_moves_within_itself(step):
    place = Buffer("m", 6).whole()
    source, target = place.part(1, 5), place.part(0, 5)
    wanted = Copy(source, target) if step == 1 else Copy(target, source)
    ordered = in_order([wanted], lambda size: Buffer("saved", size).whole())
    (after,) = run(Program("moves", place.buffer, (), (), tuple(ordered), ()), np.arange(6.0), [])
    expected = [1, 2, 3, 4, 5, 5] if step == 1 else [0, 0, 1, 2, 3, 4]
    np.testing.assert_array_equal(after, expected)


def test_loops_advance_in_place():
    program = walk(location().step)
    loops = [s for s in flat(program.body) if isinstance(s, Loop)]
    assert len(loops) == 2
    for loop in loops:
        assert not any(isinstance(s, Copy) for s in loop.body)


def test_wrong_sizes_are_noticed():
    with pytest.raises(EngineError, match="'m' is used beyond its end"):
        Buffer("m", 4).whole().part(2, 3)
    with pytest.raises(EngineError, match="'m' is copied to another size"):
        Copy(Buffer("m", 4).whole(), Buffer("n", 3).whole())
    with pytest.raises(EngineError, match="'mix' is called with slices of wrong sizes"):
        Call(MIX, (WORK[0],), (WORK[1], WORK[2]))


def test_a_call_with_the_same_arguments_is_made_once():
    """Also if it is made in two functions; what a loop computes is not known after it."""
    x, y, k = ca.SX.sym("x", 3), ca.SX.sym("y"), ca.SX.sym("k")
    root = ca.Function("root", [x, y], [ca.sin(x) * y + x])
    carry, data = ca.MX.sym("carry", 3), ca.MX.sym("data")
    one, two = (
        ca.Function(name, [carry, data], [factor * root(carry, data)])
        for name, factor in (("one", 2.0), ("two", 3.0))
    )
    count, kept = ca.MX.sym("count"), ca.MX.sym("kept", 3)
    down = ca.Function("down", [k], [k - 1])
    body = ca.Function("body", [count, kept, data], [down(count), root(kept, data)])
    _, after = iterate(body, 4, carry=[data, one(carry, data)], constants=[data])
    step = ca.Function("step", [carry, data], [after + root(after, data), two(carry, data)])
    calls = [s for s in flat(walk(step).body) if isinstance(s, Call) and s.leaf.name == "root"]
    assert len(calls) == 3  # of the carry, in the loop, and after it
    start = np.array([1.0, -2.0, 0.5])
    for number in (0.0, 2.0):
        found = run(walk(step), start, [np.array([number])])
        expected = [np.asarray(v).ravel() for v in step(start, number)]
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-14)


def test_once_is_no_loop():
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    body = ca.Function("body", [x, u], [x * u, ca.sum1(x) + u])
    carry, data = ca.MX.sym("carry", 2), ca.MX.sym("data")
    (after,), (seen,) = scan(body, 1, carry=[carry], xs=[data])
    step = ca.Function("step", [carry, data], [after, seen])
    program = walk(step)
    assert not any(isinstance(s, Loop) for s in flat(program.body))
    found = run(program, np.array([1.0, -2.0]), [np.array([3.0])])
    for one, other in zip(found, ([3.0, -6.0], [2.0]), strict=True):
        np.testing.assert_array_equal(one, other)
