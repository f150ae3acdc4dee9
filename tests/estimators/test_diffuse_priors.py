"""Priors far wider than the noise: against rational arithmetic, which rounds nothing."""

from fractions import Fraction

import numpy as np
import pytest

import backsight as bs
from backsight.estimators import ESTIMATORS
from backsight.models.lti import lti
from relations.linear import Run

DT, N = Fraction(1, 128), 12
A = np.array([[1.0, float(DT)], [-0.125, 0.9375]])
WALK = 2.0**-27


def exact(H, R, start, Y):
    """Means and standard deviations of the Kalman filter, scalar by scalar, in fractions."""
    F = [[Fraction(v) for v in row] for row in A]
    m, P = [Fraction(0)] * 2, [[Fraction(start[0]) ** 2, 0], [0, Fraction(start[1]) ** 2]]
    means, deviations = [], []
    for y in Y:
        for h, r, value in zip(H, R, y, strict=True):
            Ph = [P[i][0] * Fraction(h[0]) + P[i][1] * Fraction(h[1]) for i in (0, 1)]
            S = Fraction(h[0]) * Ph[0] + Fraction(h[1]) * Ph[1] + Fraction(r) ** 2
            e = Fraction(value) - Fraction(h[0]) * m[0] - Fraction(h[1]) * m[1]
            m = [m[i] + Ph[i] * e / S for i in (0, 1)]
            P = [[P[i][j] - Ph[i] * Ph[j] / S for j in (0, 1)] for i in (0, 1)]
        means.append([float(v) for v in m])
        deviations.append([float(P[i][i]) ** 0.5 for i in (0, 1)])
        m = [F[i][0] * m[0] + F[i][1] * m[1] for i in (0, 1)]
        FP = [[sum(F[i][k] * P[k][j] for k in (0, 1)) for j in (0, 1)] for i in (0, 1)]
        P = [[sum(FP[i][k] * F[j][k] for k in (0, 1)) for j in (0, 1)] for i in (0, 1)]
        P[1][1] += Fraction(WALK) ** 2
    return np.array(means), np.array(deviations)


def posed(H, R):
    """Model, noise and a recording."""
    rng, x, Y = np.random.default_rng(0), np.array([2e-6, 1e-4]), []
    for _ in range(N):
        Y.append(H @ x + R * rng.standard_normal(len(R)))
        x = A @ x
    outputs = {f"y{i}": "" for i in range(len(R))}
    model = lti(
        A, np.zeros((2, 0)), H, states={"q": "", "v": ""}, inputs=(), outputs=outputs, dt=float(DT)
    )
    return model, bs.Noise(sigma_y=R, sigma_w=[0.0, WALK]), np.array(Y)


SENSORS = {
    "one": (np.array([[1.0, 0]]), np.array([2.0**-30])),
    "two equal": (np.array([[1.0, 0], [1, 0]]), np.array([2.0**-30] * 2)),
    "two unequal": (np.array([[1.0, 0], [1, 0]]), np.array([2.0**-30, 2.0**-27])),
}


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("width", [2.0**-10, 1.0, 2.0**10, 2.0**20])
@pytest.mark.parametrize("method", ["kf", "ekf", "iekf"])
def test_filters_keep_what_they_know(method, sensors, width):
    """Widths from a million to a million billion times the noise."""
    H, R = SENSORS[sensors]
    model, noise, Y = posed(H, R)
    prior = bs.Prior(sigma_x0=[width, 128 * width])
    made = {"kf": bs.KalmanFilter, "ekf": bs.EKF, "iekf": bs.IEKF}[method](noise, prior)
    means, deviations = exact(H, R, [width, 128 * width], Y)
    result = Run(made, model, float(DT))(np.zeros((N, 0)), Y)
    found = np.sqrt(np.diagonal(result["P"], axis1=1, axis2=2))
    np.testing.assert_allclose(found, deviations, rtol=1e-9)
    assert np.abs((result["x_hat"] - means) / deviations).max() < 1e-6
    assert not result["status"].any()


def test_the_factor_is_the_covariance(monkeypatch):
    """A nonlinear model with a density and ramps, both ways, where both are exact enough."""
    from backsight.estimators.kalman import square_root

    model = bs.duffing(k1=60.0, d=1.0, k3=400.0)
    rng, n = np.random.default_rng(1), 50
    u, y = rng.standard_normal((n, 1)), 0.1 * rng.standard_normal((n, 1))
    y[[3, 17]] = np.nan
    for given in ({"Qc": np.diag([0.0, 0.5])}, {"sigma_w": {"v": 0.1}}):
        noise, prior = bs.Noise(sigma_y=0.05, **given), bs.Prior(sigma_x0=[0.5, 1.0])
        for steps in (bs.Integrator("rk4", 3, "foh"), bs.Integrator("rk4", 2)):
            made = bs.EKF(noise, prior, steps)
            plain = Run(made, model, 0.05)(u, y)
            with monkeypatch.context() as patch:
                patch.setattr(square_root.wide, "__kwdefaults__", {"limit": 1e-3})
                root = Run(made, model, 0.05)(u, y)
            assert not np.array_equal(plain["P"], root["P"])
            for name in ("x_hat", "P", "e", "S"):
                np.testing.assert_allclose(root[name], plain[name], rtol=1e-8, atol=1e-10)


