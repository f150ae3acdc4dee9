"""The bounded Gauss-Newton method on a small nonlinear fit, against scipy.optimize."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import least_squares

from backsight.algebra.symmetric import vech
from backsight.errors import TuningError
from backsight.solvers.box import _box as box
from backsight.solvers.box.gauss_newton import GaussNewton, minimise

TIMES = np.linspace(0.0, 2.0, 9)
FREE = (np.full(3, -np.inf), np.full(3, np.inf))
X_BAR = np.array([1.2, 0.7, 0.1])
P = np.array([[0.5, 0.1, 0.0], [0.1, 0.4, 0.05], [0.0, 0.05, 0.3]])
DATA = 2.0 * np.exp(-1.5 * TIMES) + 0.4 + 0.02 * np.cos(7 * TIMES)
PRECISE = GaussNewton(max_iterations=60, tolerance=1e-10)
STATES = ("x", "Sigma", "iterations", "limit", "rejected")


def decay() -> ca.Function:
    """Residuals of a exp(-b t) + c against the data, standard deviation 0.05."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", len(TIMES))
    e = (y - (x[0] * ca.exp(-x[1] * ca.DM(TIMES)) + x[2])) / 0.05
    J = -ca.jacobian(e, x)
    return ca.Function("decay", [x, y], [ca.sumsqr(e) / 2, J.T @ e, vech(J.T @ J)])


def solve(method: GaussNewton, bounds=FREE, *, covariance=P, y=DATA, x_bar=X_BAR, run=1) -> dict:
    L = np.linalg.cholesky(covariance + 1e-300 * np.eye(3))
    function = minimise(decay(), method, lower=bounds[0], upper=bounds[1], cost_unit=1.0)
    values = map(np.asarray, function(run, x_bar, L, y))
    result = dict(zip(STATES, values, strict=True))
    packed = result["Sigma"][:, 0]
    Sigma = np.zeros((3, 3))
    Sigma[np.triu_indices(3)] = packed
    result["Sigma"] = Sigma + np.triu(Sigma, 1).T
    return {k: v[:, 0] if v.shape == (3, 1) else v for k, v in result.items()}


def by_scipy(bounds=FREE, *, y=DATA):
    root = np.linalg.inv(np.linalg.cholesky(P))

    def residuals(x):
        return np.concatenate(
            [(x[0] * np.exp(-x[1] * TIMES) + x[2] - y) / 0.05, root @ (x - X_BAR)]
        )

    start = np.clip(X_BAR, bounds[0] + 1e-3, bounds[1] - 1e-3)
    return least_squares(
        residuals, start, "cs", bounds, ftol=1e-15, xtol=1e-15, gtol=1e-15, x_scale="jac"
    )


def test_free_minimum():
    result, reference = solve(PRECISE), by_scipy()
    np.testing.assert_allclose(result["x"], reference.x, atol=1e-7)
    expected = np.linalg.inv(reference.jac.T @ reference.jac)
    np.testing.assert_allclose(result["Sigma"], expected, rtol=1e-5)
    assert not result["limit"]
    assert not result["rejected"]


@pytest.mark.parametrize(
    "bounds",
    [
        ([-np.inf, -np.inf, -np.inf], [1.9, np.inf, np.inf]),
        ([-np.inf, 1.7, -np.inf], [np.inf, np.inf, 0.2]),
        ([0.0, 0.0, 0.0], [1.3, 0.9, 0.15]),
        ([-5.0, 0.0, -1.0], [5.0, 9.0, 1.0]),
    ],
)
def test_minimum_within_bounds(bounds):
    low, high = map(np.array, bounds)
    result, reference = solve(PRECISE, (low, high)), by_scipy((low, high))
    np.testing.assert_allclose(result["x"], reference.x, atol=1e-6)
    assert np.all((result["x"] >= low) & (result["x"] <= high))
    on = (np.abs(result["x"] - low) < 1e-9) | (np.abs(result["x"] - high) < 1e-9)
    np.testing.assert_allclose(result["Sigma"][on], 0.0, atol=1e-12)
    if not on.all():
        H = reference.jac.T @ reference.jac
        free = np.linalg.inv(H[np.ix_(~on, ~on)])
        np.testing.assert_allclose(result["Sigma"][np.ix_(~on, ~on)], free, rtol=1e-4)


