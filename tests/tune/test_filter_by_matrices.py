"""The Kalman filter of linear models by matrices alone: as the covariance of all outputs says."""

import dataclasses

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.estimators.base import AbstractEstimator
from backsight.kernels import library
from backsight.tune.fitting.runners import LinearRunner, Rebuilt, linear_runner, quick_runner
from backsight.tune.fitting.values import Free, unknowns_of

PRIOR = bs.Prior(sigma_x0=0.3)


def system(nx, ny, seed=0):
    """A stable model in discrete time with two inputs, and noise of it."""
    rng = np.random.default_rng(seed)
    A = 0.95 * np.linalg.qr(rng.standard_normal((nx, nx)))[0]
    matrices = A, rng.standard_normal((nx, 2)), rng.standard_normal((ny, nx)), np.ones((ny, 2))
    names = {k: {f"{k}{i}": "" for i in range(n)} for k, n in (("x", nx), ("u", 2), ("y", ny))}
    model = bs.lti(*matrices, states=names["x"], inputs=names["u"], outputs=names["y"], dt=0.1)
    G, H = rng.standard_normal((nx, nx)), rng.standard_normal((ny, ny))
    return model, matrices, bs.Noise(Q=1e-2 * G @ G.T, R=H @ H.T + np.eye(ny))


def of_all_outputs(matrices, noise, u, mask):
    """Mean and covariance of what is measured, from the first to the last sample."""
    A, B, C, D = matrices
    n, nx = len(u), len(A)
    P, x, means, states = 0.09 * np.eye(nx), np.zeros(nx), [], []
    for k in range(n):
        means.append(C @ x + D @ u[k])
        states.append(P)
        x, P = A @ x + B @ u[k], A @ P @ A.T + noise.Q
    blocks = [[np.zeros((0, 0))] * n for _ in range(n)]
    for k in range(n):
        row = states[k]
        for i in range(k, n):
            blocks[i][k] = C @ row @ C.T
            blocks[k][i] = blocks[i][k].T
            row = A @ row
        weights = np.where(mask[k] > 0, mask[k], 1.0)
        blocks[k][k] = blocks[k][k] + noise.R / np.outer(weights, weights)
    kept = mask.ravel() > 0
    return np.ravel(means)[kept], np.block(blocks)[np.ix_(kept, kept)]


@pytest.mark.parametrize(("nx", "ny", "n"), [(3, 2, 70), (24, 9, 100)])
def test_innovations_factor_the_covariance_of_all_outputs(nx, ny, n):
    # The larger model takes the library's products, and reuses its gain from sample 75 on.
    model, matrices, noise = system(nx, ny)
    rng = np.random.default_rng(1)
    u, y, mask = rng.standard_normal((n, 2)), rng.standard_normal((n, ny)), np.ones((n, ny))
    mask[3:6], mask[7, 0], mask[-8:, 1], mask[-3, 0] = 0, 0, 0.5, 2.0
    mask[-20, 0] = 0
    kf = bs.KalmanFilter(noise, PRIOR)
    unknowns = unknowns_of([Free("R"), Free("Q")], kf, model)
    data = u, y, mask, y, mask
    runner = quick_runner(kf, model, 0.1, unknowns, data=[data])
    assert isinstance(runner, LinearRunner)
    ((r, d),) = runner.innovations(data, [{"R": 1.0, "Q": 1.0}])
    mean, S = of_all_outputs(matrices, noise, u, mask)
    L, seen = np.linalg.cholesky(S), mask > 0
    np.testing.assert_allclose(d[0][seen], np.diag(L) ** 2, rtol=1e-9)
    white = scipy.linalg.solve_triangular(L, y[seen] - mean, lower=True)
    np.testing.assert_allclose(r[0][seen], white * np.diag(L), rtol=1e-8, atol=1e-8)
    assert not r[0][~seen].any()


def test_noise_of_any_structure_delays_and_hidden_samples():
    model = bs.sdof(k=100.0, b=0.5)
    noise = bs.Noise(sigma_y=1e-3, Qc=np.array([[1e-7, 2e-6], [2e-6, 1e-3]]))
    kf = bs.KalmanFilter(noise, PRIOR, hold="foh")
    free = [
        Free("sigma_y"), Free("Qc", structure="full"), Free("delay.u", sigma=0.01), Free("x0.q"),
    ]  # fmt: skip
    unknowns = unknowns_of(free, kf, model)
    rng = np.random.default_rng(2)
    u, y, mask = rng.standard_normal((60, 1)), 0.1 * rng.standard_normal((60, 1)), np.ones((60, 1))
    seen = mask.copy()
    seen[30:37] = 0
    data = u, y * seen, seen, y, mask
    settings = [{k.name: k.scale.value(t) for k in unknowns} for t in (0.0, 0.6)]
    runner = linear_runner(kf, model, 0.01, unknowns)
    assert runner is not None
    ((r, d),) = runner.innovations(data, settings)
    ((slow_r, slow_d),) = Rebuilt(kf, model, unknowns, 0.01).innovations(data, settings)
    np.testing.assert_allclose(d, slow_d, rtol=1e-9)
    np.testing.assert_allclose(r, slow_r, rtol=1e-9, atol=1e-11)


def test_it_is_for_plain_filters_alone(monkeypatch):
    model, _, noise = system(3, 2)
    kf = bs.KalmanFilter(noise, PRIOR)

    def given(estimator: AbstractEstimator = kf, model=model):
        return linear_runner(estimator, model, 0.1, unknowns_of([Free("R")], estimator, model))

    def changed(group, **what):
        first, *rest = getattr(model, group)
        return dataclasses.replace(model, **{group: (dataclasses.replace(first, **what), *rest)})

    assert given() is not None
    assert given(dataclasses.replace(kf, steady_state=True)) is None
    assert given(dataclasses.replace(kf, prior=bs.Prior(sigma_x0=1e8))) is None
    robust = dataclasses.replace(noise, outliers=bs.settings.Huber())
    assert given(dataclasses.replace(kf, noise=robust)) is None
    assert given(model=changed("states", upper=1.0)) is None
    assert given(model=changed("outputs", wrap=1.0)) is None
    assert given(model=changed("outputs", saturation=(-1.0, 1.0))) is None
    assert given(bs.EKF(noise, PRIOR)) is None
    monkeypatch.setattr(library, "missing", lambda: "no compiler")
    assert given() is None


def test_where_weights_change_all_the_time_lanes_are_quicker(monkeypatch):
    model, _, noise = system(3, 2)
    kf = bs.KalmanFilter(noise, PRIOR)
    unknowns = unknowns_of([Free("R")], kf, model)
    given = kf, model, 0.1, unknowns
    monkeypatch.setattr("backsight.tune.fitting.runners.lanes_of", lambda *_, **__: None)
    n = 10_000
    u, y, mask = np.zeros((n, 2)), np.zeros((n, 2)), np.ones((n, 2))
    assert quick_runner(*given, data=[(u, y, mask, y, mask)]) is not None
    mask[::3, 0] = 0
    assert quick_runner(*given, data=[(u, y, mask, y, mask)]) is None


def test_matrices_of_the_estimator_are_no_part_of_what_is_kept():
    R = np.diag([1.0, 4.0])
    model, _, noise = system(3, 2)

    def system_of():
        kf = bs.KalmanFilter(dataclasses.replace(noise, R=R), PRIOR)
        found = linear_runner(kf, model, 0.1, unknowns_of([Free("Q")], kf, model))
        assert found is not None
        return found.system

    first = system_of()
    assert system_of() is first
    R[0, 0] = 2.0
    assert system_of() is not first
