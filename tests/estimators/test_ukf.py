import dataclasses

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native, vm
from backsight.errors import TuningError
from backsight.estimators import UKF, KalmanFilter, Noise, Prior
from backsight.models.augment import augment
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.estimation import estimate
from backsight.schema import Status
from backsight_studies.punch import tuning
from backsight_studies.punch.plant import STIFF, with_noise
from backsight_studies.start import posterior_start
from closeness import assert_close
from estimators.punch import motion
from oracles.kalman import kalman_filter
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, Q, R, Run, model, record


@pytest.mark.parametrize("missing", [0.0, 0.4])
@pytest.mark.parametrize("spread", [{}, {"alpha": 0.5, "kappa": 1.0}, {"alpha": 0.1, "beta": 0.0}])
def test_on_a_linear_model_it_is_the_kalman_filter(missing, spread):
    u, y = record(80, seed=1, missing=missing)
    result = Run(UKF(**GAUSSIANS, **spread), model(), DT)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-9)
    assert_close(result["P"], P, 1e-9)
    assert not result["status"].any()


def test_a_continuous_model():
    """Sampled by the matrix exponential, with the process noise added once per sample."""
    dt, n = 0.05, 60
    plant = Model(
        f=lambda x, u, p: [x.v, -30.0 * x.q - 0.8 * x.v + u.F],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
    )
    rng = np.random.default_rng(4)
    u, y = rng.standard_normal((n, 1)), rng.standard_normal((n, 1))
    block = np.zeros((3, 3))
    block[:2] = [[0.0, 1.0, 0.0], [-30.0, -0.8, 1.0]]
    step = expm(block * dt)
    noise = Noise(sigma_y=0.1, sigma_w={"v": 0.3})
    prior = Prior(P0=np.diag([0.5, 2.0]), x0=[0.2, -1.0])
    result = Run(UKF(noise, prior, integrator=Integrator("rk4", 30)), plant, dt)(u, y)
    x, P = kalman_filter(
        y, u, A=step[:2, :2], B=step[:2, 2:], C=np.array([[1.0, 0.0]]), Q=np.diag([0.0, 0.09]),
        R=np.array([[0.01]]), x0=[0.2, -1.0], P0=np.diag([0.5, 2.0]),
    )  # fmt: skip
    assert_close(result["x_hat"], x, 1e-8)
    assert_close(result["P"], P, 1e-8)


def squared(noise: Noise, prior: Prior, **settings) -> tuple[UKF, Model]:
    """A state that does not move, of which the square is measured."""
    plant = Model(
        f=lambda x, u, p: [x.a],
        h=lambda x, u, p: [x.a**2],
        states={"a": ""},
        outputs={"y": ""},
        dt=1.0,
    )
    return UKF(noise, prior, **settings), plant


def test_moments_through_a_square():
    """Mean m^2 + s^2 and variance 4 m^2 s^2 + 2 s^4, exact for a Gaussian with kappa = 2."""
    m, s = 1.5, 0.4
    estimator, plant = squared(Noise(sigma_y=0.1), Prior(x0=[m], sigma_x0=[s]), kappa=2.0, beta=0.0)
    result = Run(estimator, plant, 1.0)(np.zeros((1, 0)), np.array([[3.0]]))
    assert result["e"][0, 0] == pytest.approx(3.0 - m**2 - s**2, rel=1e-12)
    assert result["S"][0, 0, 0] == pytest.approx(4 * m**2 * s**2 + 2 * s**4 + 0.01, rel=1e-12)
    gain = 2 * m * s**2 / result["S"][0, 0, 0]
    assert result["x_hat"][0, 0] == pytest.approx(m + gain * result["e"][0, 0], rel=1e-12)


def test_a_covariance_without_factor_is_reported_and_not_used():
    """beta = -5 makes the weight of the centre so negative that a square has no variance."""
    estimator, plant = squared(
        Noise(sigma_y=1e-3), Prior(x0=[0.0], sigma_x0=[1.0]), alpha=0.5, beta=-5.0
    )
    y = np.array([[0.3], [0.2], [np.nan]])
    result = Run(estimator, plant, 1.0)(np.zeros((3, 0)), y)
    broken = (result["status"].astype(int) & int(Status.NOT_POSITIVE_DEFINITE)) != 0
    assert broken.tolist() == [True, True, False]
    np.testing.assert_array_equal(result["x_hat"][:, 0], 0.0)
    np.testing.assert_allclose(result["P"][:, 0, 0], 1.0)


