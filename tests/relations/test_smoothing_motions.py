"""Smoothing of nonlinear motions, what is refused, and what is told."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.errors import EstimationError, TuningError
from backsight.estimators import EKF, IEKF, MHE, MHO, UKF, KalmanFilter, LinearMHE
from backsight.schema import Status
from relations.smoothed_plants import (
    assert_smoothed,
    assumed,
    data_of,
    model_of,
    random_plant,
    recording_of,
)


def pendulum(seed: int, n: int = 150) -> tuple[bs.Model, xr.Dataset, np.ndarray]:
    """A pendulum of random start and torque; its angle is measured, with a gap."""
    model = bs.from_equations(
        states={"q": "rad", "v": "rad/s"},
        inputs={},
        outputs={"y": "rad"},
        equations={"q": "v", "v": "-9.81*sin(q) - 0.2*v"},
        output_equations={"y": "q"},
    )
    rng, dt, steps = np.random.default_rng(seed), 0.02, 10
    x, truth = np.array([1.0, 0.0]) + [0.2, 0.5] * rng.standard_normal(2), []
    for _ in range(n):
        truth.append(x)
        for _ in range(steps):
            h = dt / steps
            kick = [0.0, 0.5 * np.sqrt(h) * rng.standard_normal()]
            v = x[1] - h * (9.81 * np.sin(x[0]) + 0.2 * x[1])
            x = np.array([x[0] + h * v, v]) + kick
    X = np.array(truth)
    y = X[:, :1] + 0.05 * rng.standard_normal((n, 1))
    y[60:80] = np.nan
    u = np.zeros((n, 0))
    return model, bs.from_arrays(u=u, y=y, dt=dt, inputs={}, outputs={"y": "rad"}), X


PENDULUM = {
    "noise": bs.Noise(sigma_y=0.05, Qc=np.diag([0.0, 0.25])),
    "prior": bs.Prior(x0={"q": 1.0}, sigma_x0={"q": 0.2, "v": 0.5}),
    "integrator": bs.Integrator("rk4", substeps=2),
}


@pytest.mark.parametrize("kind", [EKF, IEKF, UKF])
def test_a_nonlinear_motion_is_known_better_and_within_its_bands(kind):
    errors, nees = [], []
    for seed in range(3):
        model, recording, X = pendulum(seed)
        filtered = bs.estimate(kind(**PENDULUM), model, recording, engine="vm")
        result = bs.smooth(kind(**PENDULUM), model, recording, engine="vm")
        e = result["x_hat"].values - X
        errors.append(np.sqrt((e**2).mean() / ((filtered["x_hat"].values - X) ** 2).mean()))
        nees.append(np.einsum("ki,kij,kj->k", e, np.linalg.inv(result["P"].values), e).mean())
        assert (np.abs(e) < 4 * result["x_std"].values).all()
    assert np.mean(errors) < 0.7
    assert 1.2 < np.mean(nees) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", [EKF, UKF])
def test_bands_of_many_pendulums_cover(kind):
    inside, nees = [], []
    for seed in range(60):
        model, recording, X = pendulum(seed)
        result = bs.smooth(kind(**PENDULUM), model, recording, engine="native")
        e = result["x_hat"].values - X
        inside.append((np.abs(e) < 3 * result["x_std"].values).mean())
        nees.append(np.einsum("ki,kij,kj->k", e, np.linalg.inv(result["P"].values), e).mean())
    assert 0.985 < np.mean(inside) < 0.9995
    assert 1.7 < np.mean(nees) < 2.3


def test_the_unscented_smoother_is_the_textbooks():
    """Särkkä's recursion from the results of the filter, for the same sigma points."""
    model, recording, _ = pendulum(1, n=25)
    dt, n = float(recording.attrs["dt"]), 2
    per_sample = bs.Noise(sigma_y=0.05, Q=np.diag([0.0, 0.25]) * dt)
    ukf = UKF(**PENDULUM | {"noise": per_sample})
    result = bs.smooth(ukf, model, recording, engine="vm")
    filtered = bs.estimate(ukf, model, recording, engine="vm")

    def moved(x):
        for _ in range(2):
            h = dt / 2

            def f(z):
                return np.array([z[1], -9.81 * np.sin(z[0]) - 0.2 * z[1]])

            a = f(x)
            b = f(x + h / 2 * a)
            c = f(x + h / 2 * b)
            x = x + h / 6 * (a + 2 * b + 2 * c + f(x + h * c))
        return x

    w = np.full(2 * n + 1, 0.5 / n)  # alpha = 1, beta = 2, kappa = 0
    w_mean, w_cov = w.copy(), w.copy()
    w_mean[0], w_cov[0] = 0.0, 2.0
    xs, Ps = filtered["x_hat"].values.copy(), filtered["P"].values.copy()
    for k in reversed(range(len(xs) - 1)):
        L = np.linalg.cholesky(Ps[k]) * np.sqrt(n)
        points = np.vstack([xs[k], xs[k] + L.T, xs[k] - L.T])
        images = np.array([moved(x) for x in points])
        mean = w_mean @ images
        spread, cross = images - mean, points - xs[k]
        P_next = (w_cov[:, None] * spread).T @ spread + np.diag([0.0, 0.25]) * dt
        gain = (w_cov[:, None] * cross).T @ spread @ np.linalg.inv(P_next)
        xs[k] += gain @ (xs[k + 1] - mean)
        Ps[k] += gain @ (Ps[k + 1] - P_next) @ gain.T
    assert_smoothed(result, xs, Ps, tol=1e-9)


