"""Leaves in C: names that tell people what a number is."""

import casadi as ca

from backsight.engine.c99._local import LONGEST, TOGETHER, local_buffers
from backsight.engine.c99.leaf import Precision, write_c99_leaf
from backsight.engine.program import walk
from backsight.engine.program.leaf import Leaf, leaf_of, leaf_parts


def head(leaf: Leaf) -> str:
    """Everything before the body, in one line."""
    return " ".join(write_c99_leaf(leaf, "real", Precision("double")).split("{")[0].split())


def test_arguments_are_called_as_their_symbols():
    x, speed = ca.SX.sym("x", 3), ca.SX.sym("speed")
    leaf = leaf_of(ca.Function("f", [x, speed], [speed * x]))
    assert head(leaf) == "static void f_( const real *x_, const real *speed_, real *o0_)"
    assert "v1 = x_[0]" in write_c99_leaf(leaf, "real", Precision("double"))


def test_given_names_come_first():
    x = ca.SX.sym("x", 2)
    leaf = leaf_of(ca.Function("f", [x], [x, 2 * x], ["state"], ["same", "double"]))
    assert head(leaf) == "static void f_( const real *state_, real *same_, real *double_)"


def test_names_that_do_not_serve():
    same, other, odd, mixed = (ca.SX.sym(n) for n in ("x", "x", "1/m", "i2"))
    pair = ca.vertcat(ca.SX.sym("a"), ca.SX.sym("b"))
    leaf = leaf_of(ca.Function("f", [same, other, odd, mixed, pair], [same + other]))
    assert leaf.names == ("x", "i1", "i2", "i3", "i4", "o0")


def test_parts_keep_the_names():
    x = ca.SX.sym("x", 40)
    many = [sum((ca.sin(x[i] + j) for i in range(40)), start=ca.SX(0)) for j in range(12)]
    parts = leaf_parts(leaf_of(ca.Function("f", [x], [ca.vertcat(*many), x[0]], ["x"], ["y", "z"])))
    assert len(parts) > 1
    for part, places in parts:
        assert part.names == ("x", *("yz"[j] for j, _ in places))


def test_what_is_short_is_a_local_variable_and_there_are_not_too_many():
    n = LONGEST
    short, long = ca.SX.sym("x", n), ca.SX.sym("z", n + 1)
    square, other = (ca.Function(f"f{v.numel()}", [v], [v * v]) for v in (short, long))
    x, z = ca.MX.sym("x", n), ca.MX.sym("z", n + 1)
    for repeated in (3, 40):
        y, w = x, z
        for _ in range(repeated):
            y, w = square(y), other(w)
        step = ca.Function("step", [ca.MX.sym("carry"), x, z], [ca.MX(0), y + 0, w])
        found = local_buffers(walk(step))
        assert {b.size for b in found} <= {1, n}
        assert len(found) == min(repeated, TOGETHER // n)
