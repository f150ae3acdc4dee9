"""Every arithmetic operation, as machine code and in lanes, against CasADi's own evaluation."""

import casadi as ca
import numpy as np
import pytest

from backsight.engine import lanes, native, vm
from backsight.engine.program.leaf import leaf_of
from backsight.errors import EngineError
from engine.examples import recursion

X = ca.SX.sym("x")
Y = ca.SX.sym("y")
ONE = {
    name: getattr(ca, name)(X)
    for name in (
        "sqrt", "fabs", "floor", "ceil", "exp", "log", "expm1", "log1p", "sin", "cos", "tan",
        "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "erf", "sign",
        "logic_not",
    )
} | {
    "neg": -X, "square": X**2, "twice": 2 * X, "inverse": 1 / X, "cube": X**3, "root": X**2.5,
}  # fmt: skip
TWO = {
    name: getattr(ca, name)(X, Y)
    for name in ("fmin", "fmax", "fmod", "remainder", "copysign", "atan2", "hypot", "power",
                 "logic_and", "logic_or")
} | {
    "add": X + Y, "subtract": X - Y, "multiply": X * Y, "divide": X / Y, "less": X < Y,
    "less_equal": X <= Y, "equal": X == Y, "different": X != Y,
    "choice": ca.if_else(X > Y, X, 2 * Y), "half_choice": ca.if_else(X, Y, 0),
    "nested": ca.if_else(X > 0, ca.if_else(Y > 0, X, Y), ca.sin(Y)),
}  # fmt: skip
EXPRESSIONS = ONE | TWO
VALUES = [0.0, 1.0, -1.0, 0.3, -0.7, 2.5, -3.5, 1e3, np.inf, -np.inf, np.nan]


@pytest.fixture(scope="module")
def outcome():
    """Name of an operation to (reference, machine code, lanes) at all pairs of values."""
    c = ca.SX.sym("c")
    r = recursion(ca.Function("all", [c, X, Y], [c, *EXPRESSIONS.values()]))
    pairs = np.array([(x, y) for x in VALUES for y in VALUES])
    data = [pairs[:, :1].copy(), pairs[:, 1:].copy()]
    _, reference = vm.run(r, data, carry=r.carry0)
    _, single = native.run(r, data, carry=r.carry0)
    # Every lane sees the values in another order.
    orders = [np.roll(np.arange(len(pairs)), k) for k in range(11)]
    many = lanes.run_many(r, [[d[o] for d in data] for o in orders], carries=[r.carry0] * 11)
    together = []
    for i in range(len(reference)):
        rows = np.stack(
            [outputs[i][np.argsort(o)] for o, (_, outputs) in zip(orders, many, strict=True)]
        )
        together.append(rows)
    return dict(zip(EXPRESSIONS, zip(reference, single, together, strict=True), strict=True))


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_as_in_casadi(outcome, name):
    reference, single, together = outcome[name]
    np.testing.assert_allclose(single, reference, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(
        together, np.broadcast_to(reference, together.shape), rtol=1e-14, atol=1e-15
    )


def test_a_choice_is_one_operation():
    leaf = leaf_of(ca.Function("f", [X, Y], [ca.if_else(X > Y, X, Y)]))
    assert [o.kind for o in leaf.operations] == ["input", "input", "lt", "select"]


def test_unknown_operation_is_named():
    c = ca.SX.sym("c")
    r = recursion(ca.Function("observer", [c, X], [c, ca.erfinv(X)]))
    with pytest.raises(EngineError, match=r"'observer' uses the operation ERFINV.*engine='vm'"):
        native.run(r, [np.zeros((2, 1))], carry=r.carry0)
