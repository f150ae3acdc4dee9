"""Limits and symmetries of the compressive-sensing MHE."""

import dataclasses
import math

import numpy as np
import pytest

from backsight.data import from_arrays
from backsight.estimators import (
    MHE,
    CompressiveSensingMHE,
    KalmanFilter,
    LinearMHE,
    Noise,
    Prior,
)
from backsight.estimators.arrival import ConstantArrival, NoArrival, SmoothedArrival
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.run.estimation import estimate
from backsight.run.sparse_forces import find_sparse_forces
from backsight.sparse import L1
from closeness import assert_close
from estimators import struck
from relations.linear import Run

N = 6


def run(made, of, u, y):
    return Run(made, struck.model(of), struck.DT)(u, y)


def sparse(of, **settings):
    given = {"forces": struck.FORCES, "lam": math.inf, "N": N, "lag": 0}
    return CompressiveSensingMHE(**struck.gaussians(of), **({"bias": "kept"} | given | settings))


@pytest.mark.parametrize("accelerations", [False, True])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_no_sparse_force_allowed_is_the_kalman_filter(missing, accelerations):
    """At every sample, also while the window fills."""
    of = struck.system(accelerations=accelerations)
    u, y = struck.record(of, 50, seed=1, missing=missing)
    found = run(sparse(of), of, u, y)
    expected = run(KalmanFilter(**struck.gaussians(of)), of, u, y)
    for name in ("x_hat", "P", "y_hat", "e", "S"):
        assert_close(found[name], expected[name], 1e-9)
    assert not found["d_raw"].any()


def test_every_sample_has_its_own_noise():
    """Where no force is allowed it is the Kalman filter, with gaps and background forces."""
    of = struck.system()
    u, y = struck.record(of, 40, seed=1, missing=0.1)
    factor = np.random.default_rng(2).choice([1.0, 1.0, 0.25, 3.0, 30.0], size=y.shape)
    units = {"inputs": {"f": "N"}, "outputs": {"y": "m", "z": "m"}, "sigma_factor": factor}
    recording = from_arrays(u=u, y=y, dt=struck.DT, **units)
    Q = of.Q + of.E @ np.diag(struck.SIGMA_FORCE**2) @ of.E.T
    made = sparse(of, sigma_force=struck.SIGMA_FORCE)
    found = estimate(made, struck.model(of), recording, engine="vm")
    filtered = KalmanFilter(Noise(R=of.R, Q=Q), Prior(P0=struck.P0, x0=struck.X0))
    expected = estimate(filtered, struck.model(of), recording, engine="vm")
    for name in ("x_hat", "P", "S"):
        assert_close(found[name].values, expected[name].values, 1e-9)
    assert_close(*(np.nan_to_num(r["e"].values) for r in (found, expected)), 1e-9)


def test_one_window_over_all_is_the_whole_recording():
    """By another route, an l1 path over innovations; samples with a noise of their own, gaps."""
    of, n = struck.system(accelerations=True), 12
    u, y = struck.record(of, n, seed=7, missing=0.1)
    factor = np.random.default_rng(8).choice([1.0, 0.25, 3.0, 30.0], size=y.shape)
    units = {"inputs": {"f": "N"}, "outputs": {"y": "m", "z": "m"}, "sigma_factor": factor}
    recording = from_arrays(u=u, y=y, dt=struck.DT, **units)
    made = sparse(of, lam=0.4, N=n - 1, lag="N", sigma_force=struck.SIGMA_FORCE)
    window = estimate(made, struck.model(of), recording, engine="vm")
    whole = find_sparse_forces(made, struck.model(of), recording, selection=L1(refit=False))
    assert whole.attrs["nonzeros"] == window["nonzeros"].values[0] > 2
    for name in ("x_hat", "P"):
        assert_close(window[name].values[0], whole[name].values[0], 1e-7)
    assert_close(window["d_raw"].values[0], whole["d_hat"].values[0], 1e-7)


@pytest.mark.parametrize("lag", [0, 2, "N"])
@pytest.mark.parametrize(
    "arrival",
    [
        SmoothedArrival(),
        SmoothedArrival(naive=True),
        ConstantArrival(),
        ConstantArrival(0.3 * struck.P0),
        NoArrival(),
    ],
    ids=lambda a: type(a).__name__,
)
def test_arrival_cost_and_lag_mean_what_they_mean_in_the_mhe(arrival, lag):
    """Where no force is allowed, both are the same window; while it fills, and full, with gaps."""
    of = struck.system()
    u, y = struck.record(of, 30, seed=3, missing=0.1)
    shared = {"N": N, "arrival": arrival, "lag": lag}
    found = run(sparse(of, **shared), of, u, y)
    expected = run(MHE(**struck.gaussians(of), **shared), of, u, y)
    # Without arrival cost the MHE keeps the prior as long as its sample is in the window.
    names = ("x_hat",) if arrival == NoArrival() else ("x_hat", "P", "y_hat")
    start, accuracy = (N + 1, 1e-6) if arrival == NoArrival() else (0, 1e-8)
    for name in names:
        assert_close(found[name][start:], expected[name][start:], accuracy)


