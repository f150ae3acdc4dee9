"""Bounds, poor starts and bad input of moving horizon estimation with process noise."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.errors import EstimationError, TuningError
from backsight.estimators import MHE, Limit, Noise, Prior
from backsight.estimators.arrival import NoArrival
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.estimation import solve_window
from backsight.schema import Status, recording
from backsight.solvers.box import GaussNewton
from closeness import assert_close

DT = 0.05
SIGMA_W = np.array([2e-3, 3e-2, 0.4])
SIGMA_X0 = np.array([0.1, 0.5, 3.0])
X0 = np.array([0.3, 0.0, 10.8])
SIGMA_Y = 0.02
EXACT = GaussNewton(40, tolerance=1e-9)


def f(x, u):
    """Pendulum whose ratio of gravity to length is a state."""
    return [x[1], -x[2] * np.sin(x[0]) - 0.3 * x[1] + u[0], 0.0]


def pendulum(**bounds: tuple[float, float]) -> Model:
    states = {}
    for name, value in zip(("q", "v", "g"), X0, strict=True):
        lower, upper = bounds.get(name, (-np.inf, np.inf))
        states[name] = Signal(value=value, lower=lower, upper=upper)
    return Model(
        f=lambda x, u, p: [x.v, -x.g * ca.sin(x.q) - 0.3 * x.v + u.F, 0.0],
        h=lambda x, u, p: [x.q],
        states=states,
        inputs={"F": ""},
        outputs={"y": ""},
    )


def mhe(N: int, **more) -> MHE:
    given = {"integrator": Integrator("rk4", 1), "optimiser": EXACT} | more
    return MHE(Noise(sigma_y=SIGMA_Y, sigma_w=SIGMA_W), Prior(sigma_x0=SIGMA_X0), N=N, **given)


def data(n: int, *, seed: int, x0=(0.8, 0.0, 10.0)) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    u = np.repeat(3 * rng.standard_normal(n // 6 + 1), 6)[:n, None]
    x, y = np.array(x0), []
    for k in range(n):
        y.append(x[:1] + SIGMA_Y * rng.standard_normal(1))
        x = runge_kutta(x, u[k]) + SIGMA_W * rng.standard_normal(3)
    return u, np.array(y)


def runge_kutta(x, u):
    """One step; of numbers, or of CasADi's symbols."""
    slope = (lambda x, u: np.array(f(x, u))) if isinstance(x, np.ndarray) else _slope
    k1 = slope(x, u)
    k2 = slope(x + DT / 2 * k1, u)
    k3 = slope(x + DT / 2 * k2, u)
    k4 = slope(x + DT * k3, u)
    return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _slope(x, u):
    return ca.vertcat(x[1], -x[2] * ca.sin(x[0]) - 0.3 * x[1] + u[0], 0)


def as_recording(u, y):
    return recording(np.arange(len(u)) * DT, u=u, y=y, inputs={"F": ""}, outputs={"y": ""}, dt=DT)


