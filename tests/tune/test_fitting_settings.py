"""Settings, whole covariances and delays as inputs are what they are in the descriptions."""

import dataclasses

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import TuningError
from backsight.run.estimation import match
from backsight.tune import Choice, Free, MultiStep, fit
from backsight.tune.fitting.runners import Rebuilt, lanes_of
from backsight.tune.fitting.values import unknowns_of
from tune import noisy_motion

MODEL = bs.sdof(k=100.0, b=0.5)
PRIOR = bs.Prior(sigma_x0=0.1)
TAILS = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-2}, outliers=bs.settings.StudentT(nu=4.0))
NOISE = dataclasses.replace(TAILS, outliers=None)
HUBER = dataclasses.replace(TAILS, outliers=bs.settings.Huber())
FULL = bs.Noise(R=[[1e-6]], Q=np.diag([1e-8, 1e-4]))

TWO = bs.Model(
    f=lambda x, u, p: [x.v, -p.k * x.q - 0.5 * x.v + u.u],
    h=lambda x, _u, _p: [x.q, x.v],
    states={"q": "m", "v": "m/s"},
    inputs={"u": "N"},
    outputs={"y1": "m", "y2": "m/s"},
    parameters={"k": 100.0},
)


@pytest.fixture(scope="module")
def recording():
    found = noisy_motion.oscillation(160, seed=2, sigma_w={"q": 0.0, "v": 1e-2})
    found["y"][60:66] = np.nan
    found["y"][[20, 90]] += 0.05
    return found


def both_ways(estimator, model, recording, free):
    """Innovations and variances by lanes, and with the values in the descriptions."""
    unknowns = unknowns_of(free, estimator, model)
    u, y, mask = match(model, recording, estimator=estimator)
    data, dt = (u, y, mask, y, mask), float(recording.attrs["dt"])
    starts = {n.name: n.start for n in unknowns}
    settings = [starts, {n.name: n.scale.value(0.4) for n in unknowns}]
    lanes = lanes_of(estimator, model, dt, unknowns)
    assert lanes is not None
    (fast,) = lanes.innovations(data, settings)
    (slow,) = Rebuilt(estimator, model, unknowns, dt).innovations(data, settings)
    return fast, slow


CASES = {
    "alpha": (bs.MHO(NOISE, PRIOR, N=4, alpha=0.1), ["alpha", "sigma_w", "sigma_y"]),
    "alpha, filters": (bs.MHO(NOISE, PRIOR, N=4, alpha=0.1, bands="filters"), ["alpha"]),
    "arrival": (bs.LinearMHE(NOISE, PRIOR, N=6, arrival_weight=0.5), ["arrival_weight"]),
    "walks of a window": (
        bs.LinearMHE(NOISE, PRIOR, N=6, arrival_weight=0.5),
        ["sigma_w", "sigma_y"],
    ),
    "full Q of a window": (bs.LinearMHE(FULL, PRIOR, N=6), [Free("Q", structure="full")]),
    "gain": (bs.HGO(NOISE, PRIOR, gain=20.0), ["gain"]),
    "nu": (bs.KalmanFilter(TAILS, PRIOR), ["noise.outliers.nu", "sigma_w"]),
    "k": (bs.EKF(HUBER, PRIOR, bs.Integrator("rk4", 2)), ["noise.outliers.k"]),
    "full Q": (bs.KalmanFilter(FULL, PRIOR), [Free("Q", structure="full"), "R"]),
}


