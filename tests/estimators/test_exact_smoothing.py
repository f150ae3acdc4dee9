"""Sensors without noise: smoothing, and the iterated filter."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
import scipy.optimize

import backsight as bs
from backsight.errors import TuningError
from estimators.exact_plants import DT, FILTERS, P0, SENSORS, A, N, Q, conditioned, drawn, plant
from estimators.forced_plants import DT as SAMPLING
from estimators.forced_plants import chain
from estimators.forced_plants import plant as stepwise

OFTEN_SMOOTHED = {
    (bs.KalmanFilter, "noisy one first"), (bs.KalmanFilter, "both states"),
    (bs.EKF, "two of one thing"), (bs.IEKF, "their difference"), (bs.UKF, "with a noisy one"),
}  # fmt: skip
SMOOTHED = [
    pytest.param(
        sensors,
        method,
        id=f"{method.key}-{sensors}",
        marks=() if (method, sensors) in OFTEN_SMOOTHED else pytest.mark.slow,
    )
    for method in FILTERS
    for sensors in SENSORS
]


@pytest.mark.parametrize(("sensors", "method"), SMOOTHED)
def test_smoothed_estimates_are_those_of_conditioning_on_all(sensors, method):
    C, R = (np.array(given) for given in SENSORS[sensors])
    y = drawn(C, R)
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={f"y{i}": "m" for i in range(len(C))})
    estimator = method(bs.Noise(R=R, Q=Q), bs.Prior(P0=P0))
    result = bs.smooth(estimator, plant(C), recording, engine="vm", throw=False)
    x, P = conditioned(C, R, y, smoothed=True)
    np.testing.assert_allclose(result["x_hat"].values, x, atol=1e-12)
    np.testing.assert_allclose(result["P"].values, P, atol=1e-15)
    assert (np.linalg.eigvalsh(result["P"].values) > -1e-17).all()


def test_what_later_readings_tell_exactly_has_no_band():
    """A motion without noise: two exact readings tell all of it, before them, too."""
    x = np.array([[0.1, 0.5]])
    for _ in range(N - 1):
        x = np.vstack([x, A @ x[-1]])
    y = x[:, :1].copy()
    y[:9] = np.nan
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={"y0": "m"})
    kf = bs.KalmanFilter(bs.Noise(sigma_y=0.0), bs.Prior(P0=P0))
    result = bs.smooth(kf, plant([[1.0, 0.0]]), recording, engine="vm", throw=False)
    np.testing.assert_allclose(result["x_hat"], x, atol=1e-12)
    assert np.abs(result["P"]).max() < 1e-24


@pytest.mark.parametrize("method", [bs.KalmanFilter, bs.EKF])
def test_many_states_are_smoothed_as_by_conditioning_on_all(method):
    """A chain of 14 states, by kernels; one sensor has noise, two have none, one of them gaps."""
    model, rng, n, nx = chain("displacement"), np.random.default_rng(0), 12, 14
    p, R = stepwise(model), np.diag([0.0, 1e-8, 0.0])
    P0, Q = np.diag([1e-4] * 7 + [1e-2] * 7), np.diag([0.0] * 7 + [1e-4] * 7)
    noise = rng.standard_normal((n, nx)) * np.sqrt(np.diag(Q))
    start = np.sqrt(np.diag(P0)) * rng.standard_normal(nx)
    _, y = p.run(np.zeros((n, 3)), x0=start, w=noise, v=rng.standard_normal((n, 3)) * [0, 1e-4, 0])
    y[4:6, 2] = np.nan
    effect, rows, every = np.zeros((nx, (nx + 3) * n)), [], []
    effect[:, :nx] = np.sqrt(P0)
    for k in range(n):
        shown = p.C @ effect
        shown[:, nx * n + 3 * k : nx * n + 3 * (k + 1)] = np.sqrt(R)
        rows.append(shown[np.isfinite(y[k])])
        every.append(effect)
        effect = p.A @ effect
        if k + 1 < n:
            effect[:, nx * (k + 1) : nx * (k + 2)] = np.sqrt(Q)
    inverse = np.linalg.pinv(np.vstack(rows), rcond=1e-13)
    left = np.eye((nx + 3) * n) - inverse @ np.vstack(rows)
    size, found = np.sqrt(np.diag(P0)), inverse @ y[np.isfinite(y)]
    outputs = {s.name: s.unit for s in model.outputs}
    recording = bs.from_arrays(y=y, inputs={}, outputs=outputs, dt=SAMPLING)
    estimator = method(bs.Noise(R=R, Q=Q), bs.Prior(P0=P0))
    result = bs.smooth(estimator, model, recording, engine="vm")
    expected = np.array([part @ found for part in every])
    np.testing.assert_allclose(result["x_hat"] / size, expected / size, atol=1e-10)
    P = np.array([part @ left @ left.T @ part.T for part in every]) / np.outer(size, size)
    np.testing.assert_allclose(result["P"] / np.outer(size, size), P, atol=1e-11)
    assert not result["status"].any()


def test_sigma_points_of_many_states_with_exact_sensors_say_what_to_do():
    ukf = bs.UKF(bs.Noise(sigma_y=0.0, sigma_w=1.0), bs.Prior(sigma_x0=1.0))
    names = {s.name: s.unit for s in chain("displacement").outputs}
    recording = bs.from_arrays(y=np.zeros((5, 3)), dt=SAMPLING, inputs={}, outputs=names)
    with pytest.raises(TuningError, match=r"no slope .* smooth with EKF or IEKF"):
        bs.smooth(ukf, chain("displacement"), recording)


def beacon():
    """A place whose distance from a beacon is known exactly, and a bearing roughly."""
    return bs.Model(
        f=lambda x, u, p: [x.a, x.b],
        h=lambda x, u, p: [
            ca.sqrt((x.a - 3) ** 2 + (x.b - 4) ** 2),
            ca.atan2(x.b + 2, x.a + 6),
        ],
        states={"a": bs.Signal("m", value=0.5), "b": "m"},
        outputs={"r": "m", "phi": ""},
        dt=1.0,
    )


@pytest.mark.parametrize("place", [(1.0, 1.5), (-1.0, 2.0), (2.5, -1.0)])
def test_an_iterated_update_is_the_most_likely_place_that_the_exact_reading_allows(place):
    a, b = place
    y = np.array([np.hypot(a - 3, b - 4), np.arctan2(b + 2, a + 6) + 0.01])
    recording = bs.from_arrays(
        y=np.vstack([y, np.full(2, np.nan)]), dt=1.0, inputs={}, outputs={"r": "m", "phi": ""}
    )
    start, spread, sigma = np.array([0.5, 0.0]), np.array([1.0, 2.0]), 0.02
    noise, prior = bs.Noise(R=np.diag([0.0, sigma**2])), bs.Prior(sigma_x0=spread, x0=start)
    result = bs.estimate(bs.IEKF(noise, prior), beacon(), recording, engine="vm", throw=False)

    def cost(angle):  # on the circle around the beacon
        x = np.array([3 + y[0] * np.cos(angle), 4 + y[0] * np.sin(angle)])
        bearing = np.arctan2(x[1] + 2, x[0] + 6)
        return (((x - start) / spread) ** 2).sum() + ((y[1] - bearing) / sigma) ** 2

    at = np.arctan2(b - 4, a - 3)
    best = scipy.optimize.minimize_scalar(
        cost, bounds=(at - 0.5, at + 0.5), options={"xatol": 1e-10}
    ).x
    expected = [3 + y[0] * np.cos(best), 4 + y[0] * np.sin(best)]
    np.testing.assert_allclose(result["x_hat"][0], expected, atol=1e-6)
    assert abs(result["y_hat"][0, 0] - y[0]) < 1e-12
    assert not result["status"][0]


def test_a_smoothed_pendulum_with_an_exact_encoder_is_the_limit_of_small_noise():
    pendulum = bs.Model(
        f=lambda x, u, p: [x.w, -9.81 * np.sin(x.phi) - 0.1 * x.w],
        h=lambda x, u, p: [x.phi],
        states={"phi": "rad", "w": "rad/s"},
        outputs={"phi": "rad"},
    )
    recording = bs.simulate(pendulum, np.zeros((40, 0)), dt=DT, x0=[1.0, 0.0])
    noise, prior = bs.Noise(sigma_y=0.0, sigma_w={"w": 0.02}), bs.Prior(sigma_x0=[0.5, 1.0])
    exact, small = (
        bs.smooth(bs.EKF(one, prior), pendulum, recording, engine="vm")
        for one in (noise, dataclasses.replace(noise, sigma_y=1e-8))
    )
    np.testing.assert_allclose(exact["x_hat"], small["x_hat"], atol=1e-6)
    np.testing.assert_allclose(exact["x_std"], small["x_std"], atol=1e-6)
