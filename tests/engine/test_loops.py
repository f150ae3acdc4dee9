"""Loop functions against plain Python, and what they say about themselves."""

import pickle

import casadi as ca
import numpy as np
import pytest

from backsight.engine.loops import LoopFunction, iterate, loop_of, scan
from backsight.errors import EngineError

rng = np.random.default_rng(1)
X0, M0 = rng.standard_normal((2, 1)), rng.standard_normal((2, 2))
A, U = rng.standard_normal((2, 2)), rng.standard_normal((3, 5))
PAIRS = rng.standard_normal((2, 10))


def body() -> ca.Function:
    """Carry: vector, matrix, number; per pass: a vector and two columns; one constant."""
    x, M, t = ca.SX.sym("x", 2), ca.SX.sym("M", 2, 2), ca.SX.sym("t")
    u, W, a = ca.SX.sym("u", 3), ca.SX.sym("W", 2, 2), ca.SX.sym("a", 2, 2)
    x_next = ca.tanh(a @ x + M @ u[:2] + W[:, 1] * u[2])
    return ca.Function("body", [x, M, t, u, W, a], [x_next, M @ W / 2 + a, t + 1, x * u[0], W @ M])


def plain(length: int) -> tuple[np.ndarray, ...]:
    x, M, vectors, matrices = X0, M0, [], []
    for k in range(length):
        u, W = U[:, k : k + 1], PAIRS[:, 2 * k : 2 * k + 2]
        vectors.append(x * u[0])
        matrices.append(W @ M)
        x, M = np.tanh(A @ x + M @ u[:2] + W[:, 1:] * u[2]), M @ W / 2 + A
    return x, M, np.array([[length]]), np.hstack(vectors), np.hstack(matrices)


def scanned(length: int) -> ca.Function:
    shapes = {
        "x": (2, 1),
        "M": (2, 2),
        "t": (1, 1),
        "U": (3, length),
        "W": (2, 2 * length),
        "a": (2, 2),
    }
    symbols = [ca.MX.sym(name, *shape) for name, shape in shapes.items()]
    x, M, t, u, W, a = symbols
    carry, ys = scan(body(), length, carry=[x, M, t], xs=[u, W], constants=[a])
    return ca.Function("scanned", symbols, [*carry, *ys])


@pytest.mark.parametrize("length", [1, 2, 5])
def test_scan_is_a_for_loop(length):
    results = scanned(length)(X0, M0, 0, U[:, :length], PAIRS[:, : 2 * length], A)
    for result, expected in zip(results, plain(length), strict=True):
        np.testing.assert_allclose(np.asarray(result), expected, rtol=1e-14, atol=1e-15)


def test_backward_scan_is_a_for_loop_from_the_end():
    """Column k of the results belongs to column k of the inputs."""
    x, M, t = (ca.MX.sym(n, *shape) for n, shape in (("x", (2, 1)), ("M", (2, 2)), ("t", (1, 1))))
    u, W, a = (ca.MX.sym(n, *s) for n, s in (("u", (3, 5)), ("W", (2, 10)), ("a", (2, 2))))
    carry, ys = scan(body(), 5, carry=[x, M, t], xs=[u, W], constants=[a], backward=True)
    back = ca.Function("back", [x, M, t, u, W, a], [*carry, *ys])
    pairs = [PAIRS[:, 2 * k : 2 * k + 2] for k in range(5)]
    turned = scanned(5)(X0, M0, 0, U[:, ::-1], np.hstack(pairs[::-1]), A)
    results = [np.asarray(r) for r in back(X0, M0, 0, U, PAIRS, A)]
    for result, expected in zip(results[:3], turned[:3], strict=True):
        np.testing.assert_array_equal(result, np.asarray(expected))
    np.testing.assert_array_equal(results[3], np.asarray(turned[3])[:, ::-1])
    products = np.hsplit(np.asarray(turned[4]), 5)
    np.testing.assert_array_equal(results[4], np.hstack(products[::-1]))


def collatz() -> ca.Function:
    go, n, count, factor = (ca.SX.sym(k) for k in ("go", "n", "count", "factor"))
    n_next = ca.if_else(ca.fmod(n, 2) == 0, n / 2, factor * n + 1)
    return ca.Function("collatz", [go, n, count, factor], [n_next != 1, n_next, count + 1])


def iterated(limit: int) -> ca.Function:
    symbols = [ca.MX.sym(k) for k in ("go", "n", "count", "factor")]
    return ca.Function(
        "iterated", symbols, iterate(collatz(), limit, carry=symbols[:3], constants=symbols[3:])
    )


@pytest.mark.parametrize("start", [2, 6, 27])
def test_iterate_is_a_while_loop(start):
    n, count = start, 0
    while n != 1:
        n, count = (n // 2 if n % 2 == 0 else 3 * n + 1), count + 1
    go, end, passes = map(float, iterated(200)(1, start, 0, 3))
    assert (go, end, passes) == (0, 1, count)


def test_iterate_stops_at_its_limit():
    go, _, passes = map(float, iterated(10)(1, 27, 0, 3))
    assert (go, passes) == (1, 10)


def test_iterate_may_not_start_at_all():
    assert [float(v) for v in iterated(10)(0, 27, 5, 3)] == [0, 27, 5]


def test_iterate_does_not_evaluate_what_comes_after_the_end():
    """Doubled until it is 8; the logarithm would not be a number from there on."""
    go, x = ca.SX.sym("go"), ca.SX.sym("x")
    step = ca.Function("step", [go, x], [2 * x < 8, 2 * x + 0 * ca.log(5 - x)])
    symbols = [ca.MX.sym("go"), ca.MX.sym("x")]
    loop = ca.Function("loop", symbols, iterate(step, 30, carry=symbols))
    assert [float(v) for v in loop(1, 1.0)] == [0, 8]


def called_loop(function: ca.Function) -> LoopFunction:
    """The one loop in a function, found through the instructions of its graph."""
    called = [
        function.instruction_MX(k).which_function()
        for k in range(function.n_instructions())
        if function.instruction_id(k) == ca.OP_CALL
    ]
    (loop,) = [loop for loop in map(loop_of, called) if loop is not None]
    return loop


@pytest.mark.parametrize("thaw", [lambda f: f, lambda f: pickle.loads(pickle.dumps(f))])
def test_loops_are_recognised(thaw):
    loop = called_loop(thaw(scanned(5)))
    assert (loop.kind, loop.length) == ("scan", 5)
    assert (loop.n_carry, loop.n_xs, loop.n_constants) == (3, 2, 1)
    results = loop.body(X0, M0, 0, U[:, 0], PAIRS[:, :2], A)
    for result, expected in zip(results, body()(X0, M0, 0, U[:, 0], PAIRS[:, :2], A), strict=True):
        np.testing.assert_array_equal(np.asarray(result), np.asarray(expected))

    loop = called_loop(thaw(iterated(12)))
    assert (loop.kind, loop.length) == ("iterate", 12)
    assert (loop.n_carry, loop.n_xs, loop.n_constants) == (3, 0, 1)
    assert [float(v) for v in loop.body(1, 6, 0, 3)] == [1, 3, 1]


def test_ordinary_functions_are_no_loops():
    assert loop_of(body()) is None


def test_function_with_the_name_of_a_loop_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(EngineError, match="has the name of a loop"):
        loop_of(ca.Function("scan_3_1_0_0_of_f", [x], [x + 1]))
