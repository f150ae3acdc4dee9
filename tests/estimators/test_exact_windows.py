"""Windows of which nothing is known before, with sensors that have no noise."""

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import TuningError
from backsight.schema import Status
from estimators.exact_plants import DT, P0, SENSORS, A, drawn, plant

WALK, N = np.diag([1e-4, 4e-4]), 4


def alone(C, R, y):
    """The last state given the readings of a window only: the first is flat, by null spaces."""
    n, ny = len(y), len(C)
    values, axes = np.linalg.eigh(R)
    noise, effect, flat = (
        axes * np.sqrt(np.maximum(values, 0)),
        np.zeros((2, (2 + ny) * n)),
        np.eye(2),
    )
    rows, of_first, told = [], [], []
    for i in range(n):
        shown, kept = C @ effect, np.isfinite(y[i])
        shown[:, 2 * n + ny * i : 2 * n + ny * (i + 1)] = noise
        rows.append(shown[kept])
        of_first.append((C @ flat)[kept])
        told.append(y[i][kept])
        if i + 1 < n:
            effect, flat = A @ effect, A @ flat
            effect[:, 2 * i : 2 * i + 2] = np.sqrt(WALK)
    M, G, goal = np.concatenate(rows), np.concatenate(of_first), np.concatenate(told)
    without = scipy.linalg.null_space(G.T).T
    inverse, back = np.linalg.pinv(without @ M, rcond=1e-11), np.linalg.pinv(G)
    z, free = inverse @ without @ goal, np.eye(M.shape[1]) - inverse @ without @ M
    left = effect @ free - flat @ back @ M @ free
    return effect @ z + flat @ back @ (goal - M @ z), left @ left.T


@pytest.mark.parametrize("sensors", SENSORS)
def test_it_is_conditioning_on_the_readings_of_the_window(sensors):
    C, R = (np.array(given) for given in SENSORS[sensors])
    y = drawn(C, R)[:20]
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={f"y{i}": "m" for i in range(len(C))})
    given = bs.Noise(R=R, Q=WALK), bs.Prior(P0=P0)
    result = bs.estimate(bs.LinearMHE(*given, N=N), plant(C), recording, engine="vm", throw=False)
    for k in range(N, len(y)):
        x, P = alone(C, R, y[k - N : k + 1])
        np.testing.assert_allclose(result["x_hat"][k], x, atol=1e-12)
        np.testing.assert_allclose(result["P"][k], P, atol=1e-14)
    told = (result["status"].values & int(Status.REDUNDANT)) > 0
    assert told[1:].all() if sensors.startswith("two") else not result["status"].any()
    # Until it is full, the prior counts: the Kalman filter.
    filtered = bs.estimate(bs.KalmanFilter(*given), plant(C), recording, engine="vm", throw=False)
    np.testing.assert_allclose(result["x_hat"][:N], filtered["x_hat"][:N], atol=1e-12)
    np.testing.assert_allclose(result["P"][:N], filtered["P"][:N], atol=1e-14)


def test_what_a_window_does_not_tell_its_prior_does():
    """A gap as long as the window: the arrival cost stands in, which the status says."""
    y = drawn(np.array([[1.0, 0.0]]), np.zeros((1, 1)))[:16]
    y[6:14] = np.nan
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={"y0": "m"})
    given = bs.Noise(sigma_y=0.0, Q=WALK), bs.Prior(P0=P0)
    model = plant([[1.0, 0.0]])
    alone_, filtered = (
        bs.estimate(e, model, recording, engine=engine, throw=False)
        for e, engine in (
            (bs.LinearMHE(*given, N=N), "native"),
            (bs.KalmanFilter(*given), "vm"),
        )
    )
    lost = (alone_["status"].values & int(Status.UNOBSERVED)) > 0
    assert np.array_equal(np.flatnonzero(lost), np.arange(8, 15))  # fewer than two readings
    np.testing.assert_allclose(alone_["x_hat"][8:14], filtered["x_hat"][8:14], atol=1e-12)
    np.testing.assert_allclose(alone_["P"][8:14], filtered["P"][8:14], atol=1e-14)


def test_many_states_are_the_window_of_the_solver():
    n = 14
    steps = 0.9 * np.eye(n) + 0.1 * np.eye(n, k=1)
    model = bs.lti(
        steps, np.zeros((n, 0)), np.eye(n)[::3], dt=DT, inputs={},
        states={f"x{i}": "" for i in range(n)}, outputs={f"y{i}": "" for i in range(5)},
    )  # fmt: skip
    y = np.random.default_rng(0).standard_normal((7, 5))
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={f"y{i}": "" for i in range(5)})
    small, exact = (
        bs.estimate(
            bs.LinearMHE(bs.Noise(sigma_y=sigma, sigma_w=0.5), bs.Prior(sigma_x0=1.0), N=4),
            model, recording, engine="vm",
        )
        for sigma in (1e-6, 0.0)
    )  # fmt: skip
    np.testing.assert_allclose(exact["x_hat"][-2:], small["x_hat"][-2:], atol=1e-7)
    np.testing.assert_allclose(exact["P"][-2:], small["P"][-2:], atol=1e-7)


def test_limits_need_something_from_before():
    model = bs.lti(
        [[1.0]], np.zeros((1, 0)), [[1.0]], inputs={}, outputs={"y": ""}, dt=1.0,
        states={"q": bs.Signal(upper=1.0)},
    )  # fmt: skip
    window = bs.LinearMHE(bs.Noise(sigma_y=0.0, sigma_w=0.3), bs.Prior(sigma_x0=1.0), N=2)
    with pytest.raises(TuningError, match="arrival_weight > 0"):
        window.compile(model, 1.0)