@pytest.mark.parametrize("kind", [MHE, MHO, LinearMHE])
def test_windows_say_what_to_smooth_with(kind):
    model, recording, _ = pendulum(0, n=20)
    window = kind(PENDULUM["noise"], PENDULUM["prior"], N=5)
    with pytest.raises(TuningError, match=r"no smoother.*KalmanFilter.*EKF.*JointInput.*lag"):
        bs.smooth(window, model, recording)


def test_a_filter_that_is_another_does_not_smooth_as_its_base():
    class Other(EKF):
        def build(self, model, dt):
            return super().compile(model, dt)

    model, recording, _ = pendulum(0, n=20)
    with pytest.raises(TuningError, match="Other is another filter than EKF"):
        bs.smooth(Other(**PENDULUM), model, recording)


def test_continuous_measurements_are_refused():
    model, recording, _ = pendulum(0, n=20)
    with pytest.raises(TuningError, match="use 'sampled'"):
        bs.smooth(EKF(**PENDULUM, measurement="continuous"), model, recording)


def test_bounds_hold_and_are_told():
    p = dataclasses.replace(random_plant(9, nx=1, ny=1), x0=np.zeros(1))
    u, y = data_of(p, 15, missing=0.0)
    model = model_of(p)
    bounded = dataclasses.replace(model.states[0], lower=-0.2, upper=0.2)
    result = bs.smooth(
        KalmanFilter(**assumed(p)),
        dataclasses.replace(model, states=(bounded,)),
        recording_of(u, y),
        engine="vm",
    )
    at_bound = np.abs(result["x_hat"].values[:, 0]) == 0.2
    assert at_bound.any()
    assert np.abs(result["x_hat"]).max() <= 0.2
    assert (result["status"].values[at_bound] & int(Status.CLIPPED)).all()


def test_what_diverged_is_said_with_the_results():
    model = bs.from_equations(
        states={"x": ""}, inputs={}, outputs={"y": ""}, equations={"x": "x**3"},
        output_equations={"y": "x"}, dt=1.0,
    )  # fmt: skip
    y = np.full((20, 1), np.nan)
    recording = bs.from_arrays(u=np.zeros((20, 0)), y=y, dt=1.0, inputs={}, outputs={"y": ""})
    ekf = EKF(bs.Noise(sigma_y=1.0), bs.Prior(x0={"x": 10.0}, sigma_x0=1.0))
    with pytest.raises(EstimationError, match="no longer finite") as caught:
        bs.smooth(ekf, model, recording, engine="vm")
    assert caught.value.results.attrs["smoothed"] == 1
    assert (caught.value.results["status"] & int(Status.NOT_FINITE)).any()


def test_the_example_of_the_page_runs_and_pays(capsys):
    page = Path(__file__).parents[2] / "docs" / "smoothing.md"
    _, _, code = page.read_text(encoding="utf-8").partition("```python\n")
    exec(code.partition("```")[0], {})
    filtered, smoothed = (float(line.split()[0]) for line in capsys.readouterr().out.splitlines())
    assert smoothed < 0.4 * filtered
