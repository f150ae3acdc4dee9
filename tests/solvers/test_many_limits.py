"""Many limits on few states: conditions of optimality, linear programs, bounded least squares."""

import functools

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from backsight.solvers.trajectory import Chain, by_name, solve


def random_problem(seed: int, *, n: int, nx: int):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, nx))
    L = rng.standard_normal((nx, nx)) * 10 ** rng.uniform(-1, 1, nx)
    x = 3 * rng.standard_normal(nx)
    point = rng.standard_normal(nx)
    width = rng.uniform(0.1, 2.0, (2, n))
    lower, upper = A @ point - width[0], A @ point + width[1]
    lower[rng.random(n) < 0.3] = -np.inf
    upper[rng.random(n) < 0.3] = np.inf
    return A, L @ L.T, x, lower, upper


@functools.cache
def window_of(n: int, nx: int) -> tuple[Chain, ca.Function]:
    dense = ca.Sparsity.dense
    chain = Chain(
        N=1, Q=np.zeros((nx, nx)), F=dense(nx, nx), H=ca.Sparsity(0, nx), noise=np.zeros((n, nx)),
        A=dense(n, nx), softness=np.zeros(n), slack=np.full(n, 1e-10),
    )  # fmt: skip
    return chain, solve(chain)


def found_by(A, Sigma, x, lower, upper, tried=None):
    """Minimise the distance from x in the metric of Sigma: a window of two samples.

    The multipliers, the sides, rows in conflict, whether there are any, and whether passes lacked.
    """
    n, nx = A.shape
    chain, solver = window_of(n, nx)
    none = np.full((n, 1), np.inf)
    stages = {
        "F": np.tile(np.eye(nx).ravel()[:, None], 2), "c": np.zeros((nx, 2)),
        "before": [[0.0, 0.0]], "H": np.zeros((0, 2)), "e": np.zeros((0, 2)),
        "A": np.tile(A.ravel(order="F")[:, None], 2),
        "low": np.hstack([np.reshape(lower, (n, 1)), -none]),
        "high": np.hstack([np.reshape(upper, (n, 1)), none]),
    }  # fmt: skip
    tried = np.zeros(n) if tried is None else tried
    given = [x, chain.stored(Sigma), *stages.values(), np.stack([tried, 0 * tried], axis=1)]
    found = by_name(solver, [ca.DM(k) for k in given])
    nu, side, conflict = (np.array(found[k])[:, 0] for k in ("nu", "side", "conflict"))
    return nu, side, conflict, conflict.any(), float(found["open"])


@pytest.mark.parametrize(("n", "nx"), [(1, 1), (4, 6), (12, 5), (30, 8)])
def test_conditions_of_optimality(n, nx):
    solved = 0
    for seed in range(25):
        A, Sigma, x, lower, upper = random_problem(seed, n=n, nx=nx)
        lam, side, _, infeasible, exhausted = found_by(A, Sigma, x, lower, upper)
        assert infeasible == 0
        assert exhausted == 0
        moved = A @ (x + Sigma @ A.T @ lam)
        size = np.sqrt(np.diag(A @ Sigma @ A.T))
        assert np.all((moved - lower) / size > -1e-7)
        assert np.all((upper - moved) / size > -1e-7)
        assert np.all(lam[side == 0] == 0)
        assert np.all(lam * side >= 0)
        at = np.where(side > 0, lower, upper)
        assert np.all(np.abs(moved - at)[side != 0] < 1e-7 * size[side != 0])
        solved += bool(side.any())
    assert solved > 5


def test_box_is_bounded_least_squares():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        root = rng.standard_normal((6, 6))
        x = 2 * rng.standard_normal(6)
        lower, upper = -rng.random(6), rng.random(6)
        Sigma = np.linalg.inv(root.T @ root)
        lam, *_ = found_by(np.eye(6), Sigma, x, lower, upper)
        expected = lsq_linear(root, root @ x, (lower, upper), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(x + Sigma @ lam, expected, rtol=1e-7, atol=1e-8)


def test_start_does_not_change_the_result():
    for seed in range(10):
        problem = random_problem(seed, n=12, nx=5)
        cold, side, *_ = found_by(*problem)
        for tried in (np.abs(side), np.ones(12), (np.arange(12) % 3 == 0).astype(float)):
            warm, *_ = found_by(*problem, tried)
            A, Sigma = problem[:2]
            np.testing.assert_allclose(Sigma @ A.T @ warm, Sigma @ A.T @ cold, rtol=1e-6, atol=1e-8)


def test_contradictions_are_found_and_named():
    """Rows 1 and 3 ask for the impossible together; row 0 and 2 have nothing to do with it."""
    A = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [0.0, 2.0, 2.0]])
    lower = np.array([0.5, 1.0, -np.inf, -np.inf])
    upper = np.array([np.inf, np.inf, 5.0, 1.0])
    _, _, conflict, infeasible, _ = found_by(A, np.diag([1.0, 4.0, 0.2]), np.zeros(3), lower, upper)
    assert infeasible == 1
    np.testing.assert_array_equal(conflict, [0, 1, 0, 1])


def test_random_contradictions():
    """Feasible or not is what a linear program says."""
    verdicts = []
    for seed in range(40):
        A, Sigma, x, lower, upper = random_problem(seed, n=8, nx=3)
        rng = np.random.default_rng(seed)
        shift = 2 * rng.standard_normal(8)
        lower, upper = lower + shift, upper + shift
        *_, infeasible, exhausted = found_by(A, Sigma, x, lower, upper)
        bounds = [(None, None)] * 3
        rows = np.vstack([A, -A])
        limits = np.concatenate([upper, -lower])
        keep = np.isfinite(limits)
        feasible = linprog(np.zeros(3), rows[keep], limits[keep], bounds=bounds).status == 0
        assert exhausted == 0
        assert infeasible == (not feasible)
        verdicts.append(feasible)
    assert 5 < sum(verdicts) < 35


def test_row_without_variance_cannot_be_moved():
    A = np.eye(2)
    Sigma = np.diag([1.0, 0.0])
    lam, _, conflict, infeasible, _ = found_by(A, Sigma, np.zeros(2), [0.5, -1.0], [2.0, 1.0])
    assert infeasible == 0
    np.testing.assert_allclose(lam, [0.5, 0.0])
    _, _, conflict, infeasible, _ = found_by(A, Sigma, np.zeros(2), [-1.0, 0.5], [2.0, 1.0])
    assert infeasible == 1
    np.testing.assert_array_equal(conflict, [0, 1])
