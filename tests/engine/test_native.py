"""Machine code against the virtual machine, and how it behaves towards its caller."""

import time

import casadi as ca
import numpy as np
import pytest

from backsight.engine import native, vm
from backsight.engine.dense import add_product, symmetrise, transpose
from backsight.engine.loops import iterate, scan
from backsight.errors import EngineError
from closeness import assert_close
from engine.examples import data_for, location, recursion


def assert_same(r, data, tolerance=1e-12):
    carry, outputs = native.run(r, data, carry=r.carry0)
    expected, reference = vm.run(r, data, carry=r.carry0)
    np.testing.assert_allclose(carry, expected, rtol=tolerance, atol=tolerance)
    for output, wanted in zip(outputs, reference, strict=True):
        assert_close(output, wanted, tolerance)
    return outputs


def test_loops_in_loops():
    r = location()
    _, steps, *_, at_minimum = assert_same(r, data_for(r, 300))
    assert len(np.unique(steps)) > 2, "all samples took the same number of steps"
    assert np.all(at_minimum == 1)


def step_of_step(inside: ca.Function) -> ca.Function:
    """A body "step" that calls a function "step"."""
    go, a = ca.MX.sym("go"), ca.MX.sym("a")
    return ca.Function("step", [go, a], [go, 2 * inside(a)])


@pytest.mark.parametrize("kind", ["scan", "iterate"])
def test_body_may_have_the_name_of_a_function_in_it(kind):
    x, c, y = ca.SX.sym("x"), ca.MX.sym("carry"), ca.MX.sym("y")
    inside = ca.Function("step", [x], [x + 1])

    def run(body, start):
        if kind == "iterate":
            return iterate(body, 3, carry=[ca.MX(1), start])[1]
        return scan(body, 3, carry=[ca.MX(1), start])[0][1]

    once = run(step_of_step(inside), c)
    again = run(step_of_step(ca.Function("step", [c], [once])), c)
    r = recursion(ca.Function("named", [c, y], [once, once, again]))
    outputs = assert_same(r, data_for(r, 1))
    carry = float(r.carry0[0])
    for _ in range(3):
        carry = 2 * (carry + 1)
    assert outputs[0][0, 0] == pytest.approx(carry, rel=1e-15)


def test_operations_between_leaves():
    a, b = ca.MX.sym("a", 12), ca.MX.sym("b", 4)
    A, B = ca.reshape(a, 3, 4), ca.reshape(b, 2, 2)
    part = ca.MX(A)
    part[1:3, 2] = b[:2]
    part[[0, 2], 0] = 7
    added = ca.MX(A)
    added[::2, ::3] += B
    top, rest = ca.vertsplit(A, [0, 1, 3])
    left, right = ca.horzsplit(A, [0, 1, 4])
    lower = ca.project(A[:, :3], ca.Sparsity.lower(3))
    results = [
        part, added, top.T, rest[:, ::2], left, right[[2, 0], :], A[[1, 0], [2, 0, 3]],
        ca.mtimes(A.T, A), ca.mtimes(lower, A), lower.T + ca.MX(ca.DM.eye(3)), ca.diagcat(B, lower),
        ca.repmat(B, 2, 3), ca.repsum(A, 1, 2), ca.dot(A, part), ca.bilin(B, b[:2], b[2:]),
        ca.rank1(B, 2, b[:2], b[2:]), ca.kron(B, B), ca.norm_1(b), ca.norm_2(b), ca.norm_inf(b),
        ca.norm_fro(A), ca.mmin(A), ca.mmax(A), ca.det(A[:, 1:]),
        ca.if_else(a[0] > b[0], A, -A), ca.sin(A) * A / 3 - ca.fmax(A, b[1]), ca.sum1(A),
        ca.trace(B), ca.densify(lower), 2 * ca.DM.ones(3, 2), ca.unite(ca.MX(1, 1), b[0]),
    ]  # fmt: skip
    outputs = [ca.densify(ca.vec(result)) for result in results]
    r = recursion(ca.Function("between", [a, b], [ca.vertcat(a[1:], b[0]), *outputs]))
    assert_same(r, data_for(r, 20))


def test_large_matrices():
    n = 40
    carry, y = ca.MX.sym("carry", n * n), ca.MX.sym("y", n)
    P = ca.reshape(carry, n, n)
    pattern = ca.DM(np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-7))
    x = ca.SX.sym("x", n)
    factor = ca.Function("factor", [x], [ca.diag(x) @ ca.SX(ca.sparsify(pattern)) * 0.3])(y)
    congruence = add_product(
        ca.MX(ca.DM.eye(n).full()), transpose(add_product(P * 0, P, factor)), factor
    )
    scaled = -ca.tanh(congruence) / 2 + y[0]
    outputs = [ca.vec(symmetrise(scaled)), ca.sum1(ca.vec(P))]
    r = recursion(ca.Function("large", [carry, y], [ca.vec(congruence), *outputs]))
    assert_same(r, data_for(r, 5))


