"""Expressions that have a limit at zero, which operations they are made of, and small factors."""

import casadi as ca
import numpy as np
import pytest

from backsight.algebra._limits import hypotenuse, quotient, root_of
from backsight.algebra.bounds import clip
from backsight.algebra.degree import degrees
from backsight.algebra.factor import cholesky_semidefinite, smallest_pivot
from backsight.algebra.kinks import kinked
from backsight.algebra.newton import held
from backsight.algebra.sigma import factor, sigma_points, weights
from backsight.algebra.triangular import backward_semidefinite, compress, downdate, forward

X = ca.SX.sym("x")
Y = ca.SX.sym("y")


def values(expression, at, *, orders=1):
    """Value and derivatives by x of an expression at a point."""
    rows = [expression]
    for _ in range(orders - 1):
        rows.append(ca.jacobian(rows[-1], X))
    return np.array(ca.Function("f", [X, Y], [ca.vertcat(*rows)])(at, 0.0)).ravel()


@pytest.mark.parametrize(
    "inside",
    [X**2, X**2 + Y**2, 2 * (X**2), X**2 + X**2, 3 * X**2, X**2 * 3, 3 * (X**2 + 2 * Y**2)],
)
def test_the_root_of_squares_has_no_slope_at_zero(inside):
    root = root_of(inside)
    assert values(root, 0.0, orders=2) == pytest.approx([0.0, 0.0])
    plain = values(ca.sqrt(inside), 0.7, orders=3)
    assert values(root, 0.7, orders=3) == pytest.approx(plain, rel=1e-14)


@pytest.mark.parametrize(
    "inside", [X, -3 * X**2, X**2 - Y**2, X**3, X * Y, X**2 + X, X * X**2, -(X**2)]
)
def test_other_roots_are_left_alone(inside):
    assert ca.is_equal(root_of(inside), ca.sqrt(inside), 9)


def test_a_hypotenuse_has_no_slope_at_zero():
    assert values(hypotenuse(X, Y), 0.0, orders=2) == pytest.approx([0.0, 0.0])
    assert values(hypotenuse(X, Y), -0.3, orders=2) == pytest.approx([0.3, -1.0])
    at = ca.Function("h", [X, Y], [hypotenuse(X, Y)])
    assert float(at(0.0, 0.4)) == pytest.approx(0.4)
    assert float(at(0.3, 0.4)) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("above", "expected"),
    [
        (ca.sin(X), [1.0, 0.0, -1 / 3]),
        (ca.exp(X) - 1, [1.0, 1 / 2, 1 / 3]),
        (1 - ca.cos(X), [0.0, 1 / 2, 0.0]),
        (X**3 + 5 * X, [5.0, 0.0, 2.0]),
    ],
)
def test_a_quotient_of_two_zeros_is_its_limit(above, expected):
    found = quotient(above, X)
    assert values(found, 0.0, orders=3) == pytest.approx(expected, abs=1e-14)
    assert values(found, 0.2, orders=2) == pytest.approx(values(above / X, 0.2, orders=2))


@pytest.mark.parametrize(
    ("above", "below"), [(Y, X), (X + 1, X), (ca.sqrt(X), X), (ca.sin(X), 2 * X), (X, Y)]
)
def test_other_quotients_are_left_alone(above, below):
    assert ca.is_equal(quotient(above, below), above / below, 9)


def test_elements_are_set_to_their_bounds():
    found = clip(ca.SX([-2.0, 5.0, 3.0, -7.0]), [-1, -np.inf, 0, -np.inf], [1, 4, 9, np.inf])
    np.testing.assert_array_equal(np.array(ca.DM(found)).ravel(), [-1.0, 4.0, 3.0, -7.0])


@pytest.mark.parametrize(
    ("row", "degree"),
    [
        (Y**2, 0), (X, 1), (3 * X - Y, 1), (-X + Y, 1), (X * Y, 1), (X * X, 2), (X / Y, 1),
        (Y / X, 2), (ca.sin(X), 2), (ca.sin(Y), 0), (X * Y * X, 2), (2 * X * X * X, 2),
        (ca.if_else(Y > 0, X, 0), 1), (ca.if_else(X > 0, Y, 0), 2), (ca.floor(X), 2),
    ],
)  # fmt: skip
def test_degrees_are_those_of_operations(row, degree):
    assert degrees(ca.Function("f", [X, Y], [ca.vertcat(row, X, 1)])) == [degree, 1, 0]


@pytest.mark.parametrize(
    ("row", "bent"),
    [
        (ca.fabs(X), True), (ca.fabs(Y), False), (X**2, False), (ca.fmax(Y, 0) * X, False),
        (ca.fmin(X, Y), True), (ca.if_else(Y > 0, X, 0), True), (ca.sign(Y) + ca.sin(X), False),
        (ca.fmax(3.0, Y) + ca.if_else(X == 0, 1, 2), True),
    ],
)  # fmt: skip
def test_kinks_are_found_where_they_depend_on_the_first_argument(row, bent):
    assert kinked(ca.Function("f", [X, Y], [row])) == bent