@pytest.mark.parametrize("name", CASES)
def test_values_as_inputs_are_those_in_the_description(name, recording):
    estimator, names = CASES[name]
    free = [Free(n) if isinstance(n, str) else n for n in names]
    fast, slow = both_ways(estimator, MODEL, recording, free)
    assert np.abs(fast[0][1] - fast[0][0]).max() > 1e-8  # the values do something
    np.testing.assert_allclose(fast[0], slow[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(fast[1], slow[1], rtol=1e-7)


def two_sensors(samples, *, seed, R, late=0.0):
    """Both outputs with correlated noise, the second one late."""
    fine = 10
    rng, dt = np.random.default_rng(seed), 0.01
    u = np.repeat(rng.standard_normal((samples, 1)), fine, axis=0)
    clean = bs.simulate(TWO, u, dt=dt / fine)["y"].values
    shift = round(late / dt * fine)
    places = np.arange(samples) * fine
    y = np.column_stack([clean[places, 0], clean[np.maximum(places - shift, 0), 1]])
    y += rng.multivariate_normal(np.zeros(2), R, samples)
    return bs.from_arrays(
        dt=dt, u=u[::fine], y=y, inputs={"u": "N"}, outputs={"y1": "m", "y2": "m/s"}
    )


CORRELATED = np.array([[1e-6, 6e-6], [6e-6, 1e-4]])


def test_correlation_of_sensors_is_found_with_its_deviation():
    recording = two_sensors(700, seed=0, R=CORRELATED)
    start = bs.Noise(R=np.diag([1e-5, 1e-5]), sigma_w={"v": 1e-3})
    free = [Free("R", structure="full"), "sigma_w"]
    found = fit(bs.KalmanFilter(start, PRIOR), TWO, recording, free=free, check=False, restarts=0)
    for name, truth in (("R.y1", 1e-6), ("R.y2", 1e-4), ("R.y2.y1", 0.6)):
        assert abs(found.values[name] - truth) < 4 * found.std[name] < 0.6 * truth
    np.testing.assert_allclose(np.diag(found.estimator.noise.R), [1e-6, 1e-4], rtol=0.2)
    assert found.estimator.noise.sigma_y is None
    result = bs.estimate(found.estimator, TWO, recording, engine="vm")
    assert bs.check.mean_nis(result) == pytest.approx(2.0, abs=0.2)


def test_full_covariance_in_lanes_is_the_one_in_the_description():
    recording = two_sensors(80, seed=1, R=CORRELATED)
    recording["y"][30:35, 1] = np.nan
    noise = bs.Noise(R=CORRELATED, Q=np.array([[1e-8, 2e-8], [2e-8, 1e-6]]))
    free = [Free("R", structure="full"), Free("Q", structure="full")]
    for method in (bs.KalmanFilter, bs.IEKF):
        fast, slow = both_ways(method(noise, PRIOR), TWO, recording, free)
        np.testing.assert_allclose(fast[0], slow[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(fast[1], slow[1], rtol=1e-8)


def test_structure_names_blocks():
    noise = bs.Noise(sigma_y=1e-3, Q=np.diag([1e-8, 1e-4]))

    def names(structure):
        free = [Free("Q", structure=structure)]
        return [u.name for u in unknowns_of(free, bs.KalmanFilter(noise, PRIOR), MODEL)]

    assert names("diagonal") == ["Q.q", "Q.v"]
    assert names("full") == ["Q.q", "Q.v.q", "Q.v"]
    assert names(("a", "b")) == ["Q.q", "Q.v"]
    with pytest.raises(TuningError, match="give the block of every one of q, v"):
        names(("a",))
    with pytest.raises(TuningError, match="has no structure"):
        Free("sigma_y", structure="full")
    singular = bs.Noise(sigma_y=1e-3, Q=np.ones((2, 2)))
    with pytest.raises(TuningError, match="starts singular"):
        unknowns_of([Free("Q", structure="full")], bs.KalmanFilter(singular, PRIOR), MODEL)


def test_delay_of_the_only_output_is_found_with_its_deviation():
    late = 0.013
    rng, fine, dt, n = np.random.default_rng(3), 10, 0.01, 600
    u = np.repeat(rng.standard_normal((n, 1)), fine, axis=0)
    clean = bs.simulate(MODEL, u, dt=dt / fine)["y"].values[:, 0]
    places = np.clip(np.arange(n) * fine - round(late / dt * fine), 0, None)
    y = clean[places] + 1e-5 * rng.standard_normal(n)
    recording = bs.from_arrays(
        dt=dt, u=u[::fine], y=y[:, None], inputs={"u": "N"}, outputs={"y": "m"}
    )
    ekf = bs.KalmanFilter(bs.Noise(sigma_y=1e-4, sigma_w={"v": 1e-3}), PRIOR)
    free = ["sigma_y", "sigma_w", Free("delay.y", sigma=0.01)]
    found = fit(ekf, MODEL, recording, free=free, check=False, restarts=0)
    assert abs(found.values["delay.y"] - late) < max(4 * found.std["delay.y"], 3e-4)
    assert found.std["delay.y"] < 1e-3
    assert found.delays == {"u": pytest.approx(-found.values["delay.y"])}


def test_delay_of_one_sensor_of_two_is_found_with_its_deviation():
    recording = two_sensors(600, seed=4, R=np.diag([1e-8, 1e-6]), late=0.004)
    ekf = bs.EKF(bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}), PRIOR, bs.Integrator("rk4", 2))
    free = ["sigma_y", "sigma_w", "k", Free("delay.y2", sigma=0.005)]
    found = fit(ekf, TWO, recording, free=free, check=False, restarts=0)
    assert abs(found.values["delay.y2"] - 0.004) < 4 * found.std["delay.y2"] < 2e-3
    assert found.delays == {"y2": found.values["delay.y2"]}
    alone = [Free("delay.y2", sigma=0.005)]
    behind = fit(bs.MHE(ekf.noise, PRIOR, N=3, lag=1), TWO, recording, free=alone, check=False)
    assert abs(behind.values["delay.y2"] - 0.004) < 4 * behind.std["delay.y2"] < 2e-3
    with pytest.raises(TuningError, match="one output of several"):
        fit(bs.RecursiveMHE(ekf.noise, PRIOR, N=3), TWO, recording, free=alone)


def test_delays_that_cannot_be_are_refused(recording):
    kf = bs.KalmanFilter(NOISE, PRIOR)
    with pytest.raises(TuningError, match="say how large it may be"):
        fit(kf, MODEL, recording, free=["delay.u"])
    with pytest.raises(TuningError, match=r"'delay\.z' cannot be free"):
        fit(kf, MODEL, recording, free=[Free("delay.z", sigma=0.1)])


def test_weights_share_a_program_when_they_are_options():
    recording = noisy_motion.oscillation(300, seed=2)
    mho = bs.MHO(NOISE, PRIOR, N=4, alpha=1.0, bands="filters")
    choices = [Choice("alpha", (1e-3, 1.0, 30.0)), Choice("N", (2, 4))]
    criterion = MultiStep(ahead=20)
    found = fit(mho, MODEL, recording, free=choices, criterion=criterion)
    cost = found.choices["cost"].to_series()
    assert cost.idxmin() == f"{found.chosen['alpha']}, {found.chosen['N']}"
    # By another route: the model alone from the estimates of a run of its own.
    result = bs.estimate(mho, MODEL, recording, engine="vm")
    A, B = exact(0.01)
    x, u, y = (np.array(result["x_hat"]), recording["u"].values, recording["y"].values)
    later = x[:-20]
    for k in range(20):
        later = later @ A.T + u[k : len(u) - 20 + k] @ B.T
    missed = y[20:, 0] - later[:, 0]
    # What comes before a window is full is not judged.
    expected = 0.5 * np.log(np.mean(missed[4:] ** 2))
    assert cost["1.0, 4"] == pytest.approx(expected, rel=1e-6)


def exact(dt):
    """Transition of the oscillator over a sample with a held force."""
    joint = scipy.linalg.expm(dt * np.array([[0, 1, 0], [-100, -0.5, 1], [0, 0, 0]]))
    return joint[:2, :2], joint[:2, 2:]


def test_rounding_of_readings_is_counted_once():
    output = dataclasses.replace(MODEL.outputs[0], resolution=1e-3)
    model = dataclasses.replace(MODEL, outputs=(output,))
    recording = noisy_motion.oscillation(600, seed=5, sigma_w={"q": 0.0, "v": 1e-2})
    found = fit(bs.KalmanFilter(NOISE, PRIOR), model, recording, free=["sigma_y"], check=False)
    total = float(np.sqrt(found.estimator.noise.measurement(model)[0, 0]))
    assert total == pytest.approx(found.values["sigma_y.y"], rel=1e-9)


def test_noise_of_a_force_with_dynamics_is_left_to_the_model():
    pushed = bs.augment(
        MODEL, disturbances={"w": "v"}, forces={"w": bs.forces.Matern(1.0, length=0.1)}
    )
    recording = noisy_motion.oscillation(120, seed=5)
    estimator = bs.KalmanFilter(NOISE, bs.Prior(sigma_x0={"q": 0.1, "v": 0.1}))
    fast, slow = both_ways(estimator, pushed, recording, [Free("sigma_w.v"), Free("sigma_y")])
    np.testing.assert_allclose(fast[0], slow[0], rtol=0, atol=1e-9)
    found = fit(estimator, pushed, recording, free=["sigma_w"], check=False, restarts=0)
    assert set(found.values) == {"sigma_w.v"}
    assert found.estimator.noise.sigma_w == {"v": pytest.approx(found.values["sigma_w.v"])}
