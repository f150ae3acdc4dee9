"""Dummy measurements: what is known of a displacement keeps an integrated one from drifting."""

import numpy as np
import pytest

import backsight as bs
from backsight.analysis.observability import dummies_that_would_do
from backsight.errors import ModelError
from backsight.models.forces.unknown_forces import forces_as_inputs
from closeness import assert_close

DT, SIZE = 2e-3, 1e-3
W = 2 * np.pi * 8.0
PLAIN = bs.second_order(
    1.0, 0.02 * W, W**2, forces={"F": "q1"}, parameters={"F": 0.0},
    outputs={"a": ("acceleration", "q1")}, virtual={"d": ("displacement", "q1")},
)  # fmt: skip
WALK, SPREAD = {"F": 0.5}, {"q1": 1e-4, "q1_dot": 1e-3, "F": 1.0}
SIGMA = SIZE * np.sqrt(2 / (W * DT))


def anchored():
    """With a dummy measurement of the displacement beside the virtual output of it."""
    model = bs.augment(PLAIN, ["F"])
    return bs.models.with_dummies(bs.with_virtual(model, {"stays": "q1"}), ["stays"])


def kalman(**sigma_y):
    return bs.KalmanFilter(bs.Noise(sigma_y=sigma_y, sigma_w=WALK), bs.Prior(sigma_x0=SPREAD))


def shaken(seed):
    """A force of 12 s that an accelerometer feels."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(6000)
    force = sum(
        rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (3.0, 5.0, 7.0, 11.0)
    )
    force *= SIZE * W**2 / np.std(force) / 3
    model = forces_as_inputs(PLAIN, ["F"])
    rec = bs.simulate(model, force, dt=DT, sigma_y=0.05, seed=seed)
    return rec.drop_sel(input="F")


def test_the_error_of_an_integrated_displacement_falls_and_its_band_covers():
    found = []
    for seed in range(2):
        recording = shaken(seed)
        drifting = bs.estimate(kalman(a=0.05), bs.augment(PLAIN, ["F"]), recording)
        settled = bs.estimate(kalman(a=0.05, stays=SIGMA), anchored(), recording)
        for result in (drifting, settled):
            error = (result["z_hat"] - result["z_true"]).values[:, 0]
            std = result["z_std"].values[:, 0]
            inside = np.mean(np.abs(error) < 3 * std)
            found.append([np.std(error) / result["z_true"].values.std(), inside])
    error, inside = np.array(found).reshape(2, 2, 2).mean(axis=0).T
    assert error[1] < 0.5 * error[0], error
    assert error[1] < 0.25
    assert (inside > 0.985).all(), inside


def test_no_sensor_is_needed_and_nothing_is_said_of_one():
    recording = shaken(0).isel(time=slice(200))
    result = bs.estimate(kalman(a=0.05, stays=SIGMA), anchored(), recording, engine="vm")
    assert result["output"].values.tolist() == ["a", "stays"]
    assert np.isnan(result["y"].sel(output="stays")).all()
    assert np.isnan(result["e"].sel(output="stays")).all()
    told = recording.reindex(output=["a", "stays"])
    told["y"][:, 1] = 0.0
    plain = bs.second_order(
        1.0, 0.02 * W, W**2, forces={"F": "q1"}, parameters={"F": 0.0},
        outputs={"a": ("acceleration", "q1"), "stays": ("displacement", "q1")},
    )  # fmt: skip
    measured = bs.estimate(kalman(a=0.05, stays=SIGMA), bs.augment(plain, ["F"]), told, engine="vm")
    assert_close(result["x_hat"].values, measured["x_hat"].values, 1e-12)
    live = bs.stream(kalman(a=0.05, stays=SIGMA), anchored(), DT, engine="vm")
    for k in range(5):
        step = live.step([], recording["y"].values[k])
    assert_close(step["x_hat"], result["x_hat"].values[4], 1e-12)


def test_the_joint_filter_follows_a_force_by_accelerations_with_them():
    model = bs.models.with_dummies(bs.with_virtual(PLAIN, {"stays": "q1"}), ["stays"])
    joint = bs.JointInput(
        bs.Noise(sigma_y={"a": 0.05, "stays": SIGMA}),
        bs.Prior(sigma_x0={"q1": 1e-4, "q1_dot": 1e-3}),
        forces=("F",),
    )
    result = bs.estimate(joint, model, shaken(1))
    error = (result["z_hat"] - result["z_true"]).values[:, 0]
    assert np.mean(np.abs(error) < 3 * result["z_std"].values[:, 0]) > 0.985


def test_what_would_do_is_found_and_does():
    model = bs.augment(PLAIN, ["F"])
    assert dummies_that_would_do(model) == ("d",)
    assert dummies_that_would_do(anchored()) == ()
    K = 100.0 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    chain = bs.second_order(
        np.eye(3), 0.01 * K, K, forces={"F": "q1", "G": "q3"}, parameters={"F": 0.0, "G": 0.0},
        outputs={f"a{i}": ("acceleration", f"q{i}") for i in (1, 2, 3)},
    )  # fmt: skip
    pushed = bs.augment(chain, ["F", "G"])
    names = dummies_that_would_do(pushed)
    assert len(names) == 2
    assert set(names) <= {"q1", "q2", "q3"}
    told = bs.models.with_dummies(
        bs.with_virtual(pushed, {f"d{n}": n for n in names}), [f"d{n}" for n in names]
    )
    assert bs.check.check_observability(told).detectable


def test_what_is_wrong_is_said():
    with pytest.raises(ModelError, match=r"no virtual output 'e' to make a dummy .* of"):
        bs.models.with_dummies(PLAIN, ["e"])
    with pytest.raises(ModelError, match="cannot be of a rate"):
        bs.models.with_dummies(bs.with_virtual(PLAIN, {"acc": "q1_dot_dot"}), ["acc"])