def test_a_prediction_without_factor_is_reported_at_the_next_sample():
    plant = Model(
        f=lambda x, u, p: [x.a**2],
        h=lambda x, u, p: [x.a],
        states={"a": ""},
        outputs={"y": ""},
        dt=1.0,
    )
    estimator = UKF(Noise(sigma_y=1.0), Prior(x0=[0.0], sigma_x0=[1.0]), alpha=0.5, beta=-5.0)
    result = Run(estimator, plant, 1.0)(np.zeros((2, 0)), np.full((2, 1), np.nan))
    broken = (result["status"].astype(int) & int(Status.NOT_POSITIVE_DEFINITE)) != 0
    assert broken.tolist() == [False, True]
    np.testing.assert_allclose(result["P"][:, 0, 0], 1.0)


def test_parameters_never_leave_their_bounds_in_the_model():
    """A square root of the parameter: a sigma point below zero would make everything NaN."""
    plant = Model(
        f=lambda x, u, p: [-(x.k**0.5) * x.q, 0],
        h=lambda x, u, p: [x.q],
        states={"q": Signal(value=1.0), "k": Signal(value=1.0, lower=1e-3)},
        outputs={"y": ""},
    )
    estimator = UKF(Noise(sigma_y=0.01), Prior(sigma_x0={"q": 0.1, "k": 3.0}))
    t = np.arange(100) * 0.02
    y = np.exp(-np.sqrt(0.6) * t) + 0.01 * np.random.default_rng(0).standard_normal(100)
    result = Run(estimator, plant, 0.02)(np.zeros((100, 0)), y[:, None])
    assert np.isfinite(result["x_hat"]).all()
    assert int(result["status"][0]) & int(Status.CLIPPED)
    assert not result["status"][-1]
    k, std = result["x_hat"][-1, 1], np.sqrt(result["P"][-1, 1, 1])
    assert abs(k - 0.6) < 3 * std
    assert std < 0.05


