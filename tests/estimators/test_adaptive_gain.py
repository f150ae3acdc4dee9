import dataclasses

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.engine import native
from backsight.errors import DataError, TuningError
from backsight.estimators import Prior
from backsight.estimators.observers.adaptive_gain import AdaptiveGain, gain_step
from backsight.run.estimation import estimate
from backsight_studies.punch.plant import SOFT, simulate_punch, with_noise
from estimators.punch import joint, motion, observer

GAIN = AdaptiveGain(lower=100.0, gamma=6e-7, beta=3e7, window=0.04, every=0.001, down=50.0)
UPPER, DT = 1000.0, 1e-4


@pytest.fixture(scope="module")
def recording():
    changes = {1.0: {"c": 1.5 * SOFT.stiffness}}
    return with_noise(simulate_punch(SOFT, seconds=1.2, changes=changes), 0)


def run(recording, **settings):
    given = {"reading": SOFT, "lam": UPPER, "adaptive": GAIN} | settings
    return estimate(observer(1.0, **given), joint(SOFT), recording)


def innovations(result, every, window):
    """Equation 19 written out: the model from the estimates one window ago, trapezoids."""
    x = result["x_hat"].values
    u, y = result["u"].values[:, 0], result["y"].values[:, 0]

    def slope(state, force, m, c, d):
        return np.array(
            [state[1], (force - c * state[0] - d * state[1] - 30 * np.tanh(50 * state[1])) / m]
        )

    found = {}
    for end in range(window, len(y), every):
        begin = end - window
        state, p = x[begin, :2], x[begin, 2:]
        error = [abs(y[begin] - state[0])]
        for k in range(begin, end):
            k1 = slope(state, u[k], *p)
            k2 = slope(state + DT / 2 * k1, u[k], *p)
            k3 = slope(state + DT / 2 * k2, u[k], *p)
            k4 = slope(state + DT * k3, u[k], *p)
            state = state + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            error.append(abs(y[k + 1] - state[0]))
        found[end] = np.trapezoid(error, dx=DT)
    return found


@pytest.mark.parametrize("switch", ["smooth", "hard"])
def test_the_gain_is_equations_17_to_19(recording, switch):
    every, window = 50, 200
    gain = dataclasses.replace(
        GAIN,
        gamma=3e-7,
        beta=GAIN.beta if switch == "smooth" else None,
        every=every * DT,
        window=window * DT,
        switch=switch,
    )
    part = recording.isel(time=slice(8800, 11_000))
    begin = part["x_true"].values[0]
    known = Prior(x0=dict(zip("qvmcd", begin, strict=True)), sigma_x0=1e-3)
    estimator = observer(reading=SOFT, lam=UPPER, adaptive=gain)
    result = estimate(dataclasses.replace(estimator, prior=known), joint(SOFT), part)
    assert list(result["parameter"].values) == ["m", "c", "d"]
    areas = innovations(result, every, window)
    lam, S, expected = UPPER, 1.0, []
    for k in range(part.sizes["time"]):
        expected.append(lam)
        if k in areas:
            smooth = 1 / (1 + np.exp(-GAIN.beta * (areas[k] - gain.gamma)))
            S = smooth if switch == "smooth" else float(areas[k] >= gain.gamma)  # eq. 19, eq. 18
        rate = gain.up * S + gain.down * (1 - S)
        rest = (gain.up * S * UPPER + gain.down * (1 - S) * gain.lower) / rate
        lam = rest + (lam - rest) * np.exp(-rate * DT)
    assert max(areas.values()) > gain.gamma > min(areas.values())
    np.testing.assert_allclose(result["lam"].values, expected, rtol=1e-6)


def test_the_gain_falls_without_and_rises_with_a_change(recording):
    lam = run(recording)["lam"].values
    assert lam[0] == UPPER
    assert lam[9990] < 150
    assert lam[10_000:11_000].max() > 0.9 * UPPER
    assert lam.min() >= GAIN.lower
    assert lam.max() <= UPPER


@pytest.mark.parametrize("S", [0.0, 0.3, 1.0])
def test_one_sample_of_equation_17(S):
    def rhs(t, lam):
        return GAIN.up * S * (UPPER - lam) + GAIN.down * (1 - S) * (GAIN.lower - lam)

    for lam in (100.0, 400.0, 1000.0):
        exact = solve_ivp(rhs, (0, 0.01), [lam], rtol=1e-11, atol=1e-9).y[0, -1]
        found = float(gain_step(GAIN, UPPER, 0.01)(lam, S))
        assert found == pytest.approx(exact, rel=1e-8)
        assert GAIN.lower <= found <= UPPER


def test_sharpness_by_default():
    gain = AdaptiveGain(lower=1.0, gamma=2e-7)
    S = [float(ca.evalf(gain.sigmoid(ca.SX(i)))) for i in (0.0, gain.gamma, 2 * gain.gamma)]
    np.testing.assert_allclose(S, [1 / (1 + np.exp(20)), 0.5, 1 / (1 + np.exp(-20))], rtol=1e-9)


def test_missing_samples_do_not_count():
    """What stands in the place of a sample that was not measured changes nothing."""
    recording = with_noise(motion(SOFT), 0).isel(time=slice(0, 9000))
    recursion = observer(1.0, reading=SOFT, lam=UPPER, adaptive=GAIN).compile(joint(SOFT), DT)
    u, y = recording["u"].values, recording["y"].values
    mask = np.ones_like(y)
    mask[::2] = 0.0
    lam = []
    for value in (0.0, 1e3):
        data = [u, np.where(mask == 1, y, value), mask]
        _, outputs = native.run(recursion, data, carry=recursion.carry0)
        names = [c.name for c in recursion.channels]
        lam.append(outputs[names.index("lam")][:, 0])
    np.testing.assert_array_equal(lam[0], lam[1])
    assert lam[0][-1] < 0.9 * UPPER


def test_a_window_longer_than_the_recording():
    short = motion(SOFT).isel(time=slice(0, 400))
    with pytest.raises(DataError, match="400 samples; a window of 'ahg' alone takes 401"):
        run(short)
    run(motion(SOFT).isel(time=slice(0, 401)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lower": 0.0}, "lower is 0.0"),
        ({"gamma": -1.0}, "gamma is -1.0"),
        ({"beta": 0.0}, "beta is 0.0"),
        ({"up": np.inf}, "up is inf"),
        ({"window": 0.0005}, "shorter than the time between evaluations"),
        ({"switch": "hard", "beta": 1.0}, "sharpness of the smooth switch"),
        ({"switch": "soft"}, "soft"),
    ],
)
def test_wrong_settings(settings, message):
    with pytest.raises(TuningError, match=f"adaptive gain: .*{message}"):
        AdaptiveGain(**({"lower": 1.0, "gamma": 1.0} | settings))
