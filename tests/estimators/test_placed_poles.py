"""Gains of observers of many states, by a Sylvester equation."""

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.estimators.kalman import _placed_poles
from backsight.estimators.kalman._placed_poles import placed_gain
from backsight.estimators.parts.linear import linear
from relations.linear import Run

NX, NY = 16, 5
RNG = np.random.default_rng(3)
STABLE = RNG.standard_normal((NX, NX)) / 5
SEEN = RNG.standard_normal((NY, NX))
CHAIN = np.kron(np.eye(NX // 2), [[1.0, 0.1], [0.0, 1.0]])
"""Free bodies: every eigenvalue is 1, and there is half a set of eigenvectors."""
REAL = tuple(np.linspace(0.3, 0.8, NX))
MIXED = (0.4 + 0.3j, 0.4 - 0.3j, 0.2 + 0.5j, 0.2 - 0.5j, *np.linspace(0.1, 0.7, NX - 4))
TWICE = (0.5,) * NY + (0.2 + 0.4j, 0.2 - 0.4j) * 2 + tuple(np.linspace(-0.3, 0.3, NX - NY - 4))


@pytest.mark.parametrize("poles", [REAL, MIXED, TWICE], ids=["real", "mixed", "repeated"])
@pytest.mark.parametrize("A", [STABLE, CHAIN], ids=["simple", "defective"])
def test_places_them(A, poles):
    C = SEEN if A is STABLE else RNG.standard_normal((NX // 2, NX))
    L = placed_gain(A, C, poles)
    found = np.linalg.eigvals(A - L @ C)
    assert np.abs(found[:, None] - np.array(poles)).min(axis=0).max() < 1e-6
    assert np.prod(found).real == pytest.approx(np.prod(poles).real, rel=1e-5)


def test_the_slope_is_that_of_the_cost():
    poles = np.array(sorted(p for p in REAL[:6])) + 0j
    poles = np.concatenate([poles, [0.3 + 0.2j, 0.1 + 0.4j]])
    n = 10
    values, V = np.linalg.eig(STABLE[:n, :n].T)
    B, weights = np.linalg.solve(V, SEEN[:, :n].T), 1 / (values[:, None] - poles)
    equation = _placed_poles._Equation(V, B.astype(complex), weights.astype(complex), 6)
    G, to = (RNG.standard_normal((NY, n)) for _ in range(2))
    ahead, behind = (equation.cost(G + h * to)[0] for h in (1e-6, -1e-6))
    assert (ahead - behind) / 2e-6 == pytest.approx(to.ravel() @ equation.cost(G)[1], rel=1e-5)


def test_descent_makes_the_eigenvectors_more_independent(monkeypatch):
    def condition():
        L = placed_gain(STABLE, SEEN, REAL)
        return np.linalg.cond(np.linalg.eig(STABLE - L @ SEEN)[1])

    good = condition()
    monkeypatch.setattr(_placed_poles, "STEPS", (0, 0))
    assert good < condition() / 10


def test_poles_of_the_model_may_stay_where_they_are():
    own = np.linalg.eigvals(STABLE)
    poles = (*own[:6], *np.linspace(-0.5, 0.5, NX - 6)) if own[5] == own[4].conj() else tuple(own)
    L = placed_gain(STABLE, SEEN, tuple(complex(p) for p in poles))
    found = np.linalg.eigvals(STABLE - L @ SEEN)
    assert np.abs(found[:, None] - np.array(poles)).min(axis=0).max() < 1e-6


def test_what_the_arithmetic_cannot_do_is_refused():
    with pytest.raises(TuningError, match=r"poles cannot be placed: .* spread the poles"):
        placed_gain(
            np.diag(np.linspace(0.9, 0.99, 40)), np.ones((1, 40)), tuple(np.linspace(0, 0.5, 40))
        )


@pytest.mark.parametrize("form", ["filtering", "prediction"])
def test_recursion_of_many_states(form):
    """Written out, with samples that are missing; the covariance is that of the error."""
    rng = np.random.default_rng(1)
    plant = bs.modal(
        np.linspace(2, 20, 7), damping=0.02, inputs={"u": np.ones(7)},
        sensors={f"y{i}": ("displacement", rng.standard_normal(7)) for i in range(4)},
    )  # fmt: skip
    dt, n = 0.01, 12
    noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-3), bs.Prior(sigma_x0=0.1)
    observer = bs.Luenberger(noise, prior, poles=tuple(np.linspace(0.5, 0.9, 14)), form=form)
    u, y = rng.standard_normal((n, 1)), 1e-2 * rng.standard_normal((n, 4))
    y[rng.random(y.shape) < 0.3] = np.nan
    result = Run(observer, plant, dt)(u, y)
    gain = observer.observer(plant, dt).gain
    kf = linear(plant, dt, noise=noise, prior=prior, hold="zoh")
    s = kf.s
    A, B, C, Q, P = (
        s.sx[:, None] * kf.A / s.sx, s.sx[:, None] * kf.B / s.su, s.sy[:, None] * kf.C / s.sx,
        s.Q * np.outer(s.sx, s.sx), s.P0 * np.outer(s.sx, s.sx),
    )  # fmt: skip
    x, R = np.zeros(14), 1e-6 * np.eye(4)
    for k in range(n):
        e, K = np.nan_to_num(y[k] - C @ x), gain * np.isfinite(y[k])
        np.testing.assert_allclose(result["e"][k], e, rtol=1e-7, atol=1e-10)
        np.testing.assert_allclose(result["S"][k], C @ P @ C.T + R, rtol=1e-7, atol=1e-12)
        if form == "filtering":
            x, P = x + K @ e, (np.eye(14) - K @ C) @ P @ (np.eye(14) - K @ C).T + K @ R @ K.T
        np.testing.assert_allclose(result["x_hat"][k], x, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(result["P"][k], P, rtol=1e-7, atol=1e-9 * P.max())
        if form == "filtering":
            x, P = A @ x + B @ u[k], A @ P @ A.T + Q
        else:
            x = A @ x + B @ u[k] + K @ e
            P = (A - K @ C) @ P @ (A - K @ C).T + K @ R @ K.T + Q
