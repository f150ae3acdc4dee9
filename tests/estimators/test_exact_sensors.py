"""Sensors without noise: R is only positive semidefinite."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.estimators import ESTIMATORS
from backsight.schema import Status
from backsight.testing import CASES
from estimators.exact_plants import DT, FILTERS, P0, SENSORS, A, N, Q, conditioned, drawn, plant

EKF, UKF = bs.settings.EKFArrival(), bs.settings.UKFArrival()
WINDOWS = {
    "mhe": lambda noise, prior: bs.MHE(noise, prior, N=4),
    "mhe, EKF arrival": lambda noise, prior: bs.MHE(noise, prior, N=4, arrival=EKF),
    "mhe, UKF arrival": lambda noise, prior: bs.MHE(noise, prior, N=4, arrival=UKF),
    "lmhe": lambda noise, prior: bs.LinearMHE(noise, prior, N=4, arrival_weight=1.0),
}

EXACT = (*FILTERS, bs.MHE, bs.JointInput, bs.LinearMHE, bs.RecursiveMHE)
"""Methods that take them."""

WALK = np.diag([1e-4, 4e-4])
"""Process noise of both states."""

OFTEN = ("noisy one first", "two of one thing")
"""Of the filter that shares the others' formulas."""
FILTERED = [
    pytest.param(
        sensors,
        method,
        id=f"{method.key}-{sensors}",
        marks=pytest.mark.slow if method is bs.IEKF and sensors not in OFTEN else (),
    )
    for method in FILTERS
    for sensors in SENSORS
]


@pytest.mark.parametrize(("sensors", "method"), FILTERED)
def test_estimates_are_those_of_conditioning(sensors, method):
    C, R = (np.array(given) for given in SENSORS[sensors])
    y = drawn(C, R)
    names = {f"y{i}": "m" for i in range(len(C))}
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs=names)
    estimator = method(bs.Noise(R=R, Q=Q), bs.Prior(P0=P0))
    result = bs.estimate(estimator, plant(C), recording, engine="vm", throw=False)
    x, P = conditioned(C, R, y)
    np.testing.assert_allclose(result["x_hat"].values, x, atol=1e-11)
    np.testing.assert_allclose(result["P"].values, P, atol=1e-11)
    told = result["status"].values & int(Status.REDUNDANT)
    if sensors.startswith("two"):  # as soon as both are there
        assert np.array_equal(told > 0, np.isfinite(y).all(axis=1))
    elif sensors != "both states":
        assert not told.any()


QUICK = {("mhe", "noisy one first"), ("mhe", "their difference"), ("lmhe", "two of one thing")}
EVERY = [
    pytest.param(window, sensors, marks=() if (window, sensors) in QUICK else pytest.mark.slow)
    for window in WINDOWS
    for sensors in SENSORS
]


@pytest.mark.parametrize(("window", "sensors"), EVERY)
def test_windows_take_exact_readings_as_equations(window, sensors):
    C, R = (np.array(given) for given in SENSORS[sensors])
    y = drawn(C, R)
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={f"y{i}": "m" for i in range(len(C))})
    estimator = WINDOWS[window](bs.Noise(R=R, Q=Q), bs.Prior(P0=P0))
    result = bs.estimate(estimator, plant(C), recording, engine="vm", throw=False)
    x, P = conditioned(C, R, y)
    np.testing.assert_allclose(result["x_hat"].values, x, atol=1e-12)
    np.testing.assert_allclose(result["P"].values, P, atol=1e-13)
    assert not result["status"].any()