def test_background_forces_are_process_noise():
    of = struck.system()
    u, y = struck.record(of, 40, seed=2)
    found = run(sparse(of, sigma_force=struck.SIGMA_FORCE), of, u, y)
    Q = of.Q + of.E @ np.diag(struck.SIGMA_FORCE**2) @ of.E.T
    filtered = KalmanFilter(Noise(R=of.R, Q=Q), Prior(P0=struck.P0, x0=struck.X0))
    expected = run(filtered, of, u, y)
    for name in ("x_hat", "P", "e", "S"):
        assert_close(found[name], expected[name], 1e-9)


def test_without_arrival_cost_it_is_the_least_squares_mhe():
    of = struck.system()
    u, y = struck.record(of, 40, seed=3)
    found = run(sparse(of, arrival=NoArrival()), of, u, y)
    expected = run(LinearMHE(**struck.gaussians(of), N=N), of, u, y)
    for name in ("x_hat", "P"):
        assert_close(found[name][N:], expected[name][N:], 1e-7)


def test_without_arrival_cost_too_few_measurements_are_told():
    of = struck.system()
    u, y = struck.record(of, 30, seed=3)
    y[10:24] = np.nan
    found = run(sparse(of, arrival=NoArrival()), of, u, y)
    unobserved = (found["status"].astype(int) & 128) != 0
    assert unobserved[16:24].all()
    assert not unobserved[:14].any()
    assert np.isfinite(found["x_hat"]).all()


def test_a_window_later_is_the_same_window():
    """Time invariance: the same recording after a shorter and after a longer rest."""
    of = dataclasses.replace(struck.system(), Q=np.zeros((4, 4)))
    u, y = struck.record(of, 30, seed=4)
    made = CompressiveSensingMHE(
        Noise(R=of.R), Prior(P0=np.zeros((4, 4))), forces=struck.FORCES, lam=0.5, N=N,
        sigma_force=0.3, arrival=ConstantArrival(),
    )  # fmt: skip
    early, late = (
        run(made, of, np.vstack([np.zeros((n, 1)), u]), np.vstack([np.zeros((n, 2)), y]))
        for n in (8, 17)
    )
    assert early["d_raw"].any()
    for name in ("x_hat", "P", "d_raw", "d_std"):
        np.testing.assert_allclose(late[name][17:], early[name][8:], rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("factor", [-1.0, 2.0, 1e3])
def test_forces_grow_with_the_measurements(factor):
    """Odd and homogeneous: y and lam times c is the force times c."""
    of = struck.system()
    u, y = struck.record(of, 30, seed=5)
    made = dataclasses.replace(sparse(of, lam=0.6, lag=N), prior=Prior(P0=struck.P0))
    plain = run(made, of, u, y)
    louder = dataclasses.replace(made, lam=abs(factor) * made.lam)
    scaled = run(louder, of, factor * u, factor * y)
    assert np.abs(plain["d_raw"]).max() > 1
    for name in ("d_raw", "x_hat"):
        assert_close(scaled[name], factor * plain[name], 1e-9)
    np.testing.assert_allclose(scaled["d_std"], plain["d_std"], rtol=1e-9)


def test_only_ratios_of_variances_count():
    """Homogeneity: noise, prior and background times c with lam over c are the same forces."""
    of = struck.system()
    u, y = struck.record(of, 30, seed=6)
    c = 7.3
    noisy = dataclasses.replace(of, R=c * of.R, Q=c * of.Q)
    made = sparse(of, lam=0.6, lag=N, sigma_force=0.3)
    other = dataclasses.replace(
        made, noise=Noise(R=noisy.R, Q=noisy.Q), prior=Prior(P0=c * struck.P0, x0=struck.X0),
        sigma_force=0.3 * np.sqrt(c), lam=0.6 / c,
    )  # fmt: skip
    a, b = run(made, of, u, y), run(other, of, u, y)
    assert np.abs(a["d_raw"]).max() > 1
    np.testing.assert_allclose(b["d_raw"], a["d_raw"], rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_known_inputs_of_a_continuous_model(hold):
    """Known inputs held and interpolated, as in the Kalman filter."""
    A = np.array([[0.0, 1.0], [-40.0, -0.7]])
    plant = lti(A, [[0.0], [1.0]], [[1.0, 0.0]], states={"q": "", "v": ""}, inputs={"F": ""},
                outputs={"y": ""})  # fmt: skip
    forced = with_force()
    given = {"noise": Noise(sigma_y=0.01, sigma_w={"v": 0.02}), "prior": Prior(sigma_x0=0.5)}
    rng = np.random.default_rng(7)
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((40, 1))
    made = CompressiveSensingMHE(**given, forces=("hit",), lam=math.inf, N=N, lag=0, hold=hold)
    found = Run(made, forced, 0.05)(u, y)
    expected = Run(KalmanFilter(**given, hold=hold), plant, 0.05)(u, y)
    for name in ("x_hat", "P", "e", "S"):
        assert_close(found[name], expected[name], 1e-9)


def with_force():
    return Model(
        f=lambda x, u, p: [x.v, -40.0 * x.q - 0.7 * x.v + u.F + p.hit],
        h=lambda x, u, p: [x.q],
        states={"q": "", "v": ""},
        inputs={"F": ""},
        outputs={"y": ""},
        parameters={"hit": 0.0},
    )
