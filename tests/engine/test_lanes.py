"""Many recordings at once against each one on its own."""

import time

import casadi as ca
import numpy as np
import pytest

from backsight.engine import lanes, native
from backsight.engine.llvm import machine
from backsight.engine.loops import scan
from backsight.errors import EngineError
from closeness import assert_close
from engine.examples import data_for, location, recursion

LENGTHS = [40, 1, 0, 77, 40, 23, 39, 41, 80, 2, 80]


def recordings(r):
    rng = np.random.default_rng(5)
    data = [data_for(r, n, seed=n + k) for k, n in enumerate(LENGTHS)]
    carries = [rng.standard_normal(len(r.carry0)) for _ in LENGTHS]
    return data, carries


def assert_each_as_alone(r, data, carries, outcomes):
    for one, carry, (end, outputs) in zip(data, carries, outcomes, strict=True):
        expected, alone = native.run(r, one, carry=carry)
        np.testing.assert_allclose(end, expected, rtol=1e-12, atol=1e-12)
        for output, wanted in zip(outputs, alone, strict=True):
            if len(wanted):
                assert_close(output, wanted, 1e-12)


@pytest.mark.parametrize("threads", [1, 3])
def test_each_as_alone(threads):
    r = location()
    data, carries = recordings(r)
    outcomes = lanes.run_many(r, data, carries=carries, threads=threads)
    assert_each_as_alone(r, data, carries, outcomes)


def test_number_of_steps_is_that_of_the_recording():
    r = location()
    data, carries = recordings(r)
    data[0][0] *= 1e3
    outcomes = lanes.run_many(r, data, carries=carries)
    for one, carry, (_, outputs) in zip(data, carries, outcomes, strict=True):
        assert np.array_equal(outputs[1], native.run(r, one, carry=carry)[1][1])


def test_outputs_go_where_they_are_told():
    r = location()
    data, carries = recordings(r)
    into = [[np.full((len(d[0]), size), np.nan) for size in r.output_sizes] for d in data]
    expected = lanes.run_many(r, data, carries=carries)
    for k, (_, outputs) in enumerate(lanes.run_many(r, data, carries=carries, into=into)):
        assert all(a is b for a, b in zip(outputs, into[k], strict=True))
        assert all(np.array_equal(a, b) for a, b in zip(outputs, expected[k][1], strict=True))
    with pytest.raises(EngineError, match="places for 1 of"):
        lanes.run_many(r, data, carries=carries, into=into[:1])
    with pytest.raises(EngineError, match="puts out arrays"):
        lanes.run_many(r, data, carries=carries, into=[[o[:-1] for o in p] for p in into])


def test_nan_stays_in_its_recording():
    r = location()
    data, carries = recordings(r)
    clean = lanes.run_many(r, data, carries=carries)
    data[4][0][10] = np.nan
    outcomes = lanes.run_many(r, data, carries=carries)
    for k, ((_, outputs), (_, expected)) in enumerate(zip(outcomes, clean, strict=True)):
        same = [np.array_equal(a, b) for a, b in zip(outputs, expected, strict=True)]
        assert all(same) != (k == 4)
    assert np.isnan(outcomes[4][1][2][10]).any()


@pytest.mark.parametrize("number", [1, 3, 8, 9])
def test_any_number_of_recordings(number):
    r = location()
    data = [data_for(r, 12, seed=k) for k in range(number)]
    carries = [r.carry0] * number
    counts = []
    outcomes = lanes.run_many(r, data, carries=carries, progress=counts.append)
    assert_each_as_alone(r, data, carries, outcomes)
    assert counts[-1] == 12 * number


def test_four_lanes(monkeypatch):
    monkeypatch.setattr(machine, "widest", lambda: 4)
    r = location()
    data, carries = recordings(r)
    assert_each_as_alone(r, data, carries, lanes.run_many(r, data, carries=carries))


def test_large_buffers_are_not_shared():
    c, y = ca.MX.sym("c", 2000), ca.MX.sym("y")
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    body = ca.Function("body", [u, x], [u + x / 2000, ca.sin(u)])
    (end,), (stack,) = scan(body, 2000, carry=[y], xs=[c.T])
    r = recursion(ca.Function("large", [c, y], [ca.vec(stack), end]))
    data = [data_for(r, 3, seed=k) for k in range(10)]
    outcomes = lanes.run_many(r, data, carries=[r.carry0] * 10, threads=2)
    assert_each_as_alone(r, data, [r.carry0] * 10, outcomes)


@pytest.mark.parametrize("size", [5, 20, 100])
def test_windows_that_move_either_way(size):
    c, y = ca.MX.sym("c", 2 * size), ca.MX.sym("y")
    ahead, back = c[:size], c[size:]
    moved = ca.vertcat(ahead[1:], y, y, back[:-1])
    r = recursion(ca.Function("windows", [c, y], [moved, ahead, back]))
    data = [data_for(r, n, seed=n) for n in (10, 4, 120)]
    outcomes = lanes.run_many(r, data, carries=[r.carry0] * 3)
    assert_each_as_alone(r, data, [r.carry0] * 3, outcomes)
    ahead, back = outcomes[2][1]
    assert np.array_equal(ahead[-1, -4:], data[2][0][-5:-1, 0])
    assert np.array_equal(back[-1, :4], data[2][0][-2:-6:-1, 0])


def test_wrong_size_is_refused():
    r = location()
    with pytest.raises(EngineError, match="takes data of shape"):
        lanes.run_many(r, [[np.zeros((3, 1))], [np.zeros((3, 2))]], carries=[r.carry0] * 2)


def test_interrupt_ends_the_threads():
    x = ca.SX.sym("x")
    leaf = ca.Function("leaf", [x], [ca.sin(x) + ca.exp(-x * x)])
    c, y = ca.MX.sym("c"), ca.MX.sym("y")
    (end,), _ = scan(leaf, 20_000, carry=[c])
    r = recursion(ca.Function("slow", [c, y], [end, y]))
    data = [[np.zeros((10_000, 1))] for _ in range(20)]
    native.compiled(r, lanes=machine.widest())

    def interrupt(samples: int) -> None:
        raise KeyboardInterrupt

    began = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        lanes.run_many(r, data, carries=[r.carry0] * 20, progress=interrupt)
    assert time.perf_counter() - began < 2.0
