"""The constrained estimator against a dense quadratic program."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, linprog, minimize

from backsight.errors import TuningError
from backsight.estimators.linear_windows import LinearMHE
from backsight.estimators.parts.limits import Limit
from backsight.estimators.uncertainty import Noise, Prior
from backsight.schema import Status
from relations.linear import DT, P0, X0, A, B, C, Q, R, Run, model, record

Q_FULL = Q + 2e-3 * np.eye(3)
LIMITS = (
    Limit("sum", {"a": 1.0, "b": 0.5}, upper=0.8),
    Limit("residual", {"z": 1.0}, lower=-0.25, upper=0.25, of="residual"),
    Limit("push", {"b": 1.0}, lower=-0.03, of="noise"),
)
BOUNDS = ((-1.0, 0.9), (-np.inf, np.inf), (-0.5, 1.5))


def quadratic_program(y, u, *, x_bar=None, P=None):
    """Last state of a window by SLSQP over all its states; NaN rows are left out."""
    n, nx = len(y), 3

    def at(i, block):
        row = np.zeros((len(block), n * nx))
        row[:, i * nx : (i + 1) * nx] = block
        return row

    inverse, square = np.linalg.inv, np.linalg.cholesky
    rows, values, limits = [], [], []
    if x_bar is not None:
        rows.append(inverse(square(P)) @ at(0, np.eye(nx)))
        values.append(inverse(square(P)) @ x_bar)
    for i in range(n):
        seen = np.isfinite(y[i])
        white = inverse(square(R[np.ix_(seen, seen)])) if seen.any() else np.zeros((0, 0))
        rows.append(white @ at(i, C[seen]))
        values.append(white @ y[i][seen])
        limits.append((at(i, np.eye(3)[[0]]), *BOUNDS[0]))
        limits.append((at(i, np.eye(3)[[2]]), *BOUNDS[2]))
        limits.append((at(i, np.array([[1.0, 0.5, 0.0]])), -np.inf, 0.8))
        if seen[1]:
            limits.append((at(i, C[[1]]), y[i, 1] - 0.25, y[i, 1] + 0.25))
        if i + 1 < n:
            noise = at(i + 1, np.eye(nx)) - at(i, A)
            rows.append(inverse(square(Q_FULL)) @ noise)
            values.append(inverse(square(Q_FULL)) @ B @ u[i])
            limits.append((noise[[1]], B[1] @ u[i] - 0.03, np.inf))
    J, r = np.vstack(rows), np.concatenate(values)
    start = np.linalg.lstsq(J, r, rcond=None)[0]
    rows_ = np.vstack([limit[0] for limit in limits])
    lower, upper = (np.concatenate([np.atleast_1d(v[i]) for v in limits]) for i in (1, 2))
    constraint = LinearConstraint(rows_, lower, upper)
    sides, ends = np.vstack([rows_, -rows_]), np.concatenate([upper, -lower])
    finite = np.isfinite(ends)
    feasible = linprog(np.zeros(n * nx), sides[finite], ends[finite], bounds=(None, None)).success
    H, g = J.T @ J, J.T @ r
    found = minimize(
        lambda v: 0.5 * v @ H @ v - g @ v, start, jac=lambda v: H @ v - g, method="SLSQP",
        constraints=constraint, options={"ftol": 1e-15, "maxiter": 500},
    )  # fmt: skip
    return found.x[-nx:], start[-nx:], feasible


@pytest.mark.parametrize(("arrival", "missing"), [(0.0, 0.0), (0.0, 0.25), (1.0, 0.25)])
def test_solution_is_that_of_the_quadratic_program(arrival, missing):
    u, y = record(22, seed=3, missing=missing)
    prior = Prior(P0=P0, x0=X0)
    estimator = LinearMHE(Noise(R=R, Q=Q_FULL), prior, N=5, arrival_weight=arrival, limits=LIMITS)
    result = Run(estimator, model(BOUNDS), DT)(u, y)
    free = Run(dataclasses.replace(estimator, limits=()), model(), DT)(u, y)
    kalman = Run(LinearMHE(Noise(R=R, Q=Q_FULL), prior, N=30), model(), DT)(u, y)
    bound = 0
    for k in range(22):
        if k < 5:
            settings = {"x_bar": X0, "P": P0}
        elif arrival:
            before = k - 6
            ahead = {
                "x_bar": A @ kalman["x_hat"][before] + B @ u[before],
                "P": A @ kalman["P"][before] @ A.T + Q_FULL,
            }
            settings = ahead if k > 5 else {"x_bar": X0, "P": P0}
        else:
            settings = {}
        first = max(k - 5, 0)
        x, unlimited, feasible = quadratic_program(y[first : k + 1], u[first : k + 1], **settings)
        np.testing.assert_allclose(free["x_hat"][k], unlimited, rtol=1e-7, atol=1e-8)
        infeasible = bool(int(result["status"][k]) & int(Status.INFEASIBLE))
        assert infeasible == (not feasible)
        if feasible:
            np.testing.assert_allclose(result["x_hat"][k], x, rtol=0, atol=3e-6)
            bound += np.abs(x - unlimited).max() > 1e-3
    assert bound > 5


def test_inactive_limits_change_nothing():
    u, y = record(30, seed=4, missing=0.2)
    estimator = LinearMHE(Noise(R=R, Q=Q), Prior(P0=P0, x0=X0), N=6)
    wide = (
        Limit("wide", {"a": 1.0, "c": -2.0}, -1e3, 1e3),
        Limit("w", {"a": 1.0}, -50, 50, "noise"),
    )
    limited = dataclasses.replace(estimator, limits=wide)
    free = Run(estimator, model(), DT)(u, y)
    result = Run(limited, model(((-100, 100),) * 3), DT)(u, y)
    for name in ("x_hat", "P", "e", "S", "status"):
        np.testing.assert_allclose(result[name], free[name], rtol=1e-9, atol=1e-12)


def test_scales_are_irrelevant():
    u, y = record(20, seed=3, missing=0.1)
    estimator = LinearMHE(Noise(R=R, Q=Q_FULL), Prior(P0=P0, x0=X0), N=5, limits=LIMITS)
    plain = model(BOUNDS)
    scaled = [
        dataclasses.replace(s, scale=c) for s, c in zip(plain.states, (1e-3, 50, 7), strict=True)
    ]
    odd = dataclasses.replace(plain, states=tuple(scaled))
    expected, result = Run(estimator, plain, DT)(u, y), Run(estimator, odd, DT)(u, y)
    for name in ("x_hat", "P", "status", "infeasible"):
        np.testing.assert_allclose(result[name], expected[name], rtol=1e-7, atol=1e-9)
    assert expected["status"].any()


def test_active_bound_is_met_and_reported():
    u, y = record(30, seed=5, missing=0.0)
    estimator = LinearMHE(Noise(R=R), Prior(P0=P0, x0=X0), N=6)
    anything = (-np.inf, np.inf)
    result = Run(estimator, model((anything, (-np.inf, 0.5), anything)), DT)(u, y)
    b = result["x_hat"][:, 1]
    assert b.max() == pytest.approx(0.5, abs=1e-12)
    clipped = (result["status"].astype(int) & int(Status.CLIPPED)) != 0
    np.testing.assert_array_equal(clipped, np.abs(b - 0.5) < 1e-9)
    assert 3 < clipped.sum() < 30
    free = Run(estimator, model(), DT)(u, y)["P"]
    np.testing.assert_allclose(result["P"], free, rtol=1e-9)


def test_equation_is_known_in_the_covariance():
    """A limit whose ends are the same counts as a measurement without noise, at every sample."""
    u, y = record(12, seed=5, missing=0.1)
    estimator = LinearMHE(Noise(R=R, Q=Q_FULL), Prior(P0=P0, x0=X0), N=12)
    a = np.array([1.0, -0.5, 0.0])
    tied = Limit("tied", {"a": 1.0, "b": -0.5}, 0.2, 0.2)
    result = Run(dataclasses.replace(estimator, limits=(tied,)), model(), DT)(u, y)
    x, P = X0, P0
    for k in range(12):
        seen = np.isfinite(y[k])
        rows, values = np.vstack([a, C[seen]]), np.append(0.2, y[k][seen])
        noise = np.zeros((len(rows), len(rows)))
        noise[1:, 1:] = R[np.ix_(seen, seen)]
        K = P @ rows.T @ np.linalg.inv(rows @ P @ rows.T + noise)
        x, P = x + K @ (values - rows @ x), P - K @ rows @ P
        np.testing.assert_allclose(result["x_hat"][k], x, atol=1e-10)
        np.testing.assert_allclose(result["P"][k], P, atol=1e-10)
        x, P = A @ x + B @ u[k], A @ P @ A.T + Q_FULL


def test_contradiction_is_named_and_leaves_the_estimate():
    u, y = record(14, seed=6, missing=0.0)
    estimator = LinearMHE(Noise(R=R, Q=Q_FULL), Prior(P0=P0, x0=X0), N=4)
    limits = (
        Limit("at least", {"a": 1.0, "b": 1.0}, lower=5.0),
        Limit("elsewhere", {"c": 1.0}, upper=50.0),
        Limit("at most", {"a": 2.0, "b": 2.0}, upper=1.0),
    )
    limited = dataclasses.replace(estimator, limits=limits)
    free, result = (Run(e, model(), DT)(u, y) for e in (estimator, limited))
    assert np.all(result["status"] == int(Status.INFEASIBLE))
    np.testing.assert_array_equal(result["infeasible"], np.tile([1, 0, 1], (14, 1)))
    np.testing.assert_allclose(result["x_hat"], free["x_hat"], rtol=1e-9)


def test_wrong_limits():
    with pytest.raises(TuningError, match="limit 'x' is contradictory: 2 to 1"):
        Limit("x", {"a": 1.0}, 2, 1)
    with pytest.raises(TuningError, match=r"unknown of 'states'.*state"):
        Limit("x", {"a": 1.0}, of="states")
    for weights in ({}, {"a": 0.0}):
        with pytest.raises(TuningError, match="'none' has no weight"):
            Limit("none", weights, 0.0)
    with pytest.raises(TuningError, match=r"limit 'x' names 'q'"):
        LinearMHE(Noise(R=R), Prior(1.0), limits=(Limit("x", {"q": 1.0}),)).compile(model(), DT)