def test_start_is_returned_unless_run():
    result = solve(PRECISE, run=0)
    np.testing.assert_array_equal(result["x"], X_BAR)
    np.testing.assert_allclose(result["Sigma"], P, rtol=1e-13, atol=1e-16)
    assert result["iterations"] == 0
    assert not result["limit"]


def test_far_start_needs_shorter_steps():
    """The classic on which full steps overshoot further and further: arctan from beyond 1.39."""
    x, unused = ca.SX.sym("x"), ca.SX.sym("unused")
    e, slope = -1e3 * ca.atan(x), 1e3 / (1 + x**2)
    arctan = ca.Function("arctan", [x, unused], [e**2 / 2, slope * e, slope**2])
    free = {"lower": FREE[0][:1], "upper": FREE[1][:1], "cost_unit": 1.0}
    solver = minimise(arctan, PRECISE, **free)
    end, _, iterations, limit, rejected = map(float, solver(1, 3.0, 1e8, 0))
    assert abs(end) < 1e-6
    assert iterations < 10
    assert not limit
    assert not rejected


def test_limit_is_reported():
    result = solve(GaussNewton(max_iterations=2, tolerance=1e-12))
    assert result["limit"]
    assert result["iterations"] == 2


def test_bounds_that_could_not_be_sorted_out_are_reported(monkeypatch):
    bounds = (np.array([1.0, 0.0, 0.45]), np.array([1.7, 1.2, 0.6]))
    assert not solve(PRECISE, bounds)["limit"]
    monkeypatch.setattr(box, "BLOCK_PASSES", 1)
    monkeypatch.setattr(box, "SINGLE_PASSES", 0)
    assert solve(PRECISE, bounds)["limit"]


def test_zero_tolerance_makes_exactly_so_many_iterations():
    result = solve(GaussNewton(max_iterations=7, tolerance=0.0))
    assert result["iterations"] == 7
    assert not result["limit"]
    np.testing.assert_allclose(result["x"], by_scipy().x, atol=1e-6)


def test_rule_of_general_optimisers_ends_early():
    strict = solve(PRECISE)["iterations"]
    loose = solve(GaussNewton(60, 1e-10, cost_tolerance=0.5))
    assert 1 < loose["iterations"] < strict
    assert not loose["limit"]
    moved = solve(GaussNewton(60, 1e-10, step_tolerance=0.05))
    assert 1 < moved["iterations"] < strict


def test_hopeless_cost_is_rejected():
    """Data that are not finite: the start comes back, and the caller is told."""
    result = solve(PRECISE, y=np.full(len(TIMES), np.nan))
    assert result["rejected"]
    np.testing.assert_array_equal(result["x"], X_BAR)


def test_known_direction_does_not_move():
    """A prior without variance in one entry: the fit of the others given this one."""
    covariance = np.diag([0.5, 0.0, 0.3])
    L = np.sqrt(covariance)
    function = minimise(decay(), PRECISE, lower=FREE[0], upper=FREE[1], cost_unit=1.0)
    x, Sigma, *_ = (np.asarray(v)[:, 0] for v in function(1, X_BAR, L, DATA))
    assert x[1] == X_BAR[1]
    fit = np.column_stack([np.exp(-X_BAR[1] * TIMES), np.ones(len(TIMES))]) / 0.05
    H = fit.T @ fit + np.diag(1 / np.array([0.5, 0.3]))
    g = fit.T @ DATA / 0.05 + X_BAR[[0, 2]] / [0.5, 0.3]
    np.testing.assert_allclose(x[[0, 2]], np.linalg.solve(H, g), rtol=1e-9)
    np.testing.assert_allclose(Sigma[[0, 2, 5]], np.linalg.inv(H)[[0, 0, 1], [0, 1, 1]], rtol=1e-9)
    np.testing.assert_array_equal(Sigma[[1, 3, 4]], 0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"max_iterations": 0}, "max_iterations is 0"), ({"tolerance": -1.0}, "tolerance is -1")],
)
def test_wrong_settings_are_refused(arguments, message):
    with pytest.raises(TuningError, match=message):
        GaussNewton(**arguments)
