"""A window over a whole recording is solved by itself, not by way of all windows before it."""

import casadi as ca
import numpy as np

import backsight as bs
from backsight.schema import Status

DT = 0.02


def pendulum(**bounds) -> bs.Model:
    model = bs.Model(
        f=lambda x, u, p: [x.w, -p.g * ca.sin(x.phi) - 0.2 * x.w + u.M],
        h=lambda x, u, p: [x.phi],
        states={"phi": bs.Signal(unit="rad", **bounds), "w": "rad/s"},
        inputs={"M": ""},
        outputs={"phi": "rad"},
        parameters={"g": 9.0},
    )
    return bs.augment(model, ["g"])


def recorded(n: int):
    rng = np.random.default_rng(3)
    push = np.repeat(3 * rng.standard_normal(n // 20 + 1), 20)[:n, None]
    true = bs.simulate(pendulum(), push, dt=DT, x0={"phi": 0.8, "g": 9.81}, sigma_y=0.01, seed=1)
    y = true["y"].values.copy()
    y[7:11] = y[0] = np.nan
    units = {"inputs": {"M": ""}, "outputs": {"phi": "rad"}}
    return bs.from_arrays(u=push, y=y, dt=DT, **units)


NOISE = bs.Noise(sigma_y=0.01, sigma_w={"w": 1e-3})
PRIOR = bs.Prior(sigma_x0=[0.1, 0.5, 1.0], x0={"phi": 0.8})


def test_it_is_the_window_at_the_end_of_all_windows():
    model, recording, n = pendulum(), recorded(30), 30
    optimiser = bs.settings.GaussNewton(40, tolerance=1e-9)
    mhe = bs.MHE(NOISE, PRIOR, N=n - 1, lag=n - 1, optimiser=optimiser)
    window = bs.solve_window(mhe, model, recording)
    last = bs.estimate(mhe, model, recording)
    np.testing.assert_allclose(window["x"], last["x_hat"], atol=1e-7)
    np.testing.assert_allclose(window["x_std"], last["x_std"], rtol=1e-6)
    assert window.attrs["status"] == Status.OK
    assert 2 <= window.attrs["iterations"] < 20


def test_hundreds_of_samples_equal_the_smoother():
    spring, n = bs.sdof(k=40.0, b=0.8), 600
    force = np.sin(0.1 * np.arange(n))[:, None]
    recording = bs.simulate(spring, force, dt=DT, sigma_y=1e-3, seed=2)
    noise, prior = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}), bs.Prior(sigma_x0=0.1)
    window = bs.solve_window(bs.MHE(noise, prior, N=n - 1), spring, recording)
    best = bs.smooth(bs.KalmanFilter(noise, prior), spring, recording, engine="vm")
    np.testing.assert_allclose(window["x"], best["x_hat"], atol=1e-12)
    np.testing.assert_allclose(window["x_std"], best["x_std"], rtol=1e-9)


def test_limits_and_what_does_not_converge():
    model, recording = pendulum(upper=0.7, value=0.5), recorded(40)
    prior = bs.Prior(sigma_x0=[0.3, 0.5, 1.0], x0={"phi": 0.5})
    window = bs.solve_window(bs.MHE(NOISE, prior, N=39), model, recording)
    assert float(window["x"].sel(state="phi").max()) <= 0.7 + 1e-9
    assert (window["side"] < 0).any()
    hasty = bs.settings.GaussNewton(1)
    stopped = bs.solve_window(bs.MHE(NOISE, prior, N=39, optimiser=hasty), model, recording)
    assert stopped.attrs["status"] & Status.ITERATION_LIMIT
