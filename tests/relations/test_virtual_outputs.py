"""Virtual outputs of every estimator: what the states say, with bands that cover."""

import dataclasses

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import TuningError
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.testing import CASES
from closeness import assert_close

DIRECTION = np.array([2.0, -3.0])


def deviations(result, direction=DIRECTION):
    """What the covariance of the first states says of a linear combination of them."""
    P = result["P"].values[:, : len(direction), : len(direction)]
    return np.sqrt(np.einsum("i,kij,j->k", direction, P, direction))


def asked(problem):
    """The model of a problem with virtual outputs."""
    return bs.with_virtual(problem.model, {"mix": ("2*q - 3*v", "m"), "push_in": "F"})


@pytest.mark.parametrize("key", CASES)
def test_every_estimator_puts_out_what_its_states_say(key):
    case = CASES[key]
    problem = case.problem
    model, estimator = asked(problem), case.build(problem, Integrator("rk4", 1, "zoh"))
    recording = problem.simulate(25, seed=1, hold="zoh", noisy=True).recording(problem.model)
    plain = bs.estimate(estimator, problem.model, recording, engine="vm")
    result = bs.estimate(estimator, model, recording, engine="vm")
    assert_close(result["x_hat"].values, plain["x_hat"].values, 1e-14)
    expected = result["x_hat"].values[:, :2] @ DIRECTION
    assert_close(result["z_hat"].sel(virtual="mix").values, expected, 1e-12)
    assert_close(result["z_std"].sel(virtual="mix").values, deviations(result), 1e-9)
    np.testing.assert_array_equal(result["z_hat"].sel(virtual="push_in"), recording["u"][:, 0])
    assert not result["z_std"].sel(virtual="push_in").values.any()
    assert result["virtual_unit"].values.tolist() == ["m", ""]
    assert "P_xd" not in result


def test_an_estimate_that_looks_back_has_the_input_of_its_sample():
    problem = CASES["mhe"].problem
    mhe = bs.MHE(problem.noise, problem.prior, N=4, lag=3, integrator=Integrator("rk4", 1))
    recording = problem.simulate(14, seed=2, hold="zoh", noisy=True).recording(problem.model)
    result = bs.estimate(mhe, asked(problem), recording, engine="vm")
    np.testing.assert_array_equal(result["z_hat"].sel(virtual="push_in"), recording["u"][:, 0])
    window = bs.solve_window(mhe, asked(problem), recording, at=8)
    assert_close(
        window["x"].values, bs.solve_window(mhe, problem.model, recording, at=8)["x"].values, 1e-14
    )


@pytest.mark.parametrize("covariance", ["full", "std"])
@pytest.mark.parametrize("key", ["kf", "joint_input"])
def test_smoothed_estimates_have_them_too(key, covariance):
    case = CASES[key]
    problem = case.problem
    estimator = case.build(problem, Integrator("rk4", 1, "zoh"))
    recording = problem.simulate(25, seed=1, hold="zoh", noisy=True).recording(problem.model)
    full = bs.smooth(estimator, problem.model, recording, engine="vm")
    result = bs.smooth(estimator, asked(problem), recording, covariance=covariance, engine="vm")
    assert ("P" in result) == (covariance == "full")
    assert_close(result["x_std"].values, full["x_std"].values, 1e-12)
    expected = full["x_hat"].values[:, :2] @ DIRECTION
    assert_close(result["z_hat"].sel(virtual="mix").values, expected, 1e-12)
    assert_close(result["z_std"].sel(virtual="mix").values, deviations(full), 1e-9)


# A mass on a spring that a force pushes: everything is known of it in closed form.
K, C, PERIOD = 400.0, 2.0, 0.01
OSCILLATOR = np.array([[0.0, 1.0, 0.0], [-K, -C, 1.0], [0.0, 0.0, 0.0]])
EXACT = scipy.linalg.expm(PERIOD * OSCILLATOR)


def oscillator(sensors, **virtual):
    """With the force as a parameter."""
    plain = bs.second_order(
        1.0, C, K, forces={"F": "q1"}, parameters={"F": 0.0}, outputs=sensors,
        virtual={"a": ("acceleration", "q1")},
    )  # fmt: skip
    return bs.with_virtual(plain, {"spring": f"{K}*q1", **virtual})


def driven(n, *, walk=0.0, wind=0.0, force=None, seed=0):
    """States (n, 3) and steps of the velocity (n,): wind is added per sample."""
    rng = np.random.default_rng(seed)
    x = np.zeros((n, 3))
    x[0] = rng.standard_normal(3) * [1e-3, 1e-2, 0.5 * (force is None)]
    steps, walks = wind * rng.standard_normal(n), walk * rng.standard_normal(n)
    for k in range(n):
        if force is not None:
            x[k, 2] = force[k]
        if k + 1 < n:
            x[k + 1] = x[k] @ EXACT.T + [0.0, steps[k], walks[k]]
    return x, steps


