"""Lower triangles: round trips, and agreement with the way results are unpacked."""

import casadi as ca
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from backsight.algebra.symmetric import side, unvech, vech
from backsight.engine.recursion import Channel

sizes, seeds = st.integers(1, 9), st.integers(0, 2**32 - 1)


def value(expression: ca.SX) -> np.ndarray:
    return np.asarray(ca.evalf(ca.densify(expression)))


@given(sizes, seeds)
def test_round_trip(n, seed):
    v = np.random.default_rng(seed).standard_normal(n * (n + 1) // 2)
    A = value(unvech(ca.SX(v)))
    np.testing.assert_array_equal(A, A.T)
    np.testing.assert_array_equal(value(vech(ca.SX(A)))[:, 0], v)
    assert side(len(v)) == n


@given(sizes, seeds)
def test_only_the_lower_triangle_counts(n, seed):
    A = np.random.default_rng(seed).standard_normal((n, n))
    B = value(unvech(vech(ca.SX(A))))
    np.testing.assert_array_equal(np.tril(B), np.tril(A))


@given(sizes, seeds)
def test_channels_unpack_what_vech_packed(n, seed):
    rng = np.random.default_rng(seed)
    matrices = rng.standard_normal((3, n, n))
    matrices = matrices + matrices.transpose(0, 2, 1)
    rows = np.array([value(vech(ca.SX(A)))[:, 0] for A in matrices])
    unpacked = Channel("P", ("state", "state_"), symmetric=True).unpack(rows)
    np.testing.assert_array_equal(unpacked, matrices)
