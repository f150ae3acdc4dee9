import casadi as ca
import numpy as np
import pytest

from backsight.errors import TuningError
from backsight.solvers.box import GaussNewton, QuasiNewton

INFINITE = np.full(3, np.inf)
TIGHT = {"max_iterations": 400, "cost_tolerance": 0.0, "step_tolerance": 1e-13}
X_BAR = np.array([0.5, -0.3, 1.0])
L = np.array([[1.0, 0.0, 0.0], [0.4, 0.8, 0.0], [-0.2, 0.1, 0.5]])
MEASURED = np.array([1.0, 0.2, -0.4, 0.9])


def curved():
    """Cost, minus gradient and Gauss-Newton Hessian of a nonlinear least-squares problem."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 4)
    model = ca.vertcat(x[0] * x[1], ca.sin(x[2]), x[0] + x[1] ** 2, x[2] - x[0])
    e, H = y - model, ca.jacobian(model, x)
    G = H.T @ H
    triangle = ca.vertcat(*(G[j:, j] for j in range(3)))
    return ca.Function(
        "evaluate", [x, y], [ca.sumsqr(e) / 2, H.T @ e, triangle], ["x", "y"], list("lcG")
    )


def solve(method, *, lower=-INFINITE, upper=INFINITE, unit=1.0, factor=L, run=1.0):
    minimise = method.minimiser(curved(), lower=lower, upper=upper, cost_unit=unit)
    x, Sigma, count, limit, rejected = (
        np.asarray(r) for r in minimise(run, X_BAR, factor, MEASURED)
    )
    return x[:, 0], Sigma[:, 0], float(count[0, 0]), bool(limit[0, 0]), bool(rejected[0, 0])


@pytest.mark.parametrize(
    ("lower", "upper", "active"),
    [
        (-INFINITE, INFINITE, 0),
        (np.array([0.2, -np.inf, -np.inf]), np.array([np.inf, np.inf, 1.002]), 2),
        (np.array([-np.inf, -0.31, -np.inf]), INFINITE, 1),
    ],
)
def test_with_tight_tolerances_it_finds_the_same_minimum_and_covariance(lower, upper, active):
    x, Sigma, *_ = solve(QuasiNewton(**TIGHT), lower=lower, upper=upper)
    x_newton, Sigma_newton, *_ = solve(GaussNewton(200, tolerance=1e-10), lower=lower, upper=upper)
    assert np.sum((x == lower) | (x == upper)) == active
    np.testing.assert_allclose(x, x_newton, rtol=0, atol=1e-7)
    np.testing.assert_allclose(Sigma, Sigma_newton, rtol=0, atol=1e-6)


def test_the_first_step_is_the_steepest_descent_in_x():
    unit = 0.01
    x, *_ = solve(QuasiNewton(cost_tolerance=1e9), unit=unit)
    _, minus_gradient, _ = curved()(X_BAR, MEASURED)
    np.testing.assert_allclose(x - X_BAR, 2 * unit * np.asarray(minus_gradient)[:, 0], rtol=1e-12)


def test_the_tolerance_on_the_cost_is_absolute_for_small_costs():
    method = QuasiNewton(step_tolerance=0.0)
    evaluations = [solve(method, unit=unit)[2] for unit in (1.0, 1e-4)]
    assert evaluations[0] > 4
    assert evaluations[1] == 2


def test_a_switched_off_window_returns_the_prior():
    x, Sigma, count, limit, rejected = solve(QuasiNewton(), run=0.0)
    np.testing.assert_array_equal(x, X_BAR)
    P = L @ L.T
    expected = [P[0, 0], P[1, 0], P[2, 0], P[1, 1], P[2, 1], P[2, 2]]
    np.testing.assert_allclose(Sigma, expected, atol=1e-15)
    assert (count, limit, rejected) == (0, False, False)


def test_a_singular_prior_is_rejected():
    x, _, _, _, rejected = solve(QuasiNewton(), factor=L * [1.0, 0.0, 1.0])
    np.testing.assert_array_equal(x, X_BAR)
    assert rejected


def test_the_limit_is_reported():
    *_, limit, _ = solve(QuasiNewton(max_iterations=2, cost_tolerance=0.0, step_tolerance=0.0))
    assert limit


@pytest.mark.parametrize(
    "wrong", [{"max_iterations": 0}, {"cost_tolerance": -1.0}, {"step_tolerance": np.nan}]
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(TuningError, match=next(iter(wrong))):
        QuasiNewton(**wrong)