def recorded(x, sensors, sigma, seed):
    """A recording of what sensors see of states (n, 3)."""
    rows = {"displacement": [1.0, 0, 0], "acceleration": [-K, -C, 1.0]}
    H = np.array([rows[kind] for kind, _ in sensors.values()])
    y = x @ H.T + sigma * np.random.default_rng(seed).standard_normal((len(x), len(H)))
    return bs.from_arrays(y=y, dt=PERIOD, inputs={}, outputs=dict.fromkeys(sensors, ""))


PLACE = {"y": ("displacement", "q1")}
FELT = {"acc": ("acceleration", "q1"), "y": ("displacement", "q1")}
SPREAD = {"q1": 1e-3, "q1_dot": 1e-2}


def normalised(run, x, steps, sensors, sigma, *, settled=30):
    """Errors of acceleration and spring force in their deviations, (n, 2)."""
    result = run(recorded(x, sensors, sigma, seed=1))
    truth = {"a": x @ [-K, -C, 1.0] + steps / PERIOD, "spring": K * x[:, 0]}
    errors = [
        (result["z_hat"].sel(virtual=n).values - t) / result["z_std"].sel(virtual=n).values
        for n, t in truth.items()
    ]
    return np.column_stack(errors)[settled:-settled]


def covers(errors):
    """Whether normal numbers would be so large; errors of successive samples are alike."""
    inside, size = np.mean(np.abs(errors) < 3, axis=0), np.mean(errors**2, axis=0)
    return bool(((inside > 0.985) & (size > 0.75) & (size < 1.25)).all())


def test_bands_of_acceleration_and_member_force_cover_under_a_walking_force():
    x, steps = driven(3000, walk=0.5)
    kf = bs.KalmanFilter(
        bs.Noise(sigma_y=1e-4, sigma_w={"F": 0.5}), bs.Prior(sigma_x0={**SPREAD, "F": 0.5})
    )
    model = bs.augment(oscillator(PLACE), ["F"])
    for run in (bs.estimate, bs.smooth):
        found = normalised(lambda r, run=run: run(kf, model, r), x, steps, PLACE, 1e-4)
        assert covers(found), np.mean(found**2, axis=0)


def test_an_acceleration_contains_the_process_noise():
    kf = bs.KalmanFilter(
        bs.Noise(sigma_y=1e-4, sigma_w={"q1_dot": 0.02}), bs.Prior(sigma_x0=SPREAD)
    )
    x, steps = driven(2000, wind=0.02, force=np.zeros(2000))
    model = oscillator(PLACE)
    found = normalised(lambda r: bs.estimate(kf, model, r, engine="vm"), x, steps, PLACE, 1e-4)
    assert covers(found), np.mean(found**2, axis=0)
    # Looking back, estimate and noise depend on each other: the band is never too narrow.
    smooth = normalised(lambda r: bs.smooth(kf, model, r, engine="vm"), x, steps, PLACE, 1e-4)
    assert np.mean(smooth[:, 0] ** 2) < 1.1
    assert covers(smooth[:, 1:])
    # Noise that acts all the time is the same over a sample.
    dense = dataclasses.replace(
        kf, noise=bs.Noise(sigma_y=1e-4, Qc=np.diag([0.0, 0.02**2 / PERIOD]))
    )
    record = recorded(x[:50], PLACE, 1e-4, seed=0)
    std = [
        bs.estimate(e, model, record, engine="vm")["z_std"].sel(virtual="a").values[-1]
        for e in (kf, dense)
    ]
    assert std[1] == pytest.approx(std[0], rel=0.02)
    assert std[0] > 0.02 / PERIOD


def test_unknown_forces_that_are_felt_at_once_count_with_the_states():
    n = np.arange(2000)
    x, steps = driven(2000, force=3.0 * np.sin(0.3 * n) + np.where(n > 600, 5.0, 0.0))
    joint = bs.JointInput(
        bs.Noise(sigma_y={"acc": 0.05, "y": 1e-4}, sigma_w={"q1_dot": 1e-7}),
        bs.Prior(sigma_x0=SPREAD),
        forces=("F",),
    )
    noise, model = np.array([0.05, 1e-4]), oscillator(FELT)
    for run in (bs.estimate, bs.smooth):
        found = normalised(lambda r, run=run: run(joint, model, r), x, steps, FELT, noise)
        assert covers(found), np.mean(found**2, axis=0)
    # Nothing but the sensor says the acceleration, though force and states have wider bands each.
    result = bs.estimate(joint, model, recorded(x[:60], FELT, noise, seed=3), engine="vm")
    assert result["z_std"].sel(virtual="a").values[-1] == pytest.approx(0.05, rel=1e-3)
    assert result["d_std"].values[-1, 0] > 0.053