@pytest.mark.parametrize(
    "sensors", [pytest.param(s, marks=() if s == "one" else pytest.mark.slow) for s in SENSORS]
)
def test_a_window_over_all_samples_is_the_smoother(sensors):
    C, R = (np.array(given) for given in SENSORS[sensors])
    y = drawn(C, R)
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={f"y{i}": "m" for i in range(len(C))})
    given = bs.Noise(R=R, Q=Q), bs.Prior(P0=P0)
    x, P = conditioned(C, R, y, smoothed=True)
    window = bs.solve_window(bs.MHE(*given, N=N - 1), plant(C), recording)
    np.testing.assert_allclose(window["x"].values, x, atol=1e-12)
    np.testing.assert_allclose(window["P"].values, P, atol=1e-11)
    late = bs.estimate(bs.MHE(*given, N=7, lag="N"), plant(C), recording, engine="vm")
    # What is left of the window after the last sample is that of the smoother.
    np.testing.assert_allclose(late["x_hat"].values[-8:], x[-8:], atol=1e-12)
    assert not late["status"].any()


@pytest.mark.parametrize("method", FILTERS, ids=lambda method: method.key)
def test_what_is_known_exactly_stays_so(method):
    """Two exact readings of a motion without noise tell all of it; the others are left out."""
    C = np.array([[1.0, 0.0]])
    x = np.array([[0.1, 0.5]])
    for _ in range(N - 1):
        x = np.vstack([x, A @ x[-1]])
    recording = bs.from_arrays(y=x[:, :1], dt=DT, inputs={}, outputs={"y0": "m"})
    estimator = method(bs.Noise(sigma_y=0.0), bs.Prior(P0=P0))
    result = bs.estimate(estimator, plant(C), recording, engine="vm", throw=False)
    np.testing.assert_allclose(result["x_hat"][1:], x[1:], atol=1e-12)
    assert np.abs(result["P"][1:]).max() < 1e-22
    assert np.array_equal(result["status"] > 0, np.arange(N) > 1)
    assert int(result["status"][-1]) == Status.REDUNDANT


