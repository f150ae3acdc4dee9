"""Bounds in the window: those that are not reached change nothing, the others are optimal."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from backsight.estimators import MHO
from backsight.testing import DT as PERIOD
from backsight.testing import TrialProblem, simulated
from closeness import assert_close
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, R, Run, model, record

N = 5
INSIDE = ((-1e3, 1e3), (-1e3, np.inf), (-np.inf, 1e3))


def test_inactive_bounds_change_nothing_in_a_linear_window():
    u, y = record(40, seed=1, missing=0.2)
    observer = MHO(**GAUSSIANS, N=N)
    free, bounded = Run(observer, model(), DT)(u, y), Run(observer, model(INSIDE), DT)(u, y)
    for name in ("x_hat", "P", "x_start", "P_start"):
        assert_close(bounded[name], free[name], 1e-13)
    np.testing.assert_array_equal(bounded["iterations"], free["iterations"])
    assert not bounded["status"].any()


def test_inactive_bounds_change_nothing_in_a_nonlinear_window():
    data = simulated(80, seed=2, hold="zoh", noisy=True)
    free, bounded = TrialProblem(k_bounds=(-np.inf, np.inf)), TrialProblem(k_bounds=(1.0, 1e4))
    results = [
        Run(MHO(p.noise, p.prior, N=6), p.model, PERIOD)(data.u, data.y) for p in (free, bounded)
    ]
    for name in ("x_hat", "P", "x_start", "P_start"):
        assert_close(results[1][name], results[0][name], 1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_active_bounds_are_optimal(seed):
    """The first full window against scipy, with bounds drawn so that some are active.

    The prior mean lies inside the bounds and y_0 is not measured, so that nothing but the
    optimiser has touched it.
    """
    rng = np.random.default_rng(seed)
    u, y = record(N + 1, seed=seed, missing=0.2)
    y[0, 1], y[0, 0] = np.nan, 0.0
    y[0, 0] = (SYSTEM["C"] @ X0)[0]
    bounds = tuple((x - rng.uniform(0.05, 0.4), x + rng.uniform(0.05, 0.4)) for x in X0)
    result = Run(MHO(**GAUSSIANS, N=N), model(bounds), DT)(u, y)
    rows, values = stacked(u, y)
    lower, upper = np.array(bounds).T
    expected = lsq_linear(rows, values, (lower, upper), method="bvls", tol=1e-15)
    x_start, P_start = result["x_start"][N], result["P_start"][N]
    np.testing.assert_allclose(x_start, expected.x, rtol=0, atol=1e-9)
    active = expected.active_mask != 0
    assert active.any()
    np.testing.assert_allclose(P_start[active], 0.0, atol=1e-14)
    H = rows[:, ~active].T @ rows[:, ~active]
    np.testing.assert_allclose(P_start[np.ix_(~active, ~active)], np.linalg.inv(H), rtol=1e-8)


def stacked(u: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened rows of the window: posterior of y_0 as prior, then all measurements."""
    A, B, C = SYSTEM.values()
    first = C[:1]
    K = P0 @ first.T / (first @ P0 @ first.T + R[0, 0])
    P = P0 - K @ first @ P0
    L = np.linalg.cholesky(P)
    rows, values = [np.linalg.inv(L)], [np.linalg.solve(L, X0)]
    response, transition = np.zeros(3), np.eye(3)
    for measured, command in zip(y, u, strict=True):
        seen = np.flatnonzero(np.isfinite(measured))
        V = np.linalg.cholesky(R[np.ix_(seen, seen)])
        rows.append(np.linalg.solve(V, C[seen] @ transition))
        values.append(np.linalg.solve(V, measured[seen] - C[seen] @ response))
        response, transition = A @ response + B @ command, A @ transition
    return np.vstack(rows), np.concatenate(values)
