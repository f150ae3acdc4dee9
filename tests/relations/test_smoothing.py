"""Smoothing a recording: dense least squares, other methods, and the same backward in time."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.discrete.exact import foh, zoh
from backsight.discrete.noise import discretise_noise
from backsight.estimators import EKF, IEKF, MHE, UKF, JointInput, KalmanFilter
from backsight.run.estimation import _both_ways
from oracles.smoothing import Plant, conditioned
from relations.smoothed_plants import (
    assert_smoothed,
    assumed,
    data_of,
    model_of,
    random_plant,
    recording_of,
)

GAUSSIAN = (KalmanFilter, EKF, IEKF, UKF)


@pytest.mark.parametrize("kind", GAUSSIAN)
@pytest.mark.parametrize("singular", [False, True])
def test_equals_dense_conditioning_with_gaps_and_two_rates(kind, singular):
    p = random_plant(1)
    if singular:
        b = np.array([[1.0], [-0.5], [0.3]])
        p = dataclasses.replace(p, Q=b @ b.T, P0=np.diag([1.0, 0.5, 0.0]))
    u, y = data_of(p, 30, missing=0.3)
    y[np.arange(30) % 3 > 0, 1] = np.nan
    y[12:16] = np.nan
    result = bs.smooth(kind(**assumed(p)), model_of(p), recording_of(u, y), engine="vm")
    states, P, *_ = conditioned(p, u, y)
    assert_smoothed(result, states, P)
    assert not result["status"].values.any()


@pytest.mark.parametrize(
    ("kind", "ny", "correlated"),
    [
        (KalmanFilter, 3, False), (KalmanFilter, 14, True), (EKF, 14, False), (UKF, 3, True),
    ],
)  # fmt: skip
def test_many_states_equal_dense_conditioning(kind, ny, correlated):
    p = random_plant(2, nx=14, ny=ny)
    if not correlated:
        p = dataclasses.replace(p, R=np.diag(np.diag(p.R)))
    u, y = data_of(p, 8, missing=0.2)
    result = bs.smooth(kind(**assumed(p)), model_of(p), recording_of(u, y), engine="vm")
    states, P, *_ = conditioned(p, u, y)
    assert_smoothed(result, states, P)
    exact = bs.estimate(KalmanFilter(**assumed(p)), model_of(p), recording_of(u, y), engine="vm")
    assert np.allclose(result["S"], exact["S"], rtol=1e-9, atol=1e-12)
    short = bs.smooth(
        kind(**assumed(p)), model_of(p), recording_of(u, y), engine="vm", covariance="std"
    )
    assert np.allclose(short["x_std"], result["x_std"], rtol=1e-10)


@pytest.mark.parametrize("kind", GAUSSIAN)
def test_samples_with_a_noise_of_their_own(kind):
    p = random_plant(3)
    u, y = data_of(p, 20, missing=0.2)
    factor = np.random.default_rng(1).uniform(0.3, 5.0, y.shape)
    recording = recording_of(u, y)
    recording["sigma_factor"] = (("time", "output"), factor)
    result = bs.smooth(kind(**assumed(p)), model_of(p), recording, engine="vm")
    states, P, *_ = conditioned(p, u, y, factor=factor)
    assert_smoothed(result, states, P)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_continuous_models_with_held_and_interpolated_inputs(hold):
    dt, A, B = 0.1, np.array([[0.0, 1.0], [-20.0, -0.5]]), np.array([[0.0], [1.0]])
    C, D, Qc = np.array([[-20.0, -0.5]]), np.array([[1.0]]), np.diag([0.0, 0.3])
    model = bs.lti(A, B, C, D, states={"x0": "", "x1": ""}, inputs={"u0": ""}, outputs={"y0": ""})
    noise, prior = bs.Noise(sigma_y=0.1, Qc=Qc), bs.Prior(sigma_x0=1.0)
    F, Q = discretise_noise(A, Qc, dt=dt)
    B0, B1 = foh(A, B, dt=dt)[1:] if hold == "foh" else (zoh(A, B, dt=dt)[1], np.zeros((2, 1)))
    p = Plant(F, B0, C, D, Q, np.array([[0.01]]), np.zeros(2), np.eye(2), B1=B1)
    u, y = data_of(p, 25, missing=0.2)
    recording = recording_of(u, y, dt)
    states, P, *_ = conditioned(p, u, y)
    exact = bs.smooth(KalmanFilter(noise, prior, hold=hold), model, recording, engine="vm")
    assert_smoothed(exact, states, P)
    fine = bs.Integrator("rk4", substeps=20, hold=hold)
    ekf = bs.smooth(EKF(noise, prior, integrator=fine), model, recording, engine="vm")
    Q, (Phi, _) = np.zeros((2, 2)), zoh(A, B, dt=dt / 20)
    for _ in range(20):  # the trapezoidal rule of the filter's prediction
        Q = Phi @ (Q + dt / 40 * Qc) @ Phi.T + dt / 40 * Qc
    states, P, *_ = conditioned(dataclasses.replace(p, Q=Q), u, y)
    assert_smoothed(ekf, states, P, tol=1e-6)


@pytest.mark.parametrize("direct", [True, False])
@pytest.mark.parametrize("nx", [4, 12, 14])
def test_unknown_forces_equal_least_squares_without_a_prior(direct, nx):
    p = random_plant(4, nx=nx, ny=3, m=2, direct=direct)
    n = 12
    u, y = data_of(p, n, missing=0.15)
    y[5, 1:], y[8] = np.nan, np.nan  # too few rows for two forces, none
    enough = np.isfinite(y).sum(axis=1) >= 2
    told = enough if direct else np.append(enough[1:], False)
    states, P, forces, P_d = conditioned(p, u, y, told=told, sigma_force=3.0)
    joint = JointInput(**assumed(p), forces=("d0", "d1"), sigma_force=3.0)
    result = bs.smooth(joint, model_of(p), recording_of(u, y), engine="vm")
    assert_smoothed(result, states, P, tol=1e-9)
    rows = slice(None) if direct else slice(1, None)  # of displacements, the force before a sample
    upto = slice(None) if direct else slice(-1)
    size = np.sqrt(np.einsum("kii->ki", P_d[upto]))
    assert np.abs((result["d_hat"].values[rows] - forces[upto]) / size).max() < 1e-9
    assert np.abs(result["P_d"].values[rows] / (size[:, :, None] * size[:, None]) - (
        P_d[upto] / (size[:, :, None] * size[:, None]))).max() < 1e-9  # fmt: skip
    filtered = bs.estimate(joint, model_of(p), recording_of(u, y), engine="vm")
    last = {"time": -1}
    assert np.allclose(result["d_hat"][last], filtered["d_hat"][last], rtol=1e-12, atol=1e-12)
    short = bs.smooth(joint, model_of(p), recording_of(u, y), engine="vm", covariance="std")
    assert np.allclose(short["d_std"], result["d_std"], rtol=1e-10)


def test_a_window_over_the_whole_recording_that_looks_back_is_the_same():
    p = random_plant(5)
    u, y = data_of(p, 7, missing=0.2)
    model, recording = model_of(p), recording_of(u, y)
    window = bs.estimate(MHE(**assumed(p), N=6, lag=6), model, recording, engine="vm")
    result = bs.smooth(EKF(**assumed(p)), model, recording, engine="vm")
    assert_smoothed(result, window["x_hat"].values, window["P"].values, tol=1e-6)


@pytest.mark.parametrize("kind", GAUSSIAN)
def test_the_last_sample_is_the_filters_and_the_innovations_are_all_its_own(kind):
    p = random_plant(6)
    u, y = data_of(p, 12, missing=0.2)
    model, recording = model_of(p), recording_of(u, y)
    filtered = bs.estimate(kind(**assumed(p)), model, recording, engine="vm")
    result = bs.smooth(kind(**assumed(p)), model, recording, engine="vm")
    for name in ("x_hat", "P", "y_hat"):
        assert np.allclose(result[name][-1], filtered[name][-1], rtol=1e-12, atol=1e-14)
    for name in ("e", "S"):
        assert np.array_equal(result[name], filtered[name], equal_nan=True)
    assert np.allclose(result["v"], recording["y"] - result["y_hat"], equal_nan=True)
    assert (result["x_std"] <= filtered["x_std"] * (1 + 1e-12)).all()


def test_a_reversible_process_is_smoothed_alike_in_both_directions_of_time():
    a = 0.9
    p = Plant(*(np.array([[k]]) for k in (a, 0.0, 1.0, 0.0, 1 - a**2, 0.5)), np.zeros(1), np.eye(1))
    u, y = data_of(p, 40, missing=0.3)
    smooth = [
        bs.smooth(KalmanFilter(**assumed(p)), model_of(p), recording_of(u, z), engine="vm")
        for z in (y, y[::-1])
    ]
    for name in ("x_hat", "P"):
        assert np.allclose(smooth[0][name], smooth[1][name][::-1], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("once", [True, False])
def test_blocks_engines_and_standard_deviations_alone_change_nothing(monkeypatch, once):
    p = random_plant(8)
    u, y = data_of(p, 40, missing=0.2)
    model, recording, kf = model_of(p), recording_of(u, y), KalmanFilter(**assumed(p))
    whole = bs.smooth(kf, model, recording, engine="vm")
    sizes = {"LEAST_BLOCK": 7, "CACHED": 0, "KEPT": 2**24 if once else 0}
    for name, value in sizes.items():
        monkeypatch.setattr(_both_ways, name, value)
    done = []
    native = bs.smooth(kf, model, recording, engine="native", progress=done.append)
    assert done == sorted(done)
    assert done[-1] == 40
    for name in ("x_hat", "P", "e", "S", "status"):
        assert np.allclose(native[name], whole[name], rtol=1e-9, atol=1e-10, equal_nan=True)
    short = bs.smooth(kf, model, recording, engine="vm", covariance="std")
    assert np.allclose(short["x_std"], whole["x_std"], rtol=1e-10)
    assert not {"P", "S"} & set(short)


def test_a_damped_motion_without_noise_stays_what_its_input_makes_it():
    """A recursion with the inverse of F would blow rounding up, tenfold a sample."""
    n, start = 300, 1.0
    p = Plant(
        np.diag([0.1, 0.95]), np.array([[1.0], [0.0]]), np.array([[1.0, 1.0]]), np.zeros((1, 1)),
        np.diag([0.0, 0.1]), np.eye(1), np.array([start, 0.0]), np.eye(2),
    )  # fmt: skip
    u, y = np.ones((n, 1)), data_of(p, n, missing=0.0)[1]
    result = bs.smooth(KalmanFilter(**assumed(p)), model_of(p), recording_of(u, y), engine="vm")
    settled = 1 / 0.9
    assert np.abs(result["x_hat"].sel(state="x0")[40:] - settled).max() < 1e-12


@pytest.mark.parametrize("kind", GAUSSIAN)
def test_an_unstable_motion_without_noise_stays_finite(kind):
    n = 700  # 1.7 to the power of 1400 is more than a number can be
    p = Plant(
        np.diag([1.7, 0.9]), np.zeros((2, 1)), np.array([[1.0, 1.0]]), np.zeros((1, 1)),
        np.zeros((2, 2)), np.eye(1), np.zeros(2), np.eye(2),
    )  # fmt: skip
    u, y = np.zeros((n, 1)), data_of(p, n, missing=0.0)[1]
    result = bs.smooth(kind(**assumed(p)), model_of(p), recording_of(u, y), engine="vm")
    assert np.isfinite(result["x_hat"]).all()
    assert not result["status"].values.any()
