"""The language of recursions: what is written by name, and what is refused."""

import casadi as ca
import numpy as np
import pytest

from backsight.engine import native, vm
from backsight.engine.recursion import Channel
from backsight.errors import EngineError
from backsight.estimators import EKF, IEKF, UKF, Noise, Prior
from backsight.estimators.parts.covariance import Covariance, congruence, joseph_form, kalman_gain
from backsight.estimators.parts.factors import (
    cholesky,
    compress_rows,
    definite,
    downdate_factor,
    solve_definite,
)
from backsight.estimators.parts.flags import FLAGS, Flags
from backsight.estimators.parts.leaf import Symmetric, half, leaf, named_results, notation
from backsight.estimators.parts.memory import Memory
from backsight.estimators.scaled import setting
from backsight.models.lti import lti
from backsight.schema import Status

FEW, MANY = 5, 16
"""States with straight-line code, and with loops."""


def model(n: int):
    rng = np.random.default_rng(n)
    A = rng.standard_normal((n, n))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    return lti(
        A, rng.standard_normal((n, 1)), rng.standard_normal((2, n)),
        states={f"x{i}": "" for i in range(n)}, inputs={"u": ""}, outputs={"a": "", "b": ""},
        dt=1.0,
    )  # fmt: skip


def stage(n: int):
    return setting(model(n), 1.0, noise=Noise(sigma_y=0.1, sigma_w=0.1), prior=Prior(1.0))


def counter() -> tuple[Memory, list[ca.MX]]:
    return Memory(x=[1.0, 2.0], W=np.arange(6.0).reshape(2, 3), called=0), [ca.MX.sym("u")]


def test_memory_has_names_and_shapes():
    m, data = counter()
    assert m.x.shape == (2, 1)
    assert m.W.shape == (2, 3)
    after = {"W": ca.horzcat(m.W[:, 1:], m.x), "x": m.x + data[0], "called": 1}
    outputs = {"second": m.W[:, 1], "first": m.called}
    channels = (Channel("first"), Channel("second", ("state",)))
    r = m.recursion("count", data, next=after, outputs=outputs, channels=channels, dt=1.0)
    carry, (first, second) = vm.run(r, [np.ones((3, 1))], carry=r.carry0)
    assert first.ravel().tolist() == [0, 1, 1]
    assert second.tolist() == [[1, 4], [2, 5], [1, 2]]
    assert carry.tolist() == [4, 5, 1, 2, 2, 3, 3, 4, 1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"W": None}, "'W' is missing"),
        ({"y": 0}, "there is no 'y'"),
        ({"x": ca.MX.zeros(3)}, r"'x' has the shape \(3, 1\) instead of \(2, 1\)"),
        ({"W": ca.MX.zeros(3, 2)}, r"'W' has the shape \(3, 2\)"),
    ],
)
def test_wrong_memory_is_refused(change, said):
    m, data = counter()
    after = {"x": m.x, "W": m.W, "called": 1} | change
    after = {name: value for name, value in after.items() if value is not None}
    with pytest.raises(EngineError, match=said):
        m.recursion("count", data, next=after, outputs={}, channels=(), dt=1.0)


@pytest.mark.parametrize(
    ("outputs", "said"), [({}, "'first' is missing"), ({"first": 0, "b": 0}, "no channel 'b'")]
)
def test_wrong_outputs_are_refused(outputs, said):
    m, data = counter()
    same = {"x": m.x, "W": m.W, "called": 1}
    with pytest.raises(EngineError, match=said):
        m.recursion("count", data, next=same, outputs=outputs, channels=(Channel("first"),), dt=1.0)


def test_unknown_part_and_taken_name():
    m, _ = counter()
    with pytest.raises(AttributeError, match="no part 'z', but x, W, called"):
        _ = m.z
    with pytest.raises(EngineError, match="the name is taken"):
        Memory(recursion=0)


def test_every_flag_is_the_bit_with_its_name():
    for name in Flags.__dataclass_fields__:
        flags = Flags(**{name: ca.DM(1)})
        assert float(flags.status()) == Status[name.upper()]
        again = Flags.of(flags.vector())
        assert float(getattr(again, name)) == 1
    assert Flags().vector().shape == (FLAGS, 1)
    assert {n.upper() for n in Flags.__dataclass_fields__} == {
        s.name for s in Status if s not in (Status.OK, Status.NOT_FINITE)
    }


