"""Samples with a noise of their own: R of every sample is its own, for all estimators."""

import dataclasses

import numpy as np
import pytest

from backsight.data import from_arrays
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import DataError
from backsight.estimators import (
    AHG,
    EKF,
    HGO,
    MHE,
    MHO,
    UKF,
    CompressiveSensingMHE,
    EKFArrival,
    JointInput,
    KalmanFilter,
    Limit,
    LinearMHE,
    Luenberger,
    Noise,
    Prior,
    RecursiveMHE,
    SmoothedArrival,
    UKFArrival,
)
from backsight.models.lti import lti
from backsight.models.structures.second_order import second_order
from backsight.run.estimation import estimate, estimate_many, match, solve_window, stream
from backsight.solvers.box import GaussNewton
from closeness import assert_close
from oracles.kalman import kalman_filter
from relations.linear import DT, GAUSSIANS, P0, SYSTEM, X0, A, B, C, Q, R, model, record

ONCE = GaussNewton(1, tolerance=0.0)
KALMAN = {
    "ekf": EKF(**GAUSSIANS),
    "ukf": UKF(**GAUSSIANS),
    "kf": KalmanFilter(**GAUSSIANS),
    "mho": MHO(**GAUSSIANS, N=4, alpha=0.0),
    "lmhe": LinearMHE(**GAUSSIANS, N=4, arrival_weight=1.0),
    "mhe": MHE(**GAUSSIANS, N=4, arrival=SmoothedArrival(), optimiser=ONCE),
    "mhe, ekf": MHE(**GAUSSIANS, N=4, arrival=EKFArrival(), optimiser=ONCE),
    "mhe, ukf": MHE(**GAUSSIANS, N=4, arrival=UKFArrival(), optimiser=ONCE),
}
"""Estimators that are the Kalman filter on a linear model."""

STAGE = lti(
    np.array([[0.0, 1.0], [-30.0, -0.8]]), np.array([[0.0, 0.0], [2.0, 1.0]]), np.eye(2),
    states={"q": "m", "v": "m/s"}, inputs={"f": "N", "g": "N"}, outputs={"y": "m", "z": "m/s"},
)  # fmt: skip
FORCED = second_order(
    np.eye(2), 0.4 * np.eye(2), np.array([[30.0, -10.0], [-10.0, 20.0]]),
    forces={"f": "q1", "g": "q2", "F": "q2"}, inputs={"f": "N", "g": "N"},
    parameters={"F": (0.0, "N")},
    outputs={"y": ("acceleration", "q1"), "z": ("acceleration", "q2")},
)  # fmt: skip
SPRING = second_order(
    1, 0.4, 30, forces={"f": "q1", "F": "q1"}, inputs={"f": "N"}, parameters={"F": (0.0, "N")},
    outputs={"y": ("displacement", "q1")},
)  # fmt: skip
DECAYING = lti(
    np.array([[0.9, 0.3, 0.0], [-0.4, 0.8, 0.1], [0.0, 0.0, 0.9]]), B, C,
    states=dict.fromkeys("abc", ""), inputs={"f": "", "g": ""}, outputs={"y": "", "z": ""}, dt=DT,
)  # fmt: skip
NARROW = Limit("sum", {"a": 1.0, "c": 0.5}, upper=0.7)
WALK = Noise(R=R, sigma_w=0.05)
SPARSE = {"forces": ("F",), "sigma_force": {"F": 0.3}}
OTHER = {
    "ekf, continuous": (
        EKF(WALK, Prior(1.0), Integrator("rk4", 4), measurement="continuous"),
        STAGE,
    ),
    "mho": (MHO(**GAUSSIANS, N=4, alpha=0.5), model()),
    "mhe, limits": (MHE(**GAUSSIANS, N=3, limits=(NARROW,)), DECAYING),
    "mhe, lag": (MHE(**GAUSSIANS, N=3, lag=2), model()),
    "lmhe, no prior": (LinearMHE(**GAUSSIANS, N=4), DECAYING),
    "lmhe, limits": (LinearMHE(**GAUSSIANS, N=4, limits=(NARROW,)), DECAYING),
    "luenberger": (Luenberger(**GAUSSIANS, poles=(0.4, 0.5, 0.6)), DECAYING),
    "prediction": (Luenberger(**GAUSSIANS, poles=(0.4, 0.5, 0.6), form="prediction"), DECAYING),
    "csmhe": (CompressiveSensingMHE(WALK, Prior(1.0), **SPARSE, lam=0.5, N=4), FORCED),
    "csmhe, lag": (
        CompressiveSensingMHE(
            WALK, Prior(1.0), **SPARSE, lam=0.5, N=4, lag=1, arrival=SmoothedArrival(naive=True)
        ),
        FORCED,
    ),
    "joint input": (JointInput(WALK, Prior(1.0), forces=("F",), sigma_force={"F": 1.0}), FORCED),
}
"""Estimators in settings in which they are not the Kalman filter, and models for them."""

