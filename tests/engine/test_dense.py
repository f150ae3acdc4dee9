"""Operations on matrices of many states: NumPy's results, with BLAS and with their own loops."""

import ctypes

import casadi as ca
import numpy as np
import pytest
import scipy

from backsight.algebra.update import masked, noise_of
from backsight.engine import dense
from backsight.estimators.parts.covariance import plus_known
from backsight.kernels import library

N, M, K = 14, 5, 9
RNG = np.random.default_rng(0)
TALL, WIDE, OTHER = (RNG.standard_normal(shape) for shape in ((N, M), (M, K), (N, K)))
SPREAD = RNG.standard_normal((N, N + 3))
P = SPREAD @ SPREAD.T
LOWER = np.linalg.cholesky(P)


@pytest.fixture(params=["blas", "loops"], autouse=True)
def arithmetic(request):
    """The kernels with BLAS, and as they are in exported C."""
    if request.param == "loops":
        library.handle().foreign_blas((ctypes.c_void_p * len(library.BLAS))())
    yield request.param
    library._provide_blas(library.handle())


def values(*expressions: ca.MX) -> list[np.ndarray]:
    return [np.asarray(ca.evalf(e)) for e in expressions]


def constant(matrix) -> ca.MX:
    return ca.MX(ca.DM(matrix))


@pytest.mark.parametrize("turned", [(a, b) for a in (False, True) for b in (False, True)])
@pytest.mark.parametrize("columns", [1, K])
def test_products(turned, columns):
    A, B, C = TALL, WIDE[:, :columns], OTHER[:, :columns]
    a, b = (m.T if t else m for m, t in zip((A, B), turned, strict=True))
    given = [constant(m) for m in (C, a, b)]
    alone, more, less = values(
        dense.product_of(*given[1:], turned=turned),
        dense.plus_product(*given, turned=turned),
        dense.plus_product(*given, turned=turned, minus=True),
    )
    for found, wanted in ((alone, A @ B), (more, C + A @ B), (less, C - A @ B)):
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)
    row = values(dense.product_of(constant(A[:1]), constant(B)))[0]
    np.testing.assert_allclose(row, A[:1] @ B, rtol=1e-13, atol=1e-13)


def test_factors():
    square = constant(SPREAD)
    found = values(dense.cholesky_of(constant(P)), dense.compressed(square))
    for factor in found:
        np.testing.assert_allclose(factor, LOWER, rtol=1e-11, atol=1e-11)
    v = 0.9 * SPREAD[:, 0]
    smaller, definite = values(*dense.downdated(constant(LOWER), constant(v)))
    np.testing.assert_allclose(smaller @ smaller.T, P - np.outer(v, v), rtol=1e-10, atol=1e-10)
    assert definite == 1
    assert values(dense.downdated(constant(LOWER), constant(9 * v))[1])[0] == 0


def test_a_singular_factor_has_columns_of_zeros():
    flat = TALL @ TALL.T
    (L,) = values(dense.cholesky_of(constant(flat)))
    np.testing.assert_allclose(L @ L.T, flat, atol=1e-12)
    assert not L[:, M:].any()
    (X,) = values(dense.solve_triangular(constant(L), constant(OTHER), turned=True))
    assert not X[M:].any()
    np.testing.assert_allclose((L.T @ X)[:M], OTHER[:M], atol=1e-10)


def test_solutions():
    found = values(
        dense.solve_triangular(constant(LOWER), constant(OTHER)),
        dense.solve_triangular(constant(LOWER), constant(OTHER), turned=True),
    )
    for x, trans in zip(found, (0, 1), strict=True):
        wanted = scipy.linalg.solve_triangular(LOWER, OTHER, lower=True, trans=trans)
        np.testing.assert_allclose(x, wanted, rtol=1e-10, atol=1e-10)


def test_turned_and_packed():
    square = SPREAD[:, :N]
    turned, half, packed, again = values(
        dense.transpose(constant(SPREAD)),
        dense.symmetrise(constant(square)),
        dense.triangle(constant(P), np.arange(1.0, N + 1)),
        dense.triangle(dense.triangle(constant(P)), np.arange(1.0, N + 1)),
    )
    assert np.array_equal(turned, SPREAD.T)
    assert np.array_equal(half, (square + square.T) / 2)
    scaled = P * np.outer(np.arange(1.0, N + 1), np.arange(1.0, N + 1))
    wanted = np.concatenate([scaled[j:, j] for j in range(N)])
    for column in (packed, again):
        np.testing.assert_allclose(column[:, 0], wanted, rtol=1e-14)
    A = ca.MX.sym("A", N, N)
    half = dense.symmetrise(A)
    assert dense.symmetrise(half).__hash__() == half.__hash__()
    twice = dense.triangle(dense.triangle(A), np.arange(1.0, N + 1))
    once = dense.triangle(A, np.arange(1.0, N + 1))
    lengths = [ca.Function("f", [A], [value]).n_nodes() for value in (twice, once)]
    assert lengths[0] == lengths[1]


