"""Bounds on a Gaussian: block pivoting against the enumeration of all active sets."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backsight.solvers.box import _box as box
from backsight.solvers.box._box import dual_active_set

seeds = st.integers(0, 2**32 - 1)


def random_problem(n: int, seed: int) -> tuple[np.ndarray, ...]:
    """Ill-conditioned M, bounds of which some are missing, and x often outside."""
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((n, rng.integers(1, n + 2)))
    M = F @ F.T + 10.0 ** rng.uniform(-6, 0) * np.eye(n)
    size = 10.0 ** rng.uniform(-1, 1, n)
    low = np.where(rng.random(n) < 0.8, -rng.exponential(1, n), -np.inf) * size
    high = np.where(rng.random(n) < 0.8, rng.exponential(1, n), np.inf) * size
    return M * np.outer(size, size), 2 * rng.standard_normal(n) * size, low, high


def solve(M, x, low, high) -> tuple[np.ndarray, np.ndarray, float]:
    n = len(x)
    packed = np.concatenate([M[j:, j] for j in range(n)])
    lam, side, passes, exhausted = dual_active_set(n)(packed, x, low, high)
    assert not exhausted
    return np.asarray(lam)[:, 0], np.asarray(side)[:, 0], float(passes)


def enumerated(M, x, low, high) -> list[np.ndarray]:
    """Multipliers of every choice of sides that meets all conditions."""
    n, found = len(x), []
    for side in map(np.array, itertools.product((0, 1, -1), repeat=n)):
        target = np.where(side > 0, low, np.where(side < 0, high, x))
        on = np.flatnonzero(side)
        if not np.all(np.isfinite(target)):
            continue
        lam = np.zeros(n)
        lam[on] = np.linalg.solve(M[np.ix_(on, on)], (target - x)[on])
        moved = x + M @ lam
        slack = 1e-9 * (1 + np.abs(moved))
        if np.all(side * lam >= 0) and np.all((moved >= low - slack) & (moved <= high + slack)):
            found.append(lam)
    return found


@given(st.integers(1, 4), seeds)
def test_multipliers_are_those_of_the_best_active_set(n, seed):
    problem = random_problem(n, seed)
    lam, side, _ = solve(*problem)
    expected = enumerated(*problem)
    assert expected
    np.testing.assert_allclose(lam, expected[0], rtol=1e-6, atol=1e-9 * np.abs(lam).max())
    np.testing.assert_array_equal(side[lam != 0], np.sign(lam[lam != 0]))


@given(st.integers(5, 9), seeds)
def test_optimality_of_larger_problems(n, seed):
    """Feasible, on the right side, and no multiplier where no bound is met."""
    M, x, low, high = random_problem(n, seed)
    lam, _, _ = solve(M, x, low, high)
    moved = x + M @ lam
    slack = 1e-7 * (1 + np.abs(moved))
    assert np.all((moved >= low - slack) & (moved <= high + slack))
    np.testing.assert_allclose(moved[lam > 0], low[lam > 0], atol=1e-6)
    np.testing.assert_allclose(moved[lam < 0], high[lam < 0], atol=1e-6)


def test_inside_the_bounds_nothing_happens():
    lam, side, passes = solve(np.eye(3), np.array([0.1, -0.2, 0.3]), -np.ones(3), np.ones(3))
    assert not lam.any()
    assert not side.any()
    assert passes == 1


def test_fixed_direction_inside_its_bounds():
    """M of an entry without variance is zero: it cannot move and need not."""
    M = np.diag([0.0, 2.0])
    lam, side, _ = solve(M, np.array([0.5, 3.0]), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(lam, [0.0, -1.0])
    np.testing.assert_array_equal(side, [0, -1])


@pytest.mark.parametrize("block_passes", [0, 1])
def test_one_at_a_time_finds_the_same(monkeypatch, block_passes):
    """The second phase alone, which hardly any problem reaches otherwise."""
    for seed in range(30):
        problem = random_problem(4, seed)
        expected, _, _ = solve(*problem)
        with monkeypatch.context() as patch:
            patch.setattr(box, "BLOCK_PASSES", block_passes)
            single, _, _ = solve(*problem)
        np.testing.assert_allclose(single, expected, rtol=1e-7, atol=1e-12)


def test_where_block_pivoting_runs_in_circles():
    """Here all wrong indices at once come back to the start for ever; one at a time ends it."""
    M = np.array([[10.0, 4.0, 7.0], [4.0, 49.0, 28.0], [7.0, 28.0, 20.0]])
    problem = M, np.array([4.0, -6.0, -2.0]), np.array([-2.0, 0.0, -1.0]), np.array([2.0, 3.0, 1.0])
    lam, side, passes = solve(*problem)
    assert passes > box.BLOCK_PASSES
    np.testing.assert_array_equal(side, [-1, 1, 0])
    np.testing.assert_allclose(lam, enumerated(*problem)[0], rtol=1e-12)


def test_many_bounds_stay_affordable():
    """The number of passes provided for grows with the number of bounds, not exponentially."""
    M, x, low, high = random_problem(24, 1)
    lam, _, _ = solve(M, x, low, high)
    moved = x + M @ lam
    assert np.all((moved >= low - 1e-7) & (moved <= high + 1e-7))