ONE = Noise(R=R[:1, :1], sigma_w=0.05)
REFUSING = {
    "hgo": HGO(ONE, Prior(1.0), gain=5.0),
    "ahg": AHG(ONE, Prior(1.0), gain=5.0, Gamma=1.0),
    "rmhe": RecursiveMHE(ONE, Prior(1.0), N=5),
}


def recording(u, y, factor=None):
    units = [dict.fromkeys(n[: a.shape[1]], "") for n, a in (("fg", u), ("yz", y))]
    return from_arrays(u=u, y=y, dt=DT, inputs=units[0], outputs=units[1], sigma_factor=factor)


def factors(n: int, *, seed: int) -> np.ndarray:
    """Noise of the nominal size, smaller, larger, and of which nothing is known."""
    sizes = [1.0, 1.0, 0.25, 2.0, 30.0, np.inf]
    return np.random.default_rng(seed).choice(sizes, size=(n, 2))


@pytest.mark.parametrize("engine", ["vm", "native"])
@pytest.mark.parametrize("name", KALMAN)
def test_every_sample_has_its_own_covariance(name, engine):
    (u, y), factor = record(60, seed=1, missing=0.1), factors(60, seed=2)
    result = estimate(KALMAN[name], model(), recording(u, y, factor), engine=engine)
    seen = np.where(np.isfinite(factor), y, np.nan)
    x, P = kalman_filter(seen, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0, factor=factor)
    assert_close(result["x_hat"].values, x, 1e-10)
    assert_close(result["P"].values, P, 1e-10)
    np.testing.assert_array_equal(np.isnan(result["e"].values), np.isnan(seen))

    x_prior = np.vstack([X0, x[:-1] @ A.T + u[:-1] @ B.T])
    P_prior = np.concatenate([P0[None], A @ P[:-1] @ A.T + Q])
    D = np.where(np.isnan(seen), 1.0, factor)
    S = C @ P_prior @ C.T + R * D[:, :, None] * D[:, None, :]
    assert_close(np.nan_to_num(result["e"].values), np.nan_to_num(seen - x_prior @ C.T), 1e-10)
    assert_close(result["S"].values, S, 1e-10)


@pytest.mark.parametrize("name", OTHER)
def test_one_factor_for_all_is_another_noise(name):
    """Gaps included, and with correlated noise."""
    estimator, plant = OTHER[name]
    u, y = record(50, seed=3, missing=0.1)
    noise = dataclasses.replace(estimator.noise, R=9 * R)
    expected = estimate(dataclasses.replace(estimator, noise=noise), plant, recording(u, y))
    result = estimate(estimator, plant, recording(u, y, np.full(y.shape, 3.0)))
    for variable in ("x_hat", "P", "y_hat"):
        assert_close(result[variable].values, expected[variable].values, 1e-8)
    # The noise of a value that was not measured is the nominal one.
    complete = np.isfinite(y).all(axis=1)
    assert_close(result["S"].values[complete], expected["S"].values[complete], 1e-8)
    assert_close(*(np.nan_to_num(r["e"].values) for r in (result, expected)), 1e-8)
    if "d_hat" in expected:
        assert np.abs(expected["d_hat"].values).max() > 0.1
        assert_close(result["d_hat"].values, expected["d_hat"].values, 1e-8)
    if name == "joint input":
        assert_close(result["P_d"].values, expected["P_d"].values, 1e-8)


def test_a_great_noise_still_tells_a_force():
    """The force is determined, however badly; it does not count as not measured."""
    estimator, plant = OTHER["joint input"]
    u, y = record(20, seed=3, missing=0.0)
    noise = dataclasses.replace(estimator.noise, R=1e8 * R)
    expected = estimate(dataclasses.replace(estimator, noise=noise), plant, recording(u, y))
    result = estimate(estimator, plant, recording(u, y, np.full(y.shape, 1e4)))
    assert not expected["status"].any()
    assert not result["status"].any()
    assert_close(result["d_std"].values, expected["d_std"].values, 1e-6)


@pytest.mark.parametrize("name", [*OTHER, *KALMAN])
def test_infinite_noise_is_not_measured(name):
    estimator, plant = OTHER.get(name) or (KALMAN[name], model())
    u, y = record(40, seed=4, missing=0.0)
    factor = np.where(np.random.default_rng(5).random(y.shape) < 0.3, np.inf, 1.0)
    absent = estimate(estimator, plant, recording(u, np.where(np.isinf(factor), np.nan, y)))
    result = estimate(estimator, plant, recording(u, y, factor))
    for variable in ("x_hat", "P", "e", "S", "y", "status"):
        np.testing.assert_array_equal(result[variable].values, absent[variable].values)


