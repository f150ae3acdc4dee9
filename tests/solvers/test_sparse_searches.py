"""The l1 path and the search for the best subset against references by other ways."""

import itertools

import numpy as np
import pytest

from backsight.sparse import l1_path
from backsight.sparse._best_subset import best_subset
from backsight.sparse.regression import Regression, beside, refit
from oracles.sparse_forces import lasso


def problem(seed: int, *, rows: int = 30, columns: int = 45, side: int = 0) -> Regression:
    rng = np.random.default_rng(seed)
    H = rng.standard_normal((rows, columns)) * rng.uniform(0.3, 3, columns)
    a = np.zeros(columns)
    a[rng.choice(columns, 5, replace=False)] = rng.uniform(2, 5, 5) * rng.choice([-1, 1], 5)
    y = H @ a + 0.3 * rng.standard_normal(rows)
    return Regression(H, y, np.full(columns, side))


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_point_of_the_path_is_a_minimiser(seed, side):
    """Against an interior point method; with weights of their own for the columns."""
    given = problem(seed, side=side)
    weights = np.random.default_rng(seed).uniform(0.5, 2, 45)
    path = l1_path(given, 1.0, weights=weights)
    assert path.complete
    assert path.kkt < 1e-8
    assert (np.diff(path.lam) < 0).all()
    for lam in (1.0, 7.0, 0.7 * path.lam[0]):
        expected, _ = lasso(given.columns, given.target, lam * weights, side)
        which, values = path.at(lam)
        found = np.zeros(45)
        found[which] = values
        np.testing.assert_allclose(found, expected, atol=1e-7)


def test_columns_that_are_sums_of_others_are_no_trap():
    """They reach their limits exactly together."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        base = rng.standard_normal((8, 9))
        sums = np.column_stack([0.5 * base[:, :-2] + base[:, 1:-1] + 0.5 * base[:, 2:], base[:, 0]])
        given = Regression(np.hstack([base, sums]), rng.standard_normal(8) * 5, np.zeros(17))
        path = l1_path(given, 0.02)
        assert path.complete
        assert path.kkt < 1e-7


def test_the_path_begins_where_nothing_is_found():
    given = problem(4)
    path = l1_path(given, 1.0)
    assert path.lam[0] == pytest.approx(2 * np.abs(given.columns.T @ given.target).max(), rel=1e-8)
    assert not path.values[0].any()
    assert np.count_nonzero(path.values[1]) == 1


def test_the_l1_norm_grows_and_the_residual_falls_along_the_path():
    given = problem(5)
    path = l1_path(given, 0.5)
    size = np.abs(path.values).sum(axis=1)
    residual = given.target[:, None] - given.columns[:, path.which] @ path.values.T
    assert (np.diff(size) > 0).all()
    assert (np.diff((residual**2).sum(axis=0)) < 0).all()


def test_a_weight_that_is_too_large_finds_nothing():
    given = problem(6)
    path = l1_path(given, 1e9)
    assert path.complete
    assert not len(path.at(1e9)[0])


def test_too_many_kinks_are_admitted():
    assert not l1_path(problem(7), 1e-3, most=3).complete


@pytest.mark.parametrize("seed", range(6))
def test_best_subset_is_the_best_of_all_subsets(seed):
    given = problem(seed, rows=12, columns=10)
    penalty = 3.0
    found = best_subset(given, penalty)
    costs = {}
    for size in range(6):
        for chosen in itertools.combinations(range(10), size):
            H = given.columns[:, list(chosen)]
            rest = given.target - H @ np.linalg.lstsq(H, given.target, rcond=None)[0]
            costs[chosen] = rest @ rest + penalty * size
    best = min(costs, key=lambda chosen: costs[chosen])
    assert tuple(sorted(found.which)) == best
    assert found.cost + penalty * len(found.which) == pytest.approx(costs[best])


@pytest.mark.parametrize("seed", [4, 49, 53, 60])
def test_exchanges_find_what_additions_miss(seed):
    """Decaying vibrations of three frequencies that begin at any moment: neighbours are alike."""
    t, rng = np.arange(25), np.random.default_rng(seed)
    H = np.array(
        [
            np.where(t >= k, np.exp(-0.15 * (t - k)) * np.cos(f * (t - k)), 0.0)
            for k in range(20)
            for f in (0.5, 0.65, 0.8)
        ]
    ).T
    a = np.zeros(60)
    a[rng.choice(60, 4, replace=False)] = rng.uniform(3, 8, 4) * rng.choice([-1, 1], 4)
    given = Regression(H, H @ a + 0.3 * rng.standard_normal(25), np.zeros(60))
    found = best_subset(given, 1.0)
    np.testing.assert_array_equal(sorted(found.which), np.flatnonzero(a))


@pytest.mark.parametrize("scatter", [1e-2, 1e-5])
def test_columns_that_are_nearly_the_same_take_each_others_place(scatter):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        H = np.repeat(rng.standard_normal((30, 6)), 6, axis=1)
        H += scatter * rng.standard_normal(H.shape)
        y = H @ rng.standard_normal(36) + rng.standard_normal(30)
        path = l1_path(Regression(H, y, np.zeros(36)), 0.01)
        assert path.complete
        assert path.kkt < 1e-8


def test_signs_are_kept():
    given = problem(1, rows=12, columns=10, side=1)
    found = best_subset(given, 1.0)
    assert (found.values > 0).all()
    fit = refit(given, np.arange(6))
    assert (fit.values > 0).all()


def test_refit_leaves_out_what_depends_on_the_rest():
    given = problem(2)
    H = np.column_stack([given.columns[:, :3], given.columns[:, 0] - 2 * given.columns[:, 1]])
    fit = refit(Regression(H, given.target, np.zeros(4)), np.arange(4))
    expected = np.linalg.lstsq(H[:, :3], given.target, rcond=None)[0]
    np.testing.assert_array_equal(fit.which, [0, 1, 2])
    np.testing.assert_allclose(fit.values, expected)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(H[:, :3].T @ H[:, :3]))
    _, left = beside(Regression(H, given.target, np.zeros(4)), np.arange(3))
    assert not left.any()