def test_what_says_nothing_of_a_parameter_does_not_make_it_surer():
    """At its bound half of the points of k are clipped; the output does not depend on k."""
    plant = Model(
        f=lambda x, u, p: [0.9 * x.q, x.k],
        h=lambda x, u, p: [x.q],
        states={"q": "", "k": Signal(value=0.0, lower=0.0)},
        outputs={"y": ""},
        dt=1.0,
    )
    estimator = UKF(Noise(sigma_y=0.1), Prior(sigma_x0={"q": 0.1, "k": 3.0}))
    result = Run(estimator, plant, 1.0)(np.zeros((1, 0)), np.array([[0.2]]))
    np.testing.assert_allclose(result["x_hat"][0], [0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(result["P"][0], np.diag([0.005, 9.0]), atol=1e-12)


def chain(n: int, **bounds: float) -> Model:
    """Places that slopes carry away; the first slope and all that follow it are bounded."""
    F = np.eye(n) + np.diag(np.full(n - 1, 0.5), 1)
    states = {"x0": "", **{f"x{i}": Signal(**bounds) for i in range(1, n)}}
    return lti(
        F, np.ones((n, 1)), np.eye(2, n), states=states, inputs={"u": ""},
        outputs={"y": "", "z": ""}, dt=1.0,
    )  # fmt: skip


@pytest.mark.parametrize("bounds", [{"lower": 0.0}, {"upper": 0.0}, {"lower": -0.1, "upper": 0.2}])
@pytest.mark.parametrize("n", [2, 14])
def test_at_a_bound_the_first_sample_is_that_of_the_kalman_filter(n, bounds):
    """Few states and many; the points are two to four deviations beyond the bounds."""
    settings = {"noise": Noise(sigma_y=0.3, sigma_w=0.1), "prior": Prior(sigma_x0=1.0)}
    u, y = np.zeros((2, 1)), np.array([[0.4, 0.1], [np.nan, np.nan]])
    ours, theirs = (
        Run(kind(**settings), chain(n, **bounds), 1.0)(u, y) for kind in (UKF, KalmanFilter)
    )
    for name in ("P", "S", "e"):
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours["x_hat"], theirs["x_hat"], atol=1e-12)
    assert np.all(ours["status"].astype(int) & int(Status.CLIPPED))


def test_a_slope_at_its_bound_is_that_of_the_kalman_filter():
    """Sample by sample; clipped points draw it away and make its band too narrow."""
    rng, settings = np.random.default_rng(3), {
        "noise": Noise(sigma_y=1.0, sigma_w={"x0": 0.1}), "prior": Prior(sigma_x0=[1.0, 0.3])
    }  # fmt: skip
    u, y = np.zeros((60, 1)), rng.standard_normal((60, 2))
    y[:, 1] = np.nan
    kalman, moved, clipped = (
        Run(e, chain(2, lower=0.0), 1.0)(u, y)
        for e in (KalmanFilter(**settings), UKF(**settings), UKF(**settings, outside="clipped"))
    )
    np.testing.assert_allclose(moved["x_hat"], kalman["x_hat"], atol=1e-12)
    np.testing.assert_allclose(moved["P"], kalman["P"], atol=1e-12)
    assert clipped["x_hat"][-1, 1] > moved["x_hat"][-1, 1] + 1e-3
    assert clipped["P"][-1, 1, 1] < 0.9 * moved["P"][-1, 1, 1]


def test_a_gap_that_is_open_at_the_prior_is_found():
    """The stop at 0.5 pushes back beyond it only; at the prior's mean of 3 nothing has a slope."""
    plant = augment(
        Model(
            f=lambda x, u, p: [x.v, -100 * x.x - 2 * x.v - 1e3 * ca.fmax(x.x - p.g, 0) + u.F],
            h=lambda x, u, p: [x.x],
            states={"x": "", "v": ""},
            inputs={"F": ""},
            outputs={"y": ""},
            parameters={"g": Signal(value=3.0, lower=0.0)},
        ),
        ["g"],
    )
    dt, n, rng, x = 0.01, 300, np.random.default_rng(1), np.zeros(2)
    u, y = 100 * np.sin(8 * dt * np.arange(n))[:, None], np.zeros((n, 1))
    for k in range(n):
        y[k] = x[0] + 1e-3 * rng.standard_normal()
        for _ in range(20):
            push = u[k, 0] - 1e3 * max(x[0] - 0.5, 0)
            x = x + dt / 20 * np.array([x[1], push - 100 * x[0] - 2 * x[1]])
    prior = Prior(sigma_x0={"x": 0.1, "v": 0.1, "g": 1.5})
    result = Run(UKF(Noise(sigma_y=1e-3, sigma_w={"v": 0.3}), prior), plant, dt)(u, y)
    g, std = result["x_hat"][-1, 2], np.sqrt(result["P"][-1, 2, 2])
    assert abs(g - 0.5) < 0.02
    assert std < 0.02


@pytest.mark.parametrize("first", ["measured", "posterior"])
def test_the_tuned_filter_of_the_punch_does_not_diverge(first):
    """From 1.8 p with the stiff spring: sigma points of 1/m below zero would end it."""
    start = tuning.scaled_start(STIFF, 1.8)
    variant = tuning.ukf("UKF", STIFF, start, tuning.TUNED)
    recursion = variant.estimator.compile(variant.model, 1e-4)
    for seed in range(5):
        recording = with_noise(motion(), seed)
        if first == "posterior":
            recording = posterior_start(recording)
        y = recording["y"].values
        data = [recording["u"].values, np.nan_to_num(y), np.isfinite(y).astype(float)]
        _, outputs = native.run(recursion, data, carry=recursion.carry0)
        x = outputs[0]
        assert np.isfinite(x).all()
        truth = [STIFF.stiffness, 1500.0, 1 / 125.0]
        assert (x[:, 2:] >= 0.99e-3 * np.array(truth)).all()
        np.testing.assert_allclose(x[-1, 2:], truth, rtol=0.05)


def test_the_floor_costs_no_more_than_a_status():
    result = estimate(
        tuning.ukf("UKF", STIFF, tuning.scaled_start(STIFF, 1.8), tuning.TUNED).estimator,
        tuning.filter_model(STIFF),
        posterior_start(with_noise(motion(), 0)),
    )
    clipped = (result["status"].values & int(Status.CLIPPED)) != 0
    assert clipped.any()
    assert not clipped[-5000:].any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"alpha": 0.0}, "alpha is 0.0"), ({"kappa": -3.0}, "must be above -3 for 3 states")],
)
def test_wrong_settings(settings, message):
    with pytest.raises(TuningError, match=message):
        UKF(**GAUSSIANS, **settings).compile(model(), DT)


def test_engines_agree_on_the_flag():
    """The flag of a failed prediction travels in the carry."""
    estimator, plant = squared(
        Noise(sigma_y=1e-3), Prior(x0=[0.1], sigma_x0=[1.0]), alpha=0.5, beta=-5.0
    )
    recursion = dataclasses.replace(estimator).compile(plant, 1.0)
    data = [np.zeros((4, 0)), np.full((4, 1), 0.3), np.ones((4, 1))]
    results = [e.run(recursion, data, carry=recursion.carry0)[1] for e in (vm, native)]
    for a, b in zip(*results, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
