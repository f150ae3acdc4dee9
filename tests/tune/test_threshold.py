import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError, TuningError
from backsight.run.estimation import estimate
from backsight.tune import propose_threshold
from backsight.tune.threshold import innovations
from backsight_studies.punch.plant import SOFT, simulate_punch, with_noise
from estimators.punch import joint, motion, observer

DT = 1e-4
LAM = 1000.0


@pytest.fixture(scope="module")
def recording():
    return with_noise(motion(SOFT), 0)


def converged():
    return observer(1.0, reading=SOFT, lam=LAM)


def test_innovations_are_equation_19(recording):
    """Simulated window by window, from the estimates at its beginning."""
    window, first = 50, 12_000
    found = innovations(converged(), joint(SOFT), recording, window=window * DT, settle=first * DT)
    result = estimate(converged(), joint(SOFT), recording)
    x, u, y = (result[n].values for n in ("x_hat", "u", "y"))

    def slope(state, force, m, c, d):
        friction = 30 * np.tanh(50 * state[1])
        return np.array([state[1], (force - c * state[0] - d * state[1] - friction) / m])

    starts = np.arange(first, len(y) - window)
    assert len(found) == len(starts)
    for i in (0, 7, 400, len(starts) - 1):
        state, p, error = x[starts[i], :2], x[starts[i], 2:], []
        for k in range(starts[i], starts[i] + window + 1):
            error.append(abs(y[k, 0] - state[0]))
            k1 = slope(state, u[k, 0], *p)
            k2 = slope(state + DT / 2 * k1, u[k, 0], *p)
            k3 = slope(state + DT / 2 * k2, u[k, 0], *p)
            k4 = slope(state + DT * k3, u[k, 0], *p)
            state = state + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        assert found[i] == pytest.approx(np.trapezoid(error, dx=DT), rel=1e-9)


def test_the_threshold_is_a_quantile_with_a_margin(recording):
    settings = {"window": 0.005, "settle": 1.0}
    found = innovations(converged(), joint(SOFT), recording, **settings)
    gamma = propose_threshold(converged(), joint(SOFT), recording, **settings, quantile=0.9,
                              margin=2.0)  # fmt: skip
    assert gamma == pytest.approx(2.0 * np.quantile(found, 0.9))
    assert gamma > 0


@pytest.mark.slow
def test_the_threshold_of_the_punch():
    """99 % of the innovations at 1000 1/s are below 3.3e-7 m s, by another implementation."""
    recording = with_noise(simulate_punch(SOFT, seconds=4.0), 0)
    gamma = propose_threshold(converged(), joint(SOFT), recording, margin=1.0)
    assert gamma == pytest.approx(3.3e-7, rel=0.1)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"window": 0.0}, TuningError, "window = 0.0"),
        ({"quantile": 1.0}, TuningError, "quantile = 1.0"),
        ({"margin": -1.0}, TuningError, "margin = -1.0"),
        ({"window": 0.2}, DataError, "ten of them must fit behind the first 0.65 s"),
        ({"settle": 5.0}, DataError, "the recording ends at 1.3 s"),
    ],
)
def test_wrong_settings(recording, settings, error, message):
    with pytest.raises(error, match=message):
        propose_threshold(converged(), joint(SOFT), recording, **settings)


def test_an_observer_without_such_a_gain_is_refused(recording):
    kalman = bs.EKF(bs.Noise(sigma_y=1.0), bs.Prior(1.0))
    with pytest.raises(TuningError, match=r"observer is .*EKF"):
        propose_threshold(kalman, joint(SOFT), recording)