@pytest.mark.parametrize("value", [1.0, -3.7, 1e-9, 123456.789, 1 / 3])
def test_a_held_number_has_its_leading_digits_and_no_slope(value):
    found = values(held(X), value, orders=2)
    assert found[0] == pytest.approx(value, rel=2.0**-30)
    assert found[1] == 0.0
    digits = np.frexp(found[0])[0] * 2.0**31
    assert digits == pytest.approx(round(digits), abs=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_the_smallest_pivot_is_that_of_ldl(seed):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((4, 4))
    for A in (root @ root.T, root + root.T):
        work, found = A.copy(), []
        for k in range(4):
            found.append(work[0, 0] / abs(A[k, k]))
            work = work[1:, 1:] - np.outer(work[1:, 0], work[1:, 0]) / work[0, 0]
        assert float(ca.DM(smallest_pivot(ca.SX(A)))) == pytest.approx(min(found), rel=1e-9)
    flat = np.outer([1.0, 2.0, 0.0], [1.0, 2.0, 0.0]) + np.diag([0.0, 0.0, 3.0])
    assert float(ca.DM(smallest_pivot(ca.SX(flat)))) == pytest.approx(0.0, abs=1e-15)
    assert float(ca.DM(smallest_pivot(ca.SX(np.diag([2.0, 0.0, -3.0]))))) == -1.0


def dense(expression):
    return np.array(ca.DM(ca.densify(expression)))


@pytest.mark.parametrize("n", [1, 2, 4])
def test_triangular_factors(n):
    rng = np.random.default_rng(n)
    A, v, B = rng.standard_normal((n, n + 3)), rng.standard_normal(n), rng.standard_normal((n, 2))
    L = dense(compress(ca.SX(A)))
    np.testing.assert_allclose(L, np.linalg.cholesky(A @ A.T), atol=1e-13)
    np.testing.assert_allclose(L @ dense(forward(ca.SX(L), ca.SX(B))), B, atol=1e-12)
    np.testing.assert_allclose(L.T @ dense(backward_semidefinite(ca.SX(L), ca.SX(B))), B, atol=1e-9)
    small = 0.5 * v / np.sqrt(v @ np.linalg.solve(A @ A.T, v))
    less, definite = downdate(ca.SX(L), ca.SX(small))
    assert float(ca.DM(definite)) == 1.0
    np.testing.assert_allclose(
        dense(less) @ dense(less).T, A @ A.T - np.outer(small, small), atol=1e-12
    )
    _, definite = downdate(ca.SX(L), ca.SX(2.01 * small))
    assert float(ca.DM(definite)) == 0.0


def test_directions_without_variance_are_left_out():
    F = np.array([[1.0], [2.0], [-1.0]])
    L = dense(compress(ca.SX(F @ np.array([[1.0, 0.5]]))))
    assert L[1, 1] == pytest.approx(0.0, abs=1e-15)
    found = dense(backward_semidefinite(ca.SX(L), ca.SX([1.0, 1.0, 1.0])))
    np.testing.assert_allclose(found.ravel(), [1 / L[0, 0], 0, 0], atol=1e-12)
    whole = dense(cholesky_semidefinite(ca.SX(F @ F.T)))
    np.testing.assert_allclose(whole @ whole.T, F @ F.T, atol=1e-14)


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 2.0, 0.0), (0.1, 2.0, 1.0)])
def test_sigma_points_have_mean_and_covariance(alpha, beta, kappa):
    rng = np.random.default_rng(0)
    n, x = 3, rng.standard_normal(3)
    L = np.tril(rng.standard_normal((n, n))) + 2 * np.eye(n)
    w = weights(n, alpha=alpha, beta=beta, kappa=kappa)
    assert w.spread**2 == pytest.approx(alpha**2 * (n + kappa))
    assert w.mean.sum() == pytest.approx(1.0)
    assert w.covariance[0] - w.mean[0] == pytest.approx(1 - alpha**2 + beta)
    points = dense(sigma_points(ca.SX(x), ca.SX(L), w.spread))
    np.testing.assert_allclose(points @ w.mean, x, atol=1e-12)
    shifted = points - x[:, None] + 0.01 * np.arange(n)[:, None]
    noise = 0.3 * np.eye(n)[:, :2]
    made, definite = factor(ca.SX(shifted), w, ca.SX(noise))
    expected = (shifted * w.covariance) @ shifted.T + noise @ noise.T
    assert float(ca.DM(definite)) == 1.0
    np.testing.assert_allclose(dense(made) @ dense(made).T, expected, atol=1e-9)