def test_leaf_knows_sizes_and_symmetry():
    s = stage(FEW)
    function = leaf(
        "f",
        {**notation(s), "gain": 1},
        lambda x_last, P, gain: {"x_next": gain * x_last, "P": gain * P @ P},
    )
    assert [function.size_in(i)[0] for i in range(3)] == [FEW, FEW * (FEW + 1) // 2, 1]
    x, P = np.arange(FEW), np.eye(FEW) + 1
    found = named_results(function, x, Covariance(FEW).kept(P), 2.0)
    np.testing.assert_array_equal(np.asarray(found["x_next"])[:, 0], 2 * x)
    triangle = np.asarray(found["P"])[:, 0]
    np.testing.assert_allclose(triangle, Covariance(FEW).kept(2 * P @ P), rtol=1e-15)


def test_leaf_refuses_names_without_size_and_results_of_another():
    with pytest.raises(EngineError, match="argument 'velocity' without a size"):
        leaf("f", {"x": 2}, lambda velocity: {"x": velocity})
    with pytest.raises(EngineError, match=r"'x_next' the shape \(3, 1\); its name says \(2, 1\)"):
        leaf("f", {"x": 2, "y": 3}, lambda y: {"x_next": y})
    with pytest.raises(EngineError, match="its name says"):
        leaf("f", {"x": 2, "P": Symmetric(3)}, lambda x: {"P": x})


def matrices(n: int):
    rng = np.random.default_rng(1)
    A, F, H = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((2, n))
    return A @ A.T + np.eye(n), F, H, np.array([[2.0, 0.5], [0.5, 1.0]])


@pytest.mark.parametrize("n", [FEW, MANY])
def test_formulas_for_few_and_many_states_are_those_of_numpy(n):
    P, F, H, R = matrices(n)
    s, kept = stage(n), Covariance(n)

    def formula(P):
        K, S = kalman_gain(P, H_ := (ca.MX if kept.whole else ca.SX)(ca.DM(H)), type(H_)(ca.DM(R)))
        return {
            "K": K,
            "S": S,
            "P_post": joseph_form(P, K, H_, type(H_)(ca.DM(R))),
            "P_next": congruence(type(H_)(ca.DM(F)), P, R[0, 0] * np.eye(n)),
            "L": cholesky(P),
            "X": solve_definite(P, P @ H_.T),
            "definite": ca.vertcat(definite(P), definite(P - 1e3 * np.eye(n))),
        }

    function = half("formulas", s, formula)
    found = {k: np.asarray(v) for k, v in named_results(function, ca.DM(kept.kept(P))).items()}
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    np.testing.assert_allclose(found["K"], K, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found["S"][:, 0], [S[0, 0], S[1, 0], S[1, 1]], rtol=1e-12)
    for name, value in (
        ("P_post", P - K @ S @ K.T),
        ("P_next", F @ P @ F.T + 2 * np.eye(n)),
    ):
        np.testing.assert_allclose(found[name][:, 0], kept.kept(value), rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(found["L"], np.linalg.cholesky(P), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found["X"], H.T, rtol=1e-8, atol=1e-8)
    assert found["definite"].ravel().tolist() == [1, 0]


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_triangular_factors(kind):
    rng = np.random.default_rng(2)
    rows, v = rng.standard_normal((MANY, 40)), 0.1 * rng.standard_normal(MANY)
    A, w = kind.sym("A", *rows.shape), kind.sym("v", MANY)
    L = compress_rows(A)
    found = ca.Function("f", [A, w], [L, *downdate_factor(L, w)])
    lower, less, exists = (np.asarray(k) for k in found(rows, v))
    np.testing.assert_array_equal(lower, np.tril(lower))
    np.testing.assert_allclose(lower @ lower.T, rows @ rows.T, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(less @ less.T, rows @ rows.T - np.outer(v, v), rtol=1e-9, atol=1e-10)
    assert exists == 1
    assert float(found(rows, 100 * v)[2]) == 0


def linear_settings(method):
    more = {} if method is UKF else {"covariance": "discrete"}
    return method(noise=Noise(sigma_y=0.1, sigma_w=0.1), prior=Prior(1.0), **more)


@pytest.mark.parametrize("method", [EKF, IEKF, UKF])
def test_large_filter_equals_the_small_formula(method):
    """The same model twice, side by side: its halves do not know each other."""
    n = 8
    part, many = model(n), 2 * n
    A, B, C = (np.asarray(m) for m in _matrices(part))
    both = lti(
        np.kron(np.eye(2), A), np.vstack([B, B]), np.kron(np.eye(2), C),
        states={f"x{i}": "" for i in range(many)}, inputs={"u": ""},
        outputs=dict.fromkeys("abcd", ""), dt=1.0,
    )  # fmt: skip
    small = linear_settings(method).compile(part, 1.0)
    large = linear_settings(method).compile(both, 1.0)
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((30, 1)), rng.standard_normal((30, 2))
    mask = (rng.random((30, 2)) > 0.2).astype(float)
    _, expected = vm.run(small, [u, y, mask], carry=small.carry0)
    twice = [u, np.hstack([y, y]), np.hstack([mask, mask])]
    _, found = native.run(large, twice, carry=large.carry0)
    for half_ in (slice(0, n), slice(n, None)):
        np.testing.assert_allclose(found[0][:, half_], expected[0], rtol=1e-10, atol=1e-11)


def _matrices(of):
    x, u = ca.SX.sym("x", of.nx), ca.SX.sym("u", of.nu)
    ahead, y = of.rhs(x, u), of.output(x, u)
    jacobians = [ca.jacobian(ahead, x), ca.jacobian(ahead, u), ca.jacobian(y, x)]
    return [ca.evalf(k).full() for k in jacobians]
