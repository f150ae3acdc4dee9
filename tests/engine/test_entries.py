"""Results whose numbers are all made alike become loops, and are the same numbers."""

import casadi as ca
import numpy as np
import pytest

from backsight.engine.program import Loop, walk
from backsight.engine.program.leaf import MANY, entries_of, leaf_of

N = MANY + 6


def _leaf(rows, **more):
    x, y, s = ca.SX.sym("x", 2 * N), ca.SX.sym("y", N), ca.SX.sym("s")
    return ca.Function("rows", [x, y, s], [rows(x, y, s)], **more)


ALIKE = {
    "constants": lambda x, y, s: ca.DM(np.arange(N) + 0.5) * y,
    "a shared number": lambda x, y, s: s * y + ca.sin(x[:N]),
    "every other number": lambda x, y, s: x[::2] - y,
    "a choice": lambda x, y, s: ca.if_else(y > 0, x[N:], s),
    "what takes many numbers, once": lambda x, y, s: ca.norm_1(x) * y + ca.sum1(y),
    "a choice by them": lambda x, y, s: ca.if_else(ca.sum1(x) > 0, y, s),
}
OTHERS = {
    "another operation": lambda x, y, s: ca.vertcat(y[:-1] * s, y[-1] + s),
    "no order": lambda x, y, s: ca.vertcat(*(x[(7 * i) % 5] * s for i in range(N))),
    "backwards": lambda x, y, s: s * y[::-1],
    "few": lambda x, y, s: s * y[: MANY - 1],
}


@pytest.mark.parametrize("rows", ALIKE.values(), ids=ALIKE)
def test_alike(rows):
    function = _leaf(rows)
    found, left = entries_of(leaf_of(function))
    assert len(found) == 1
    assert not any(left.outputs[:-1])


@pytest.mark.parametrize("rows", OTHERS.values(), ids=OTHERS)
def test_not_alike(rows):
    leaf = leaf_of(_leaf(rows))
    found, left = entries_of(leaf)
    assert not found
    assert left is leaf


def test_program_loops_and_machine_code_agrees():
    from backsight.engine.llvm import machine
    from backsight.engine.llvm import module as llvm
    from backsight.engine.llvm.width import Width

    c, y, s = ca.MX.sym("c", N), ca.MX.sym("y", 2 * N), ca.MX.sym("s")
    rows = [_leaf(rows)(y, c, s) for rows in ALIKE.values()]
    outputs = [sum(rows, ca.MX(0)), ca.sum1(rows[0] * rows[-1])]
    step = ca.Function("step", [c, y, s], [rows[1], *outputs])
    program = walk(step)
    assert sum(isinstance(k, Loop) for k in program.body) >= len(ALIKE)
    assert not any(len(leaf.operations) > N for leaf in program.leaves if "each" in leaf.name)

    rng = np.random.default_rng(3)
    carry, data, number = rng.standard_normal(N), rng.standard_normal((2, 2 * N)), np.ones((2, 1))
    expected, at = [], carry
    for k in range(2):
        at, *rows = (np.array(v).ravel() for v in step(at, data[k], number[k]))
        expected.append(rows)
    code = machine.load_code(machine.assemble_code(llvm.write_llvm(program, Width(1))), {})
    found = [np.empty((2, N)), np.empty((2, 1))]
    given = [np.empty(b.size) for b in llvm.given(program, Width(1))]
    code(2, [carry, *given, data, number, *found])
    for j in range(2):
        np.testing.assert_allclose(found[j], [rows[j] for rows in expected], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(carry, at, rtol=1e-14)