def test_the_gain_is_that_of_the_measured_rows():
    H, mask = TALL.T, np.array([1.0, 0.0, 0.5, 2.0, 0.0])
    R = WIDE @ WIDE.T
    PHt = P @ H.T
    K_, S, N_ = values(*dense.gain_of(*map(constant, (PHt, H @ PHt, R, mask))))
    seen = mask > 0
    noise = np.array(ca.evalf(noise_of(ca.DM(R), ca.DM(mask))))
    np.testing.assert_allclose(N_, noise, rtol=1e-13)
    np.testing.assert_allclose(S, H @ P @ H.T + noise, rtol=1e-12)
    part = np.ix_(seen, seen)
    gain = PHt[:, seen] @ np.linalg.inv((H @ P @ H.T + noise)[part])
    np.testing.assert_allclose(K_[:, seen], gain, rtol=1e-9, atol=1e-10)
    assert not K_[:, ~seen].any()
    Hm, _, Rm = (
        np.array(ca.evalf(m)) for m in masked(ca.DM(H), ca.DM.zeros(M), ca.DM(R), ca.DM(mask))
    )
    weighed = P @ Hm.T @ np.linalg.inv(Hm @ P @ Hm.T + Rm) @ np.diag(mask)
    np.testing.assert_allclose(K_, weighed, rtol=1e-9, atol=1e-10)
    after, again, _, _ = values(*dense.corrected_of(*map(constant, (P, PHt, H @ PHt, R, mask))))
    np.testing.assert_array_equal(again, K_)
    assert np.array_equal(after, after.T)
    left = np.eye(N) - K_ @ H
    joseph = left @ P @ left.T + K_ @ N_ @ K_.T
    np.testing.assert_allclose(after, joseph, rtol=0, atol=1e-12 * P.max())


@pytest.mark.parametrize("n", [5, 60], ids=["by products", "by a factor"])
@pytest.mark.parametrize("known", [False, True], ids=["", "a state is known"])
def test_a_congruence_is_symmetric_and_positive(n, known):
    """A state that is known leaves no factor, and the product is that of the whole matrices."""
    A, root, Q = RNG.standard_normal((n, n)), RNG.standard_normal((n, n)), np.eye(n)
    root[2] *= not known
    spread = root @ root.T
    (found,) = values(dense.congruence_of(*map(constant, (A, spread, Q))))
    assert np.array_equal(found, found.T)
    np.testing.assert_allclose(found, A @ spread @ A.T + Q, rtol=0, atol=1e-12 * found.max())


@pytest.mark.parametrize("share", [0.1, 1.0], ids=["few", "dense"])
@pytest.mark.parametrize("inner", [dense.NARROW, K])
@pytest.mark.parametrize("turned", [False, True])
def test_products_with_a_matrix_of_some_entries(share, inner, turned):
    """Run over the entries, by BLAS, or, where few numbers are summed, by loops: all the same."""
    A, C = OTHER[:, :inner], TALL
    F = np.where(RNG.random((inner, M)) < share, RNG.standard_normal((inner, M)), 0.0)
    F[0, 0] = 1.0
    given = ca.MX(ca.sparsify(ca.DM(F.T if turned else F)))
    (found,) = values(dense.add_product(constant(C), constant(A), given, turned=turned))
    np.testing.assert_allclose(found, C + A @ F, rtol=1e-13, atol=1e-13)
    x, y = A[0], TALL[0]
    across, along = values(
        dense.applied(given, constant(y), turned=turned),
        dense.applied(given, constant(x), turned=not turned),
    )
    np.testing.assert_allclose(across.ravel(), F @ y, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(along.ravel(), F.T @ x, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(values(dense.all_entries(given))[0], F.T if turned else F)


@pytest.mark.parametrize("Q", [np.diag(np.arange(N) % 3 - 1.0), P], ids=["diagonal", "full"])
def test_a_known_matrix_is_added(Q):
    A = ca.MX.sym("A", N, N)
    added = ca.Function("added", [A], [plus_known(A, ca.sparsify(ca.DM(Q)))])
    np.testing.assert_array_equal(np.array(added(P)), P + Q)