@pytest.mark.parametrize("of", [EKF, KalmanFilter, MHE])
def test_many_states(of):
    """Beyond straight-line code."""
    n, rng = 14, np.random.default_rng(6)
    turned, _ = np.linalg.qr(rng.standard_normal((n, n)))
    system = {"A": 0.95 * turned, "B": rng.standard_normal((n, 2)), "C": np.eye(2, n)}
    plant = lti(
        **system, states={f"x{i}": "" for i in range(n)}, inputs={"f": "", "g": ""},
        outputs={"y": "", "z": ""}, dt=DT,
    )  # fmt: skip
    (u, y), factor = record(20, seed=6, missing=0.2), factors(20, seed=7)
    settings = {"N": 3, "optimiser": ONCE} if of is MHE else {}
    estimator = of(Noise(R=R, Q=0.01 * np.eye(n)), Prior(P0=np.eye(n)), **settings)
    result = estimate(estimator, plant, recording(u, y, factor))
    seen = np.where(np.isfinite(factor), y, np.nan)
    x, P = kalman_filter(
        seen, u, **system, Q=0.01 * np.eye(n), R=R, x0=np.zeros(n), P0=np.eye(n), factor=factor
    )
    assert_close(result["x_hat"].values, x, 1e-10)
    assert_close(result["P"].values, P, 1e-10)
    D = np.where(np.isnan(seen), 1.0, factor)
    P_prior = np.concatenate([np.eye(n)[None], 0.95**2 * turned @ P[:-1] @ turned.T])
    P_prior[1:] += 0.01 * np.eye(n)
    S = P_prior[:, :2, :2] + R * D[:, :, None] * D[:, None, :]
    assert_close(result["S"].values, S, 1e-10)


def test_lanes_and_streams_do_the_same():
    runs = [(*record(n, seed=n, missing=0.1), factors(n, seed=n)) for n in (30, 30, 25, 30)]
    recordings = [recording(*run) for run in runs]
    filter_ = KALMAN["mhe"]
    alone = [estimate(filter_, model(), r, engine="native") for r in recordings]
    for result, expected in zip(estimate_many(filter_, model(), recordings), alone, strict=True):
        assert_close(result["x_hat"].values, expected["x_hat"].values, 1e-12)
        assert_close(result["S"].values, expected["S"].values, 1e-12)
    live, (u, y, factor) = stream(filter_, model(), DT, engine="vm"), runs[0]
    for k in range(30):
        step = live.step(u[k], y[k], sigma_factor=factor[k])
        assert_close(step["x_hat"], alone[0]["x_hat"].values[k], 1e-11)


def test_residuals_of_the_window_are_those_of_the_measurement():
    """Not divided by the factor; where the noise is small they are small."""
    u, y = record(30, seed=8, missing=0.0)
    factor = np.ones(y.shape)
    factor[28] = 1e-4
    found = solve_window(KALMAN["mhe"], model(), recording(u, y, factor))
    expected = y[-5:] - found["x"].values @ C.T
    assert_close(found["v"].values, expected, 1e-10)
    assert np.abs(expected[-2]).max() < 1e-5 < np.abs(expected[-1]).max()


@pytest.mark.parametrize("name", REFUSING)
def test_estimators_that_cannot_weigh_say_so(name):
    u, y = (a[:, :1] for a in record(30, seed=9, missing=0.0))
    factor, estimator = np.ones(y.shape), REFUSING[name]
    plain = estimate(estimator, SPRING, recording(u, y))
    nominal = estimate(estimator, SPRING, recording(u, y, factor))
    np.testing.assert_array_equal(nominal["x_hat"].values, plain["x_hat"].values)
    factor[7] = 2.0
    with pytest.raises(DataError, match=rf"'y'.*sample 7.*{estimator.title}.*sigma_factor"):
        estimate(estimator, SPRING, recording(u, y, factor))
    with pytest.raises(DataError, match=r"recording 1: .*sigma_factor"):
        estimate_many(estimator, SPRING, [recording(u, y), recording(u, y, factor)])
    with pytest.raises(DataError, match="sigma_factor"):
        stream(estimator, SPRING, DT, engine="vm").step(u[0], y[0], sigma_factor=2.0)


def test_what_knows_no_estimator_refuses_too():
    u, y = record(10, seed=9, missing=0.0)
    with pytest.raises(DataError, match="this method cannot"):
        match(model(), recording(u, y, np.full(y.shape, 2.0)))


def test_a_factor_in_a_stream_must_be_positive():
    live = stream(KALMAN["kf"], model(), DT, engine="vm")
    with pytest.raises(DataError, match=r"'z' is 0 at"):
        live.step([0.0, 0.0], [0.0, 0.0], sigma_factor={"z": 0.0})
