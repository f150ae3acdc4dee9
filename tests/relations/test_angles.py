"""Angles that start anew after a turn, and readings in steps."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import TuningError
from backsight.run.diagnosis import coarse_readings, turned_readings
from backsight.schema import Status
from backsight.testing import CASES, TrialProblem
from closeness import assert_close

TURN = 0.09  # the position of the trial problem swings through several of them


def wrapped(model, turn=TURN):
    """The model whose position starts anew."""
    first = dataclasses.replace(model.outputs[0], wrap=turn)
    return dataclasses.replace(model, outputs=(first, *model.outputs[1:]))


def starting_anew(recording, turn=TURN):
    y = recording["y"].copy()
    y[:, 0] = (y[:, 0] + turn / 2) % turn - turn / 2
    return recording.assign(y=y)


def swing(case, n=40):
    problem = case.problem
    data = problem.simulate(n, seed=3, hold="zoh", noisy=True)
    data.y[7:9, 0] = np.nan
    return problem, data.recording(problem.model)


@pytest.mark.parametrize("key", CASES)
def test_every_estimator_takes_the_shortest_way_round(key):
    case = CASES[key]
    problem, recording = swing(case)
    estimator = case.build(problem, Integrator("rk4", 1, "zoh"))
    told = starting_anew(recording)
    assert np.nanmax(np.abs(np.diff(told["y"].values[:, 0]))) > TURN / 2
    plain = bs.estimate(estimator, problem.model, recording, engine="vm")
    result = bs.estimate(estimator, wrapped(problem.model), told, engine="vm")
    for name in ("x_hat", "P", "e", "S", "y"):
        # Where nothing was measured there is neither an output nor an innovation.
        np.testing.assert_array_equal(np.isnan(result[name]), np.isnan(plain[name]))
        assert_close(np.nan_to_num(result[name].values), np.nan_to_num(plain[name].values), 1e-9)


def test_smoothers_outlier_rules_and_streams_go_along():
    problem, recording = swing(CASES["ekf"])
    told, model = starting_anew(recording), wrapped(problem.model)
    ekf = bs.EKF(problem.noise, problem.prior, integrator=Integrator("rk4", 1))
    plain = bs.smooth(ekf, problem.model, recording, engine="vm")
    result = bs.smooth(ekf, model, told, engine="vm")
    assert_close(result["x_hat"].values, plain["x_hat"].values, 1e-9)
    noise = dataclasses.replace(problem.noise, outliers=bs.settings.Gate())
    gated = dataclasses.replace(ekf, noise=noise)
    plain = bs.estimate(gated, problem.model, recording, engine="vm")
    result = bs.estimate(gated, model, told, engine="vm")
    assert_close(result["x_hat"].values, plain["x_hat"].values, 1e-9)
    np.testing.assert_array_equal(result["weight"], plain["weight"])
    live = bs.stream(gated, model, 0.02, engine="vm")
    for k in range(40):
        step = live.step(told["u"].values[k], told["y"].values[k])
    assert_close(step["x_hat"], result["x_hat"].values[-1], 1e-12)


def test_windows_that_look_back_keep_the_turns():
    problem, recording = swing(CASES["mhe"], n=20)
    mhe = bs.MHE(problem.noise, problem.prior, N=4, lag=2, integrator=Integrator("rk4", 1))
    plain = bs.estimate(mhe, problem.model, recording, engine="vm")
    result = bs.estimate(mhe, wrapped(problem.model), starting_anew(recording), engine="vm")
    assert_close(result["x_hat"].values, plain["x_hat"].values, 1e-7)
    problem = CASES["csmhe"].problem
    late = bs.CompressiveSensingMHE(problem.noise, problem.prior, forces=("push",), lam=100.0, N=4)
    with pytest.raises(TuningError, match="cannot take angles that start anew"):
        late.compile(wrapped(problem.model), 0.02)


def test_a_turn_that_is_guessed_is_said():
    problem, recording = swing(CASES["ekf"])
    ekf = bs.EKF(problem.noise, problem.prior, integrator=Integrator("rk4", 1))
    result = bs.estimate(ekf, wrapped(problem.model), starting_anew(recording), engine="vm")
    guessed = (result["status"].values & int(Status.TURN_GUESSED)) != 0
    sigma = np.sqrt(result["S"].values[:, 0, 0])
    measured = np.isfinite(recording["y"].values[:, 0])
    np.testing.assert_array_equal(guessed, measured & (3 * sigma > TURN / 2))
    assert guessed[0]  # by its prior the position may be several turns away
    assert not guessed[20:].any()


def test_a_rotating_encoder_has_its_speed():
    t = 0.01 * np.arange(600)
    rng = np.random.default_rng(0)
    y = (np.rad2deg(3.0 * t) + 0.5 * rng.standard_normal(600)) % 360
    recording = bs.from_arrays(y=y, dt=0.01, inputs={}, outputs={"y": "deg"})

    def shaft(**of_output):
        return bs.lti(
            [[0.0, 1.0], [0.0, 0.0]], np.zeros((2, 0)), [[1.0, 0.0]],
            states={"angle": "deg", "speed": "deg/s"}, inputs={},
            outputs={"y": bs.Signal("deg", **of_output)},
        )  # fmt: skip

    kf = bs.KalmanFilter(
        bs.Noise(sigma_y=0.5, sigma_w={"speed": 0.01}), bs.Prior(sigma_x0=[9.0, 300.0])
    )
    found = bs.compare({"KF": kf}, shaft(wrap=360.0), recording, engine="vm")
    last = found["KF"].isel(time=-1)
    assert abs(last["x_hat"][1] - np.rad2deg(3.0)) < 3 * last["x_std"][1]
    assert last["y"][0] == pytest.approx(np.rad2deg(3.0 * t[-1]), abs=3.0)
    assert turned_readings(shaft(wrap=360.0), recording) == []
    assert "turn" not in found.verdicts()[0]
    (told,) = turned_readings(shaft(), recording)
    assert "'y' jumps by nearly a turn (360.0) 2 times" in told
    assert "wrap = 360 on this output" in told
    wrong = bs.compare({"KF": kf}, shaft(), recording, engine="vm")
    assert told in wrong.verdicts()[0]


@pytest.mark.parametrize(
    "values",
    [
        np.repeat([0.0, 6.2], 50),  # a step
        np.tile([0.0, 6.3], 50),  # a signal that goes to and fro
        6.0 * np.sin(np.arange(100.0)),
        np.concatenate([np.linspace(0, 30, 50), np.linspace(24, 60, 50)]),
    ],
)
def test_other_jumps_are_no_turns(values):
    model = TrialProblem(k_known=True, outputs=("position",)).model
    model = dataclasses.replace(model, outputs=(dataclasses.replace(model.outputs[0], unit="mm"),))
    recording = bs.from_arrays(
        u=np.zeros(100), y=values, dt=0.02, inputs={"F": ""}, outputs={"position": "mm"}
    )
    assert turned_readings(model, recording) == []


def test_the_rounding_of_readings_is_noise():
    problem = TrialProblem(k_known=True, outputs=("position",))
    step = 0.02
    data = problem.simulate(400, seed=5, hold="zoh", noisy=True)
    fine = np.random.default_rng(1).normal(0, 1e-3, 400)
    data.y[:, 0] = step * np.round((data.x[:, 0] + fine) / step)
    recording = data.recording(problem.model)
    noise = bs.Noise(sigma_y=1e-3, sigma_w=[1e-3, 2e-2])
    kf = bs.KalmanFilter(noise, problem.prior)
    (told,) = coarse_readings(kf, problem.model, recording)
    assert "read in steps of 0.0200" in told
    assert "resolution = 0.02" in told
    first = dataclasses.replace(problem.model.outputs[0], resolution=step)
    stepped = dataclasses.replace(problem.model, outputs=(first,))
    assert coarse_readings(kf, stepped, recording) == []
    expected = 1e-6 + step**2 / 12
    np.testing.assert_allclose(noise.measurement(stepped), [[expected]])
    for model, share in ((problem.model, 0.9), (stepped, 0.985)):
        result = bs.estimate(kf, model, recording, engine="vm")
        error = np.abs(result["x_hat"].values[20:, 0] - data.x[20:, 0])
        inside = np.mean(error < 3 * result["x_std"].values[20:, 0])
        assert (inside > share) == (model is stepped), inside
    # Noise that is not additive is added to R once.
    wide = dataclasses.replace(kf, noise=dataclasses.replace(noise, sigma_u={"F": 1e-9}))
    both = [bs.estimate(e, stepped, recording, engine="vm")["x_hat"].values for e in (kf, wide)]
    assert_close(both[1], both[0], 1e-6)
