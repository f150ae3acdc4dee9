"""Process noise that an input multiplies is the same noise, compiled once."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.estimators.varied_noise import NoisePart, VariedNoise

DT, FACTOR = 0.01, 3.0
Q = np.diag([1e-4, 2e-2])


def plant():
    """An oscillator whose scales do not depend on its noise."""
    plain = bs.sdof(k=100.0, b=0.5)
    states = [dataclasses.replace(s, scale=1.0) for s in plain.states]
    outputs = [dataclasses.replace(s, scale=1.0) for s in plain.outputs]
    return dataclasses.replace(plain, states=tuple(states), outputs=tuple(outputs))


def with_factor(model):
    """The same with one more input, that does nothing in it."""
    x, p = ca.SX.sym("x", model.nx), ca.SX.sym("p", len(model.parameters))
    u = ca.SX.sym("u", model.nu + 1)
    given = [x, u[: model.nu], p]
    return dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], model.f.call(given)),
        h=ca.Function("h", [x, u, p], model.h.call(given)),
        inputs=(*model.inputs, bs.Signal(name="factor")),
    )


def recording(model, factor=None):
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((60, 1)), rng.standard_normal((60, 1))
    y[20:25] = np.nan
    u = u if factor is None else np.hstack([u, np.full_like(u, factor)])
    return bs.from_arrays(
        dt=DT, u=u, y=y, inputs={s.name: s.unit for s in model.inputs}, outputs={"y": "m"}
    )


MAKERS = {
    "kf": bs.KalmanFilter,
    "kf foh": lambda n, p: bs.KalmanFilter(n, p, hold="foh"),
    "ekf exact": bs.EKF,
    "ekf": lambda n, p: bs.EKF(n, p, bs.Integrator("rk4", 2, hold="foh")),
    "ekf discrete": lambda n, p: bs.EKF(n, p, bs.Integrator("rk4", 2), covariance="discrete"),
    "ekf ode": lambda n, p: bs.EKF(n, p, bs.Integrator("rk4", 2), covariance="ode"),
    "bucy": lambda n, p: bs.EKF(n, p, bs.Integrator("rk4", 2), measurement="continuous"),
    "iekf": bs.IEKF,
    "ukf": bs.UKF,
    "mhe": lambda n, p: bs.MHE(n, p, N=2, arrival=bs.settings.EKFArrival()),
}


BOTH = [(name, "Q") for name in MAKERS] + [(name, "Qc") for name in ("kf foh", "ekf", "ekf ode")]


@pytest.mark.parametrize(("name", "word"), [*BOTH, ("ekf discrete", "Qc"), ("ukf", "Qc")])
def test_factor_is_that_of_the_standard_deviation(name, word):
    make, model, prior = MAKERS[name], plant(), bs.Prior(sigma_x0=1.0)
    wide = with_factor(model)
    rest = np.diag([1e-3, 0.0])
    fixed = bs.Noise(sigma_y=0.3, **{word: rest + FACTOR**2 * Q})
    part = NoisePart(("factor", "factor"), **{word: Q})
    varied = VariedNoise(sigma_y=0.3, parts=(part,), **{word: rest})
    a = bs.estimate(make(fixed, prior), model, recording(model), engine="vm")
    b = bs.estimate(make(varied, prior), wide, recording(wide, FACTOR), engine="vm")
    for variable in ("x_hat", "P", "S"):
        np.testing.assert_allclose(b[variable], a[variable], rtol=1e-11, atol=1e-13)


def test_methods_that_would_not_see_it_refuse():
    model = with_factor(plant())
    varied = VariedNoise(sigma_y=0.3, parts=(NoisePart(("factor", "factor"), Q=Q),))
    for method in (bs.RecursiveMHE(varied, bs.Prior(sigma_x0=1.0), N=3),
                   bs.KalmanFilter(varied, bs.Prior(sigma_x0=1.0), steady_state=True)):  # fmt: skip
        with pytest.raises(TuningError, match="takes no process noise that inputs multiply"):
            method.compile(model, DT)


def test_a_factor_must_be_an_input():
    varied = VariedNoise(sigma_y=0.3, parts=(NoisePart(("factor", "factor"), Q=Q),))
    with pytest.raises(TuningError, match="no input 'factor'"):
        bs.EKF(varied, bs.Prior(sigma_x0=1.0)).compile(plant(), DT)


@pytest.mark.parametrize("make", [bs.KalmanFilter, bs.EKF, bs.IEKF, bs.UKF])
def test_memory_of_another_prior(make):
    model, noise = plant(), bs.Noise(sigma_y=0.3, sigma_w={"v": 0.1})
    one, other = bs.Prior(sigma_x0=1.0), bs.Prior(sigma_x0={"q": 0.3, "v": 2.0}, x0={"q": 0.5})
    start = make(noise, one).compile(model, DT).start
    expected = make(noise, other).compile(model, DT).carry0
    np.testing.assert_allclose(start(other.mean(model), other.covariance(model)), expected)