def test_large_leaf_in_parts():
    x, s = ca.SX.sym("x", 700), ca.SX.sym("s")
    leaf = ca.Function("scaling", [x, s], [x * np.arange(700) + s, ca.sin(s), x[::-1] - s])
    carry, y = ca.MX.sym("carry", 700), ca.MX.sym("y")
    r = recursion(ca.Function("parts", [carry, y], [carry * 0.5, *leaf(carry, y)]))
    assert_same(r, data_for(r, 4))


def test_memory_that_changes_places():
    c, y = ca.MX.sym("c", 6), ca.MX.sym("y")
    swapped = ca.vertcat(c[3:], c[1], c[0], y)
    r = recursion(ca.Function("places", [c, y], [swapped, c[::-1]]))
    assert_same(r, data_for(r, 30))


def test_same_input_twice_and_stacked_outputs():
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    body = ca.Function("body", [x, u], [ca.sin(x) + u, x[0] * u, x])
    c, y = ca.MX.sym("c", 2), ca.MX.sym("y", 2)
    xs = ca.horzcat(y, c, y, c)
    (end,), (first, second) = scan(body, 4, carry=[c], xs=[xs])
    outputs = [ca.vec(first), ca.vec(second), ca.vec(second[:, 1:3])]
    r = recursion(ca.Function("stacks", [c, y], [end, *outputs]))
    assert_same(r, data_for(r, 10))


@pytest.mark.parametrize("block", [1, 7, 1000])
def test_block_size_is_irrelevant(block):
    r = location()
    data = data_for(r, 50)
    carry, outputs = native.run(r, data, carry=r.carry0)
    counts = []
    again = native.run(r, data, carry=r.carry0, block=block, progress=counts.append)
    assert np.array_equal(carry, again[0])
    assert all(np.array_equal(a, b) for a, b in zip(outputs, again[1], strict=True))
    assert counts == [*range(block, 50, block), 50]


def test_sample_by_sample():
    r = location()
    data = data_for(r, 20)
    carry, outputs = native.run(r, data, carry=r.carry0)
    stepper = native.Stepper(r)
    steps = [stepper.step([d[k] for d in data]) for k in range(20)]
    for j, output in enumerate(outputs):
        assert np.array_equal(np.array([s[j] for s in steps]), output)
    assert np.array_equal(stepper.carry, carry)


def test_no_samples():
    r = location()
    carry, outputs = native.run(r, data_for(r, 0), carry=r.carry0)
    assert np.array_equal(carry, r.carry0)
    assert [o.shape for o in outputs] == [(0, size) for size in r.output_sizes]


def test_arguments_stay_as_they_were():
    r = location()
    wide = np.asfortranarray(np.random.default_rng(2).standard_normal((30, 3)))
    before, start = wide.copy(), r.carry0.copy()
    native.run(r, [wide[:, 1:2]], carry=r.carry0)
    assert np.array_equal(wide, before)
    assert np.array_equal(r.carry0, start)


@pytest.mark.parametrize(("rows", "size"), [((5, 2), 6), ((5, 1), 5)])
def test_wrong_sizes(rows, size):
    with pytest.raises(EngineError, match="'location' takes data of shape"):
        native.run(location(), [np.zeros(rows)], carry=np.zeros(size))


def test_interrupt_arrives_within_a_second():
    x = ca.SX.sym("x")
    leaf = ca.Function("leaf", [x], [ca.sin(x) + ca.exp(-x * x)])
    c, y = ca.MX.sym("c"), ca.MX.sym("y")
    (end,), _ = scan(leaf, 100_000, carry=[c])
    r = recursion(ca.Function("slow", [c, y], [end, y]))
    native.compiled(r)
    began = time.perf_counter()

    def interrupt(samples: int) -> None:
        if time.perf_counter() - began > 0.1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        native.run(r, [np.zeros((1000, 1))], carry=r.carry0, progress=interrupt)
    assert time.perf_counter() - began < 1.0


def test_what_cannot_be_compiled_is_named():
    c, y = ca.MX.sym("c"), ca.MX.sym("y", 3)
    r = recursion(ca.Function("filter", [c, y], [c, ca.logsumexp(y)]))
    with pytest.raises(EngineError, match="'filter' uses the operation LOGSUMEXP"):
        native.run(r, data_for(r, 2), carry=r.carry0)
    double = ca.Function("double", [y], [2 * y])
    switch = ca.Function.if_else("either", double, ca.Function("same", [y], [y]))
    r = recursion(ca.Function("filter", [c, y], [c, switch(c, y)]))
    with pytest.raises(EngineError, match="'filter' calls 'either', a Switch"):
        native.run(r, data_for(r, 2), carry=r.carry0)


def test_sparse_loop_is_refused():
    L, u = ca.SX.sym("L", ca.Sparsity.lower(2)), ca.SX.sym("u", 2)
    body = ca.Function("body", [L, u], [L + ca.tril(u @ u.T)])
    c, y = ca.MX.sym("c", 4), ca.MX.sym("y", 2)
    (end,), _ = scan(body, 2, carry=[ca.reshape(c, 2, 2)], xs=[ca.horzcat(y, y)])
    r = recursion(ca.Function("sparse", [c, y], [ca.vec(ca.densify(end)), y]))
    with pytest.raises(EngineError, match=r"'sparse' loops over 'body'.*casadi\.densify"):
        native.run(r, data_for(r, 2), carry=r.carry0)
