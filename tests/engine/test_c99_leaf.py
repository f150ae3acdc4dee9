"""Leaves in C: names that tell people what a number is."""

import casadi as ca

from backsight.engine.c99.leaf import Precision, write_c99_leaf
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
