"""Positive parameters: logarithms inside, units outside."""

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.schema import POSITIVE
from closeness import assert_close
from relations.linear import Run

DT, N = 0.02, 150
PRIOR = {"w": 0.1, "J": 1e-3}
NOISE = bs.Noise(sigma_y=0.02, sigma_w={"w": 1e-3})


def motor(*, positive: bool, dt: float | None = None) -> bs.Model:
    def f(x, u, p):
        rate = (u.M - 2e-3 * x.w) / p.J
        return [rate] if dt is None else [x.w + dt * rate]

    plain = bs.Model(
        f=f, h=lambda x, u, p: [x.w], states={"w": "rad/s"}, inputs={"M": "N m"},
        outputs={"y": "rad/s"}, dt=dt,
        parameters={"J": bs.Signal("kg m2", value=1e-3, positive=positive)},
    )  # fmt: skip
    return bs.augment(plain, ["J"])


def logarithm(dt: float | None = None) -> bs.Model:
    """The same with the logarithm written by hand, J = 1e-3 exp(z)."""

    def f(x, u, p):
        rate = (u.M - 2e-3 * x.w) / (1e-3 * ca.exp(p.z))
        return [rate] if dt is None else [x.w + dt * rate]

    plain = bs.Model(
        f=f, h=lambda x, u, p: [x.w], states={"w": "rad/s"}, inputs={"M": "N m"},
        outputs={"y": "rad/s"}, parameters={"z": 0.0}, dt=dt,
    )  # fmt: skip
    return bs.augment(plain, ["z"])


def recorded(J: float = 2.2e-3):
    u = 0.02 * np.sign(np.sin(0.15 * np.arange(N)))[:, None]
    plain = bs.Model(
        f=lambda x, u, p: [(u.M - 2e-3 * x.w) / p.J], h=lambda x, u, p: [x.w], states={"w": ""},
        inputs={"M": ""}, outputs={"y": ""}, parameters={"J": J},
    )  # fmt: skip
    return u, bs.simulate(plain, u, dt=DT, sigma_y=0.02, seed=3)["y"].values


ESTIMATORS = {
    "ekf": lambda noise, prior: bs.EKF(noise, prior),
    "iekf": lambda noise, prior: bs.IEKF(noise, prior),
    "ukf": lambda noise, prior: bs.UKF(noise, prior),
    "mhe": lambda noise, prior: bs.MHE(noise, prior, N=6),
    "mho": lambda noise, prior: bs.MHO(noise, prior, N=20),
}


@pytest.mark.parametrize("kind", ESTIMATORS)
@pytest.mark.parametrize("dt", [None, DT])
def test_it_is_the_logarithm_written_by_hand(kind, dt):
    u, y = recorded()
    y[20:24] = np.nan
    make = ESTIMATORS[kind]
    walk = 2e-6  # of the parameter, too
    noise = bs.Noise(sigma_y=0.02, sigma_w={"w": 1e-3, "J": walk})
    found = Run(make(noise, bs.Prior(PRIOR)), motor(positive=True, dt=dt), DT)(u, y)
    by_hand = bs.Noise(sigma_y=0.02, sigma_w={"w": 1e-3, "z": walk / 1e-3})
    prior = bs.Prior({"w": 0.1, "z": np.sqrt(np.log(2.0))})
    other = Run(make(by_hand, prior), logarithm(dt), DT)(u, y)
    J = 1e-3 * np.exp(other["x_hat"][:, 1])
    assert_close(found["x_hat"], np.column_stack([other["x_hat"][:, 0], J]), 1e-8)
    slope = np.column_stack([np.ones(N), J])
    assert_close(found["P"], other["P"] * slope[:, :, None] * slope[:, None, :], 1e-8)


def test_a_prior_that_reaches_zero_gives_a_positive_value_and_an_honest_band():
    """With 1e-3 +- 1e-3 as it is the inertia becomes negative in a part of all recordings."""
    u, y = recorded()
    for e in (make(NOISE, bs.Prior(PRIOR)) for make in ESTIMATORS.values()):
        x = Run(e, motor(positive=True), DT)(u, y)
        J, std = x["x_hat"][:, 1], np.sqrt(x["P"][:, 1, 1])
        assert (J > 0).all()
        assert abs(np.log(J[-1] / 2.2e-3)) < 3 * std[-1] / J[-1] < 0.2, e.key


def test_results_have_ends_of_bands():
    u, y = recorded()
    recording = bs.from_arrays(u=u, y=y, dt=DT, inputs={"M": "N m"}, outputs={"y": "rad/s"})
    e = bs.EKF(NOISE, bs.Prior(PRIOR))
    result = bs.estimate(e, motor(positive=True), recording, engine="vm")
    J = result.sel(state="J")
    ratio = J.x_high / J.x_hat
    np.testing.assert_allclose(ratio, J.x_hat / J.x_low)
    np.testing.assert_allclose(np.log(ratio), J.x_std / J.x_hat)
    w = result.sel(state="w")
    np.testing.assert_allclose(w.x_high - w.x_hat, w.x_std, atol=1e-12)
    assert result.attrs[POSITIVE] == "J"
    smoothed = bs.smooth(e, motor(positive=True), recording, engine="vm").sel(state="J")
    np.testing.assert_allclose(smoothed.x_hat[-1], J.x_hat[-1], rtol=1e-9)
    np.testing.assert_allclose(smoothed.x_std[-1], J.x_std[-1], rtol=1e-9)
    assert (smoothed.x_std <= J.x_std * (1 + 1e-9)).all()


def test_what_cannot_be_is_refused():
    with pytest.raises(TuningError, match="J: positive, but starts at zero or below"):
        bs.EKF(NOISE, bs.Prior(PRIOR, x0={"J": 0.0})).compile(motor(positive=True), DT)