def test_contradicting_sensors_say_so():
    y = drawn(np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    both = np.hstack([y, y + 0.3])
    names = {"y0": "m", "y1": "m"}
    recording = bs.from_arrays(y=both, dt=DT, inputs={}, outputs=names)
    kf = bs.KalmanFilter(bs.Noise(sigma_y=0.0, Q=Q), bs.Prior(P0=P0))
    result = bs.estimate(kf, plant([[1.0, 0.0], [1.0, 0.0]]), recording, engine="vm", throw=False)
    assert np.isfinite(result["x_hat"]).all()
    assert (result["status"].values[np.isfinite(both).all(axis=1)] & int(Status.REDUNDANT)).all()
    assert np.isnan(bs.check.nis(result).values[np.isfinite(both).all(axis=1)]).all()


@pytest.mark.parametrize("window", ["mhe", "lmhe"])
def test_windows_name_the_sensor_that_contradicts(window):
    y = drawn(np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    both = np.hstack([y, y + 0.3])
    recording = bs.from_arrays(y=both, dt=DT, inputs={}, outputs={"y0": "m", "y1": "m"})
    estimator = WINDOWS[window](bs.Noise(sigma_y=0.0, Q=Q), bs.Prior(P0=P0))
    model = plant([[1.0, 0.0], [1.0, 0.0]])
    result = bs.estimate(estimator, model, recording, engine="vm", throw=False)
    late = result.isel(time=slice(12, None))
    assert (late["status"] == int(Status.INFEASIBLE)).all()
    assert late["infeasible"].sel(limit="y1 (without noise)").all()
    assert not late["infeasible"].sel(limit="y0 (without noise)").any()
    np.testing.assert_allclose(late["x_hat"].sel(state="q"), y[12:, 0], atol=1e-12)


def test_an_exact_reading_and_a_bound_that_contradict_are_told():
    model = bs.lti(
        [[1.0]], np.zeros((1, 0)), [[1.0]], inputs={}, outputs={"y": ""}, dt=1.0,
        states={"q": bs.Signal(upper=1.0)},
    )  # fmt: skip
    recording = bs.from_arrays(y=[0.5, 0.9, 1.5, 0.7], dt=1.0, inputs={}, outputs={"y": ""})
    mhe = bs.MHE(bs.Noise(sigma_y=0.0, sigma_w=0.3), bs.Prior(sigma_x0=1.0), N=1)
    result = bs.estimate(mhe, model, recording, engine="vm", throw=False)
    assert (result["status"].values & int(Status.INFEASIBLE) > 0).tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(result["x_hat"][:, 0], [0.5, 0.9, 1.5, 0.7], atol=1e-12)


def test_a_pendulum_with_an_exact_encoder_is_the_limit_of_small_noise():
    pendulum = bs.Model(
        f=lambda x, u, p: [x.w, -p.g * np.sin(x.phi) - 0.1 * x.w],
        h=lambda x, u, p: [x.phi],
        states={"phi": "rad", "w": "rad/s"},
        outputs={"phi": "rad"},
        parameters={"g": bs.Signal(value=8.0)},
    )
    joint = bs.augment(pendulum, ["g"])
    recording = bs.simulate(
        pendulum, np.zeros((60, 0)), dt=DT, x0=[1.0, 0.0], parameters={"g": 10.0}
    )
    prior = bs.Prior(sigma_x0=[0.5, 1.0, 3.0])
    for method, small in ((bs.EKF, 1e-9), (bs.IEKF, 1e-7), (bs.UKF, 1e-9), (bs.MHE, 1e-7)):
        found = [
            bs.estimate(
                method(bs.Noise(sigma_y=sigma, sigma_w={"w": 0.02}), prior),
                joint,
                recording,
                engine="vm",
            )
            for sigma in (0.0, small)
        ]
        np.testing.assert_allclose(found[0]["x_hat"], found[1]["x_hat"], atol=1e-5)
        np.testing.assert_allclose(found[0]["x_std"], found[1]["x_std"], atol=1e-5)


@pytest.mark.parametrize("sensors", ["one", "with a noisy one", "their difference"])
def test_the_gain_of_a_window_is_what_its_newest_reading_does_to_it(sensors):
    """By a window of the solver with nothing before it, whose last readings are moved by one."""
    C, R = (np.array(given) for given in SENSORS[sensors])
    y, noise, prior = drawn(C, R)[10:16], bs.Noise(R=R, Q=WALK), bs.Prior(P0=P0)
    window = bs.MHE(noise, prior, N=3, arrival=bs.settings.NoArrival())
    recursive = bs.RecursiveMHE(noise, prior, N=3)
    names = {f"y{i}": "m" for i in range(len(C))}

    def last(estimator, y):
        recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs=names)
        return bs.estimate(estimator, plant(C), recording, engine="vm")["x_hat"].values[-1]

    found = []
    for estimator in (window, recursive):
        at = last(estimator, y)
        found.append(
            [last(estimator, y + np.outer([0, 0, 0, 0, 0, 1], e)) - at for e in np.eye(len(C))]
        )
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)


def test_readings_that_contradict_each_other_whatever_happens_are_refused():
    still = bs.RecursiveMHE(bs.Noise(sigma_y=0.0), bs.Prior(P0=P0), N=4)
    with pytest.raises(TuningError, match="follow from each other, whatever the process noise"):
        still.compile(plant([[1.0, 0.0]]), DT)


@pytest.mark.parametrize("key", sorted(ESTIMATORS))
def test_every_estimator_takes_exact_sensors_or_says_who_does(key):
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, bs.Integrator("rk4", 1))
    given, _ = estimator.assumed
    without = bs.Noise(sigma_y=0.0, sigma_w=given.sigma_w, Q=given.Q)
    exact = dataclasses.replace(estimator, noise=without)
    if ESTIMATORS[key] in EXACT:
        exact.compile(problem.model, 0.02)
    else:
        with pytest.raises(TuningError, match=r"'position' has no noise .* EKF, IEKF and UKF"):
            exact.compile(problem.model, 0.02)