def test_interpolated_inputs_of_linear_models(monkeypatch):
    from backsight.estimators.kalman import square_root

    model = bs.sdof(k=60.0, b=1.0)
    rng, n = np.random.default_rng(2), 40
    u, y = rng.standard_normal((n, 1)), 0.1 * rng.standard_normal((n, 1))
    made = bs.KalmanFilter(
        bs.Noise(sigma_y=0.05, sigma_w={"v": 0.1}), bs.Prior(sigma_x0=[0.5, 1.0]), hold="foh"
    )
    plain = Run(made, model, 0.05)(u, y)
    monkeypatch.setattr(square_root.wide, "__kwdefaults__", {"limit": 1e-3})
    root = Run(made, model, 0.05)(u, y)
    np.testing.assert_allclose(root["x_hat"], plain["x_hat"], atol=1e-12)
    np.testing.assert_allclose(root["P"], plain["P"], rtol=1e-10, atol=1e-16)


def test_covariances_that_cannot_hold_it_are_refused():
    H, R = SENSORS["two equal"]
    model, noise, _ = posed(H, R)
    for kind in (bs.MHO, bs.MHE, bs.LinearMHE):
        kind(noise, bs.Prior(sigma_x0=1e-4)).compile(model, float(DT))
        with pytest.raises(bs.errors.TuningError, match="narrow the prior"):
            kind(noise, bs.Prior(sigma_x0=10.0)).compile(model, float(DT))


def test_an_iterated_filter_that_keeps_a_covariance_refuses_them():
    model = bs.sdof(k=60.0, b=1.0)
    iekf = bs.IEKF(bs.Noise(sigma_y=2.0**-30), bs.Prior(sigma_x0=10.0), covariance="ode")
    with pytest.raises(bs.errors.TuningError, match="narrow the prior"):
        iekf.compile(model, float(DT))


@pytest.mark.parametrize("kind", ["joint_input", "csmhe"])
def test_estimators_of_forces_refuse_them_too(kind):
    plant = bs.Model(
        f=lambda x, u, p: [x.v, -400 * x.q - 2 * x.v + p.push],
        h=lambda x, u, p: [x.q],
        states={"q": "", "v": ""},
        outputs={"y": ""},
        parameters={"push": 0.0},
    )
    more = {"csmhe": {"lam": 1.0}}.get(kind, {})
    made = [
        ESTIMATORS[kind](bs.Noise(sigma_y=1e-9), bs.Prior(sigma_x0=s), forces=("push",), **more)
        for s in (1e-4, 10.0)
    ]
    made[0].compile(plant, 0.01)
    with pytest.raises(bs.errors.TuningError, match="narrow the prior"):
        made[1].compile(plant, 0.01)


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("width", [2.0**-17, 2.0**-13, 2.0**-10])
@pytest.mark.parametrize("kind", ["smoothed", "EKF", "whole"])
def test_windows_are_right_up_to_a_million_times_the_noise(kind, width, sensors):
    H, R = SENSORS[sensors]
    model, noise, Y = posed(H, R)
    prior = bs.Prior(sigma_x0=[width, 128 * width])
    made = {
        "smoothed": bs.MHE(noise, prior, N=5),
        "EKF": bs.MHE(noise, prior, N=5, arrival=bs.settings.EKFArrival()),
        "whole": bs.LinearMHE(noise, prior, N=5, arrival_weight=1.0),
    }[kind]
    means, deviations = exact(H, R, [width, 128 * width], Y)
    result = Run(made, model, float(DT))(np.zeros((N, 0)), Y)
    found = np.sqrt(np.diagonal(result["P"], axis1=1, axis2=2))
    np.testing.assert_allclose(found, deviations, rtol=1e-3)
    assert np.abs((result["x_hat"] - means) / deviations).max() < 1e-3


@pytest.mark.parametrize("width", [2.0**-17, 2.0**-13, 2.0**-10])
def test_a_window_without_arrival_cost_forgets_a_wide_prior(width):
    """It gave bands twice as wide, and was 1.5 of them off, from 10^5 times the noise on."""
    H, R = SENSORS["two unequal"]
    model, noise, Y = posed(H, R)
    prior = bs.Prior(sigma_x0=[width, 128 * width])
    alone, by_points = (
        Run(e, model, float(DT))(np.zeros((N, 0)), Y)
        for e in (
            bs.LinearMHE(noise, prior, N=5),
            bs.MHE(noise, prior, N=5, arrival=bs.settings.NoArrival()),
        )
    )
    spread, theirs = (
        np.sqrt(np.diagonal(r["P"], axis1=1, axis2=2))[6:] for r in (by_points, alone)
    )
    np.testing.assert_allclose(spread, theirs, rtol=1e-3)
    assert np.abs((by_points["x_hat"] - alone["x_hat"])[6:] / theirs).max() < 1e-3