def test_a_force_that_shows_one_sample_later_cannot_be_in_a_virtual_output():
    joint = bs.JointInput(bs.Noise(sigma_y=1e-4), bs.Prior(sigma_x0=SPREAD), forces=("F",))
    with pytest.raises(TuningError, match="'a' contains an unknown force of its own sample"):
        joint.compile(oscillator(PLACE), PERIOD)


def test_forces_found_by_few_hits_widen_the_band_by_all_that_is_not_known():
    sparse = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y={"acc": 0.05, "y": 1e-4}),
        bs.Prior(sigma_x0=SPREAD),
        forces=("F",),
        lam=5.0,
        N=5,
        sigma_force=0.2,
    )
    force = np.where(np.arange(80) == 40, 20.0, 0.0)
    x, _ = driven(80, force=force)
    record = recorded(x, FELT, np.array([0.05, 1e-4]), seed=1)
    result = bs.estimate(sparse, oscillator(FELT), record, engine="vm")
    z, std = (result[n].sel(virtual="a").values for n in ("z_hat", "z_std"))
    assert (std >= 0.2).all()
    truth = x @ [-K, -C, 1.0]
    assert (np.abs(z - truth) < 3 * std).mean() > 0.98
    assert abs(z[40] - truth[40]) < 3 * std[40]
    assert abs(truth[40]) > 15


def test_noise_of_inputs_is_in_what_contains_them():
    case = CASES["ekf"].problem
    model = asked(case)
    noise = bs.Noise(sigma_y=[0.01, 0.1], sigma_w=[1e-3, 2e-2, 0.0], sigma_u={"F": 0.7})
    record = case.simulate(15, seed=1, hold="zoh", noisy=True).recording(case.model)
    result = bs.estimate(bs.EKF(noise, case.prior), model, record, engine="vm")
    # Position and speed say nothing of the force of their own sample.
    assert_close(result["z_std"].sel(virtual="push_in").values, np.full(15, 0.7), 1e-9)
    assert_close(result["z_std"].sel(virtual="mix").values, deviations(result), 1e-9)


@pytest.mark.parametrize("last", ["q2**3 + F", "q2 + F"])
def test_many_states_have_the_same_formulas(last):
    n = 8
    stiffness = 100.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    model = bs.second_order(
        np.eye(n), 0.01 * stiffness, stiffness,
        forces={"F": "q8"}, parameters={"F": 0.0}, outputs={"y": ("displacement", "q1")},
        virtual={"a": ("acceleration", "q5"), "d": ("displacement", "q3")},
    )  # fmt: skip
    model = bs.with_virtual(bs.augment(model, ["F"]), {"last": last})
    kf = bs.KalmanFilter(
        bs.Noise(sigma_y=1e-3, sigma_w={"F": 0.1, "q5_dot": 1e-3}), bs.Prior(sigma_x0=0.1)
    )
    y = 0.01 * np.random.default_rng(0).standard_normal(12)
    record = bs.from_arrays(y=y, dt=0.02, inputs={}, outputs={"y": ""})
    result = bs.estimate(kf, model, record, engine="vm")
    x, P = result["x_hat"].values, result["P"].values
    f = np.array([np.asarray(model.f(row, [], [])).ravel() for row in x])
    G = np.zeros((12, 3, 2 * n + 1))
    G[:, 0, :n], G[:, 0, n : 2 * n] = -stiffness[4], -0.01 * stiffness[4]
    G[:, 1, 2] = 1.0
    power = 3 if "**" in last else 1
    G[:, 2, 1], G[:, 2, 2 * n] = power * x[:, 1] ** (power - 1), 1.0
    variance = np.einsum("kij,kjl,kil->ki", G, P, G)
    variance[:, 0] += (1e-3 / 0.02) ** 2
    expected = np.column_stack([f[:, n + 4], x[:, 2], x[:, 1] ** power + x[:, -1]])
    assert_close(result["z_hat"].values, expected, 1e-9)
    assert_close(result["z_std"].values, np.sqrt(variance), 1e-9)


def test_truth_of_a_simulation_and_rules_for_outliers_go_along():
    model = forces_as_inputs(oscillator(PLACE), ["F"])
    push = np.sin(np.arange(60.0))
    recording = bs.simulate(model, push, dt=PERIOD, sigma_y=1e-5)
    recording["y"][30] += 1.0
    noise = bs.Noise(sigma_y=1e-5, sigma_w={"q1_dot": 1e-6}, outliers=bs.settings.Gate())
    result = bs.estimate(bs.EKF(noise, bs.Prior(sigma_x0=SPREAD)), model, recording, engine="vm")
    assert result["weight"].values[30, 0] == 0
    x = recording["x_true"]
    expected = x.sel(state=["q1", "q1_dot"]).values @ [-K, -C] + push
    assert_close(result["z_true"].sel(virtual="a").values, expected, 1e-12)
    error = (result["z_hat"] - result["z_true"]).values[20:]
    assert (np.abs(error) < 4 * result["z_std"].values[20:]).all()
