"""What multiplies an input that is measured with noise: filters that look back, against windows."""

import numpy as np
import pytest
from scipy.linalg import expm

import backsight as bs

DT, N = 0.02, 400
TRUE = {"m": 1.2, "k": 45.0}
SIGMA = 0.8


def spring(*, accelerometer: bool, displacement: bool) -> bs.Model:
    """A mass on a spring whose mass and stiffness are not known; discrete outputs are chosen."""

    def acceleration(x, u, p):
        return (u.F - p.k * x.q - 2 * x.v) / p.m

    outputs = {"a": "m/s2"} if accelerometer else {}
    outputs |= {"y": "m"} if displacement else {}
    outputs = outputs or {"w": "m/s"}

    def seen(x, u, p):
        of = {"a": acceleration(x, u, p), "y": x.q, "w": x.v}
        return [of[name] for name in outputs]

    model = bs.Model(
        f=lambda x, u, p: [x.v, acceleration(x, u, p)],
        h=seen,
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs=outputs,
        parameters={"m": 1.0, "k": 40.0},
    )
    return bs.augment(model, ["m", "k"])


def recorded(model: bs.Model, seed: int):
    """A motion of the true system under a force, of which a noisy reading is recorded."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(N)
    force = 7 * np.sin(2 * np.pi * 0.9 * t + rng.uniform(0, 6)) * np.sign(np.sin(1.7 * t + 0.3))
    m, k = TRUE.values()
    M = expm(DT * np.array([[0, 1, 0], [-k / m, -2 / m, 1 / m], [0, 0, 0]]))
    x, y = np.zeros(2), []
    of = {"a": 0.02, "y": 1e-3, "w": 1e-3}
    for F in force:
        values = {"a": (F - k * x[0] - 2 * x[1]) / m, "y": x[0], "w": x[1]}
        y.append([values[s.name] + of[s.name] * rng.standard_normal() for s in model.outputs])
        x = M[:2, :2] @ x + M[:2, 2] * F + [0, 1e-3 * rng.standard_normal()]
    outputs = {s.name: s.unit for s in model.outputs}
    measured = force + SIGMA * rng.standard_normal(N)
    noise = bs.Noise(
        sigma_y={name: of[name] for name in outputs}, sigma_w={"v": 1e-3}, sigma_u={"F": SIGMA}
    )
    return bs.from_arrays(u=measured, y=y, inputs={"F": "N"}, outputs=outputs, dt=DT), noise


PRIOR = bs.Prior(sigma_x0={"q": 0.01, "v": 0.05, "m": 0.2, "k": 6.0})
SENSORS = {"speed": (False, False), "both": (True, True), "accelerometer": (True, False)}


@pytest.mark.parametrize("sensors", SENSORS)
def test_filters_find_what_a_window_finds(sensors):
    """And not a slope that is too small, which is five deviations and more away."""
    accelerometer, displacement = SENSORS[sensors]
    model = spring(accelerometer=accelerometer, displacement=displacement)
    recording, noise = recorded(model, 0)
    window = bs.estimate(bs.MHE(noise, PRIOR, N=2), model, recording, throw=False)
    at_end = window.isel(time=-1)
    for method in (bs.EKF, bs.IEKF, bs.UKF):
        found = bs.estimate(method(noise, PRIOR), model, recording, throw=False).isel(time=-1)
        off = ((found["x_hat"] - at_end["x_hat"]) / at_end["x_std"]).values
        assert np.abs(off).max() < 0.4
        np.testing.assert_allclose(found["x_std"], at_end["x_std"], rtol=0.05)
    error = (at_end["x_hat"].values[2:] - list(TRUE.values())) / at_end["x_std"].values[2:]
    assert np.abs(error).max() < 3


def test_looking_back_changes_nothing_that_is_linear():
    """An input that no state multiplies: the estimate is the Kalman filter's."""
    model = bs.sdof(k=40.0, b=0.8)
    recording = bs.simulate(model, np.ones((60, 1)), dt=DT, sigma_y=1e-3, seed=2)
    noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}, sigma_u={s.name: 0.5 for s in model.inputs})
    prior = bs.Prior(sigma_x0=0.1)
    best = bs.estimate(bs.KalmanFilter(noise, prior), model, recording, engine="vm")
    for method in (bs.EKF, bs.UKF):
        found = bs.estimate(method(noise, prior), model, recording, engine="vm")
        np.testing.assert_allclose(found["x_hat"], best["x_hat"], atol=1e-9)
        np.testing.assert_allclose(found["P"], best["P"], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("method", [bs.EKF, bs.IEKF, bs.UKF], ids=lambda method: method.key)
@pytest.mark.parametrize("sensors", SENSORS)
def test_bands_hold_what_multiplies_a_noisy_input(sensors, method):
    accelerometer, displacement = SENSORS[sensors]
    model, squares = spring(accelerometer=accelerometer, displacement=displacement), []
    for seed in range(60):
        recording, noise = recorded(model, seed)
        last = bs.estimate(method(noise, PRIOR), model, recording, throw=False).isel(time=-1)
        error = last["x_hat"].values[2:] - list(TRUE.values())
        squares.append(error @ np.linalg.solve(last["P"].values[2:, 2:], error))
    assert np.mean(squares) < 3.0  # 2 of the right bands, 0.26 its deviation over 60 runs
