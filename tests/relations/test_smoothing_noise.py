"""Smoothing with rules for outliers, with noise as states, and with very large process noise."""

import dataclasses

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.estimators import EKF, UKF, JointInput, KalmanFilter
from backsight.schema import WEIGHT
from oracles.smoothing import Plant, conditioned
from relations.smoothed_plants import (
    assert_smoothed,
    assumed,
    data_of,
    model_of,
    random_plant,
    recording_of,
)


def with_outliers(n: int):
    """A plant, its inputs, and motions that it made, three samples of which are far off."""
    p = random_plant(3, nx=3, ny=2)
    rng = np.random.default_rng(2)
    u, x, y = rng.standard_normal((n, 1)), p.x0, np.empty((n, 2))
    noises = [np.linalg.cholesky(K) for K in (p.Q, p.R)]
    for k in range(n):
        y[k] = p.C @ x + p.D @ u[k] + noises[1] @ rng.standard_normal(2)
        x = p.A @ x + p.B @ u[k] + noises[0] @ rng.standard_normal(3)
    y[[7, 15, 16], [0, 1, 1]] += 300.0
    return p, u, y


@pytest.mark.parametrize("kind", [KalmanFilter, EKF, UKF])
@pytest.mark.parametrize("covariance", ["full", "std"])
def test_weights_of_the_way_forward_hold_on_the_way_back(kind, covariance):
    p, u, y = with_outliers(25)
    given = assumed(p)
    noise = dataclasses.replace(given["noise"], outliers=bs.settings.Huber())
    estimator = kind(noise, given["prior"])
    result = bs.smooth(
        estimator, model_of(p), recording_of(u, y), engine="vm", covariance=covariance
    )
    filtered = bs.estimate(estimator, model_of(p), recording_of(u, y), engine="vm")
    assert np.array_equal(result[WEIGHT], filtered[WEIGHT])
    assert (result[WEIGHT].values < 0.1).sum() == 3
    states, P, *_ = conditioned(p, u, y, factor=1 / result[WEIGHT].values)
    size = np.sqrt(np.einsum("kii->ki", P))
    assert np.abs((result["x_hat"].values - states) / size).max() < 1e-10
    assert np.abs(result["x_std"].values / size - 1).max() < 1e-10
    assert ("S" in result) == (covariance == "full")


def test_a_gate_leaves_out_what_it_left_out():
    p, u, y = with_outliers(25)
    given = assumed(p)
    noise = dataclasses.replace(given["noise"], outliers=bs.settings.Gate())
    result = bs.smooth(
        KalmanFilter(noise, given["prior"]), model_of(p), recording_of(u, y), engine="vm"
    )
    left = np.where(result[WEIGHT].values > 0, y, np.nan)
    assert np.isnan(left).sum() == 3
    states, P, *_ = conditioned(p, u, left)
    assert_smoothed(result, states, P)


@pytest.mark.parametrize("kind", [KalmanFilter, EKF, UKF])
def test_noise_of_inputs_is_smoothed_as_process_noise(kind):
    """Noise of a held input is process noise, which is not additive to the filter."""
    p = dataclasses.replace(random_plant(5), D=np.zeros((2, 1)))
    u, y = data_of(p, 20, missing=0.2)
    given, sigma = assumed(p), 0.7
    noise = dataclasses.replace(given["noise"], sigma_u={"u0": sigma})
    result = bs.smooth(kind(noise, given["prior"]), model_of(p), recording_of(u, y), engine="vm")
    noisy = dataclasses.replace(p, Q=p.Q + sigma**2 * p.B @ p.B.T)
    states, P, *_ = conditioned(noisy, u, y)
    assert_smoothed(result, states, P)


def test_noise_that_process_and_measurement_share():
    p, n = random_plant(6, nx=2, ny=2), 15
    u, y = data_of(p, n, missing=0.0)
    given, N = assumed(p), np.array([[0.03, 0.015], [-0.015, 0.03]])
    noise = dataclasses.replace(given["noise"], cross=N)
    result = bs.smooth(
        KalmanFilter(noise, given["prior"]), model_of(p), recording_of(u, y), engine="vm"
    )
    # x+ = A x + B u + N R^-1 (y - C x - D u) + w, whose w and v are independent.
    gain = N @ np.linalg.inv(p.R)
    free = dataclasses.replace(
        p, A=p.A - gain @ p.C, B=np.hstack([p.B - gain @ p.D, gain]), Q=p.Q - gain @ N.T,
        D=np.hstack([p.D, np.zeros((2, 2))]),
    )  # fmt: skip
    states, P, *_ = conditioned(free, np.hstack([u, y]), y)
    assert_smoothed(result, states, P)


def test_a_force_that_no_model_holds_back_keeps_its_digits():
    """What is told of the state whatever it did is a small difference: there, by factors."""
    A = scipy.linalg.expm(0.01 * np.array([[0, 1, 0], [-400, -0.8, 1], [0, 0, 0]]))
    n, walk = 30, 1e4
    p = Plant(
        A, np.zeros((3, 1)), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 1)),
        np.diag([0.0, 0.0, walk**2]), np.array([[1e-12]]), np.zeros(3),
        np.diag([1.0, 1.0, walk**2]),
    )  # fmt: skip
    rng, x, y = np.random.default_rng(1), np.array([0.5, -0.5, 0.0]), np.empty((n, 1))
    for k in range(n):
        y[k] = x[0] + 1e-6 * rng.standard_normal()
        x = A @ x + [0.0, 0.0, walk * rng.standard_normal()]
    u = np.zeros((n, 1))
    result = bs.smooth(KalmanFilter(**assumed(p)), model_of(p), recording_of(u, y), engine="vm")
    # All states from independent unknowns of variance one, and their least squares by QR.
    states = np.zeros((n, 3, 3 + n - 1))
    states[0, :, :3] = np.diag([1.0, 1.0, walk])
    for k in range(n - 1):
        states[k + 1] = A @ states[k]
        states[k + 1, 2, 3 + k] += walk
    equations = np.vstack([np.eye(n + 2), states[:, 0] / 1e-6])
    root = np.linalg.inv(np.linalg.qr(equations, mode="r"))
    size = np.linalg.norm(states @ root, axis=2)
    assert np.abs(result["x_std"].values / size - 1).max() < 2e-8


def test_joint_input_smooths_with_a_rule():
    p = random_plant(4, nx=4, ny=3, m=1)
    u, y = data_of(p, 15, missing=0.0)
    y *= 20.0
    y[6, 1] += 1e4
    given = assumed(p)
    noise = dataclasses.replace(given["noise"], outliers=bs.settings.Gate(0.9999))
    joint = JointInput(noise, given["prior"], forces=("d0",))
    result = bs.smooth(joint, model_of(p), recording_of(u, y), engine="vm")
    filtered = bs.estimate(joint, model_of(p), recording_of(u, y), engine="vm")
    left = np.where(filtered[WEIGHT].values > 0, y, np.nan)
    assert np.isnan(left).any()
    plain = JointInput(**given, forces=("d0",))
    wanted = bs.smooth(plain, model_of(p), recording_of(u, left), engine="vm")
    assert np.allclose(result["x_hat"], wanted["x_hat"], rtol=1e-9, atol=1e-9)
    assert np.allclose(result["d_hat"], wanted["d_hat"], rtol=1e-9, atol=1e-9)