def run(estimator: MHE, model: Model, u, y) -> dict[str, np.ndarray]:
    recursion = estimator.compile(model, DT)
    arrays = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = vm.run(recursion, arrays, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def ipopt(u, y, *, lower, upper, w_max=np.inf, v_max=np.inf, soft=None) -> np.ndarray:
    """Whole trajectory by a general solver, (n, 3); `soft` is the weight of the bounds on q."""
    n = len(u)
    x, w, s = ca.MX.sym("x", 3, n), ca.MX.sym("w", 3, n - 1), ca.MX.sym("s", n)
    v = y.T - x[0, :]
    cost = ca.sumsqr((x[:, 0] - X0) / SIGMA_X0) + ca.sumsqr(w / SIGMA_W) + ca.sumsqr(v / SIGMA_Y)
    give = soft is not None
    cost += (soft or 0) * ca.sumsqr(s) + (0 if give else ca.sumsqr(s))
    gaps = [x[:, i + 1] - runge_kutta(x[:, i], u[i]) - w[:, i] for i in range(n - 1)]
    variables = ca.vertcat(ca.vec(x), ca.vec(w), s)
    low = np.tile(lower, n)
    high = np.tile(upper, n)
    rows = [ca.vertcat(*gaps), v.T, x[0, :].T + s, x[0, :].T - s]
    free = np.full(n, np.inf)
    lows = [np.zeros(3 * n - 3), -np.full(n, v_max), np.full(n, lower[0]), -free]
    highs = [np.zeros(3 * n - 3), np.full(n, v_max), free, np.full(n, upper[0])]
    if give:
        low[::3], high[::3] = -np.inf, np.inf
    bound = np.tile(np.array([np.inf, w_max, np.inf]), n - 1)
    options = {"ipopt": IPOPT, "print_time": False}
    problem = {"x": variables, "f": cost / 2, "g": ca.vertcat(*rows)}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    guess = np.concatenate([np.tile(X0, n), np.zeros(4 * n - 3)])
    found = solver(
        x0=guess,
        lbx=np.concatenate([low, -bound, -free]),
        ubx=np.concatenate([high, bound, free]),
        lbg=np.concatenate(lows),
        ubg=np.concatenate(highs),
    )
    assert solver.stats()["success"]
    return np.asarray(found["x"])[: 3 * n, 0].reshape(n, 3)


IPOPT = {"tol": 1e-11, "bound_relax_factor": 0.0, "print_level": 0, "sb": "yes"}
INFINITE = np.full(3, np.inf)
CASES = {
    "free": ({}, {}, {}),
    "states": ({"q": (-0.3, 0.5), "g": (10.5, 11.0)}, {}, {}),
    "noise": (
        {},
        {"limits": (Limit("push", {"v": 1.0}, -0.002, 0.002, "noise"),)},
        {"w_max": 0.002},
    ),
    "residual": (
        {},
        {"limits": (Limit("outlier", {"y": 1.0}, -0.02, 0.02, "residual"),)},
        {"v_max": 0.02},
    ),
    "soft": ({"q": (-0.3, 0.5)}, {"soft": {"q": 500.0}}, {"soft": 500.0}),
}
"""Bounds of states, settings of the estimator, settings of the general solver."""


@pytest.mark.parametrize("name", list(CASES))
def test_window_is_the_solution_of_a_general_solver(name):
    bounds, settings, limits = CASES[name]
    u, y = data(12, seed=4)
    lower, upper = -INFINITE, INFINITE.copy()
    for i, state in enumerate(("q", "v", "g")):
        if state in bounds:
            lower[i], upper[i] = bounds[state]
    found = solve_window(mhe(15, **settings), pendulum(**bounds), as_recording(u, y))
    expected = ipopt(u, y, lower=lower, upper=upper, **limits)
    np.testing.assert_allclose(found["x"].values, expected, rtol=0, atol=1e-8)
    if name != "free":
        assert np.count_nonzero(found["side"]) > 2
    status = run(mhe(15, **settings), pendulum(**bounds), u, y)["status"].astype(int)
    assert not np.any(status & ~int(Status.CLIPPED))


def test_active_bound_is_not_knowledge():
    """It has a multiplier, but the band is that of the window without the bound."""
    u, y = data(12, seed=4)
    found = solve_window(mhe(15), pendulum(g=(10.5, 11.0)), as_recording(u, y))
    held = found["side"].values[:, 0] != 0
    assert held.any()
    free = solve_window(mhe(15), pendulum(), as_recording(u, y))
    np.testing.assert_allclose(found["x_std"].values[:, 2], free["x_std"].values[:, 2], rtol=0.05)
    np.testing.assert_array_equal(found["multiplier"].values[~held, 0], 0.0)
    assert np.all(found["multiplier"].values[held, 0] * found["side"].values[held, 0] > 0)


def test_window_ends_with_the_estimate():
    u, y = data(30, seed=1)
    y[7] = y[25] = np.nan
    result = run(mhe(6), pendulum(), u, y)
    for at in (0, 3, 28, -1):
        found = solve_window(mhe(6), pendulum(), as_recording(u, y), at=at)
        np.testing.assert_allclose(found["x"].values[-1], result["x_hat"][at], rtol=1e-12)
        np.testing.assert_allclose(found["P"].values[-1], result["P"][at], rtol=1e-9)
        x, w = found["x"].values, found["w"].values
        k = range(30)[at] + 1 - len(x)
        for i in range(len(x) - 1):
            step = runge_kutta(x[i], u[k + i]) + w[i + 1]
            np.testing.assert_allclose(x[i + 1], step, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(
            found["v"].values, (y[k : k + len(x)] - x[:, :1]), rtol=1e-9, atol=1e-12
        )


def test_converges_from_a_poor_start():
    u, y = data(40, seed=5, x0=(2.8, 0.5, 10.0))
    poor = Prior(sigma_x0=[3.0, 5.0, 8.0], x0={"q": -1.5, "v": 4.0, "g": 30.0})
    estimator = dataclasses.replace(mhe(40), prior=poor)
    found = run(estimator, pendulum(), u, y)
    assert not found["status"].any()
    assert found["kkt"].max() <= 1e-10
    well_started = run(mhe(40), pendulum(), u, y)
    assert_close(found["x_hat"][-1:], well_started["x_hat"][-1:], 0.05)


def test_limits_that_contradict_each_other_are_named():
    u, y = data(20, seed=6)
    limits = (
        Limit("fast", {"v": 1.0}, lower=2.0),
        Limit("calm", {"v": 1.0}, upper=1.0),
        Limit("wide", {"q": 1.0}, -100.0, 100.0),
    )
    result = run(mhe(5, limits=limits), pendulum(), u, y)
    free = run(mhe(5), pendulum(), u, y)
    assert np.all(result["status"].astype(int) & int(Status.INFEASIBLE))
    np.testing.assert_array_equal(result["infeasible"], np.tile([1.0, 1.0, 0.0], (20, 1)))
    assert_close(result["x_hat"], free["x_hat"], 1e-9)


def test_overflow_is_a_status_and_the_prior_is_the_way_back():
    """An input of 1e200 at sample 9 is squared by the model."""
    u, y = data(30, seed=7)
    u[9] = 1e200
    wild = dataclasses.replace(
        pendulum(), f=lambda x, u, p: [x.v, -x.g * ca.sin(x.q) - 0.3 * x.v + u.F**2 / 10, 0.0]
    )
    for optimiser in (EXACT, GaussNewton(2, tolerance=0.0)):
        estimator = mhe(5, optimiser=optimiser)
        with pytest.raises(EstimationError, match="sample 10"):
            bs.estimate(estimator, wild, as_recording(u, y))
        result = bs.estimate(estimator, wild, as_recording(u, y), throw=False)
        lost = ~np.isfinite(result["x_hat"].values).all(axis=1)
        assert list(np.flatnonzero(lost)) == [10]
        fresh = bs.estimate(estimator, wild, as_recording(u[11:], y[11:]))
        assert_close(result["x_hat"].values[11:], fresh["x_hat"].values, 1e-12)


def test_horizon_may_be_longer_than_the_recording():
    u, y = data(10, seed=8)
    assert_close(
        run(mhe(9), pendulum(), u, y)["x_hat"], run(mhe(60), pendulum(), u, y)["x_hat"], 1e-9
    )


def test_feedthrough_and_ramped_inputs():
    """An accelerometer sees the force at once; the estimate of exact data is exact."""
    model = Model(
        f=lambda x, u, p: [x.v, -9.0 * x.q - 0.4 * x.v + u.F],
        h=lambda x, u, p: [x.q, -9.0 * x.q - 0.4 * x.v + u.F],
        states={"q": 0.0, "v": 0.0},
        inputs={"F": ""},
        outputs={"y": "", "a": ""},
    )
    u = np.random.default_rng(9).standard_normal((60, 1))
    exact = bs.simulate(model, u, dt=DT, x0={"q": 0.2}, hold="foh")
    estimator = MHE(
        Noise(sigma_y={"y": 0.01, "a": 0.1}, sigma_w=1e-3),
        Prior(sigma_x0=0.5),
        N=8,
        integrator=Integrator("rk4", 4, hold="foh"),
    )
    result = bs.estimate(estimator, model, exact)
    error = np.abs(result["x_hat"].values - exact["x_true"].values)
    assert error[20:].max() < 1e-5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"N": 0}, "the horizon N is 0"),
        ({"N": 4, "lag": 5}, "the lag is 5"),
        ({"constant": ("length",)}, "there is no state 'length'"),
        ({"soft": {"v": 1.0}}, "there is no limit 'v'"),
        ({"soft": {"q": 0.0}}, "the weight of 'q' is 0.0"),
        ({"limits": (Limit("q", {"v": 1.0}, 0.0),)}, "'q' is used twice"),
        ({"arrival": "ekf"}, "the arrival cost is 'ekf'"),
        ({"arrival": NoArrival, "N": 3}, "the arrival cost is"),
        ({"optimiser": GaussNewton(cost_tolerance=1e-3)}, "ends by `tolerance`"),
        ({"prior": Prior(sigma_x0=1.0, x0={"q": 2.0})}, "'q' starts at 2, outside"),
    ],
)
def test_bad_settings_are_named(change, message):
    with pytest.raises(TuningError, match=message):
        dataclasses.replace(mhe(5), **change).compile(pendulum(q=(-1.0, 1.0)), DT)
