"""The tuner against the likelihood by another route, statsmodels, and the truth."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.analysis.consistency import log_likelihood
from backsight.errors import TuningError
from backsight.tune import Choice, Free, Prediction, Whiteness, fit
from tune import noisy_motion

MODEL = bs.sdof(k=100.0, b=0.5)
NOISE = bs.Noise(sigma_y=1e-2, sigma_w={"q": 1e-3, "v": 1e-3})
PRIOR = bs.Prior(sigma_x0=0.1)
FILTER = bs.KalmanFilter(NOISE, PRIOR)


# Gains of actuator and amplifier, of which only the product acts.
TWO_GAINS = bs.Model(
    f=lambda x, u, p: [x.v, -100 * x.q - 0.5 * x.v + p.a * p.c * u.u],
    h=lambda x, _u, _p: [x.q],
    states={"q": "m", "v": "m/s"},
    inputs={"u": "N"},
    outputs={"y": "m"},
    parameters={"a": 1.0, "c": 1.0},
)


@pytest.fixture(scope="module")
def recording():
    found = noisy_motion.oscillation(1500, seed=3)
    found["y"][200:260] = np.nan
    return found


def test_optimum_is_that_of_the_likelihood_by_another_route(recording):
    names = ("sigma_y.y", "sigma_w.q", "sigma_w.v")
    found = fit(FILTER, MODEL, recording, free=[Free(n, spread=np.inf) for n in names], check=False)

    def cost(moved):
        y, q, v = (found.values[n] * np.exp(m) for n, m in zip(names, moved, strict=True))
        given = {"sigma_y": y, "sigma_q": q, "sigma_v": v, "sigma_x0": 0.1}
        return noisy_motion.minus_log_likelihood(recording, **given)

    best = cost([0, 0, 0])
    assert found.cost == pytest.approx(best, rel=1e-12)
    # The next step of Newton's method, by differences of the other route, in standard deviations.
    for i, name in enumerate(names):
        size = found.std[name] / found.values[name]
        h = 0.05 * size
        up, down = (cost(np.eye(3)[i] * s) for s in (h, -h))
        assert abs(up - down) / (2 * h) * size < 5e-3
    assert found.converged
    assert found.before > best


def test_agrees_with_statsmodels():
    # MLEModel of statsmodels 0.15.0 on this recording: L-BFGS, BFGS and Nelder-Mead in turn.
    recording = noisy_motion.oscillation(3000, seed=1)
    free = [Free(n, spread=np.inf) for n in ("sigma_y", "sigma_w")]
    found = fit(FILTER, MODEL, recording, free=free, check=False, restarts=0)
    expected = {"sigma_y.y": 9.96069783e-4, "sigma_w.q": 2.05697668e-4, "sigma_w.v": 8.93721149e-3}
    for name, value in expected.items():
        assert found.values[name] == pytest.approx(value, rel=1e-4)


def test_bands_hold_the_truth():
    truth = {"sigma_y.y": 1e-3, "sigma_w.v": 1e-2, "k": 100.0, "b": 0.5}
    noise = dataclasses.replace(NOISE, sigma_w={"v": 1e-3})
    ekf = bs.EKF(noise, PRIOR)
    start = bs.sdof(k=130.0, b=0.3)
    scores = []
    for seed in range(6):
        recording = noisy_motion.oscillation(1500, seed=seed, sigma_w={"q": 0.0, "v": 1e-2})
        free = ["sigma_y", "sigma_w", "k", "b"]
        found = fit(ekf, start, recording, free=free, check=False, restarts=0)
        scores.append([(np.log(found.values[n]) - np.log(t)) / (found.std[n] / found.values[n])
                       for n, t in truth.items()])  # fmt: skip
    # 24 numbers that are standard normal: the mean square is 1 ± 0.3.
    assert 0.4 < np.mean(np.square(scores)) < 1.9
    assert np.abs(scores).max() < 4


@pytest.mark.parametrize("method", [bs.EKF, bs.IEKF, bs.UKF])
def test_all_filters_agree_on_a_linear_model(method, recording):
    short = recording.isel(time=slice(0, 600))
    given = {"free": ["sigma_y", "sigma_w", "sigma_x0.q", "x0.v"], "check": False, "restarts": 0}
    reference = fit(FILTER, MODEL, short, **given)
    found = fit(method(NOISE, PRIOR), MODEL, short, **given)
    assert found.cost == pytest.approx(reference.cost, abs=1e-5)


def test_lanes_are_runs_with_the_values_in_the_descriptions(recording):
    found = fit(bs.EKF(NOISE, PRIOR), bs.sdof(k=120.0, b=0.5), recording,
                free=["sigma_y", "sigma_w", "k", "x0"], check=False, restarts=0)  # fmt: skip
    result = bs.estimate(found.estimator, found.model, recording, engine="vm")
    # The integrator is settled anew, for the stiffness that was found.
    assert -float(log_likelihood(result).sum()) == pytest.approx(found.cost, abs=1e-3)


def test_several_recordings_share_what_they_share():
    soft, stiff = (noisy_motion.oscillation(1000, seed=s, k=k) for s, k in ((1, 90.0), (2, 110.0)))
    free = ["sigma_y", "sigma_w", Free("k", per="recording"), Free("b", per=("new", "new", "old"))]
    found = fit(bs.EKF(NOISE, PRIOR), MODEL, [soft, stiff, stiff], free=free, check=False)
    assert set(found.values) >= {"sigma_y.y", "k[1]", "k[2]", "k[3]", "b[new]", "b[old]"}
    assert found.values["k[1]"] == pytest.approx(90, abs=5 * found.std["k[1]"])
    assert found.values["k[2]"] == pytest.approx(110, abs=5 * found.std["k[2]"])
    assert found.models[0].theta[0] == pytest.approx(found.values["k[1]"])
    with pytest.raises(TuningError, match="differ from recording to recording"):
        _ = found.estimator


def test_says_what_it_cannot_find(recording):
    found = fit(FILTER, MODEL, recording, free=["sigma_y", "sigma_w", "sigma_x0.v"])
    assert any("sigma_x0.v is hardly known" in d for d in found.doubts)
    found = fit(bs.EKF(NOISE, PRIOR), TWO_GAINS, recording, free=["sigma_y", "sigma_w", "a", "c"])
    assert any("a and c cannot be told apart" in d for d in found.doubts)
    assert "a and c cannot be told apart" in str(found)


def test_halves_that_want_different_values_are_told():
    calm = noisy_motion.oscillation(1500, seed=1)
    rough = noisy_motion.oscillation(1500, seed=2, sigma_y=4e-3)
    both = bs.from_arrays(
        dt=noisy_motion.DT, u=np.vstack([calm["u"], rough["u"]]),
        y=np.vstack([calm["y"], rough["y"]]), inputs={"u": "N"}, outputs={"y": "m"},
    )  # fmt: skip
    found = fit(FILTER, MODEL, both, free=["sigma_y", "sigma_w"])
    assert any("the two halves" in d for d in found.doubts)


@pytest.mark.parametrize("criterion", [Prediction(ahead=5), Whiteness(lags=10)])
def test_other_criteria_find_the_noise_less_exactly(criterion):
    recording = noisy_motion.oscillation(4000, seed=5, sigma_w={"q": 0.0, "v": 1e-2})
    noise = dataclasses.replace(NOISE, sigma_w={"v": 1e-3})
    best = fit(bs.KalmanFilter(noise, PRIOR), MODEL, recording, free=["sigma_y", "sigma_w"])
    found = fit(
        bs.KalmanFilter(noise, PRIOR), MODEL, recording,
        free=["sigma_y", "sigma_w"], criterion=criterion,
    )  # fmt: skip
    for name, truth in (("sigma_y.y", 1e-3), ("sigma_w.v", 1e-2)):
        assert abs(found.values[name] - truth) < 4 * found.std[name]
        assert found.std[name] > 0.8 * best.std[name]


def test_outliers_do_not_decide_with_a_rule():
    recording = noisy_motion.oscillation(2000, seed=6, sigma_w={"q": 0.0, "v": 1e-2})
    recording["y"][::97] += 0.5
    noise = bs.Noise(sigma_y=1e-2, sigma_w={"v": 1e-3}, outliers=bs.settings.Gate())
    found = fit(bs.KalmanFilter(noise, PRIOR), MODEL, recording, free=["sigma_y", "sigma_w"])
    assert found.values["sigma_y.y"] == pytest.approx(1e-3, rel=0.2)
    plain = dataclasses.replace(noise, outliers=None)
    spoilt = fit(bs.KalmanFilter(plain, PRIOR), MODEL, recording, free=["sigma_y", "sigma_w"])
    assert spoilt.values["sigma_y.y"] > 1e-2


def test_matrices_are_scaled_as_they_are(recording):
    R, Q = np.array([[1e-4]]), np.array([[1e-6, 5e-7], [5e-7, 1e-6]])
    given = bs.KalmanFilter(bs.Noise(R=R, Q=Q), PRIOR)
    found = fit(given, MODEL, recording, free=["R", "Q"], check=False)
    np.testing.assert_allclose(found.estimator.noise.Q, found.values["Q"] * Q)
    np.testing.assert_allclose(found.estimator.noise.R, found.values["R"] * R)
    assert found.start == {"R": 1.0, "Q": 1.0}


def test_horizon_is_chosen_among_options(recording):
    noise = bs.Noise(sigma_y=1e-3, sigma_w=noisy_motion.SIGMA_W)
    window = bs.LinearMHE(noise, PRIOR, N=4)
    found = fit(window, MODEL, recording.isel(time=slice(300, 900)), free=[Choice("N", (3, 12))])
    assert found.chosen == {"N": 12}
    assert found.estimator.N == 12
    assert found.choices["cost"].values[1] < found.choices["cost"].values[0]


def test_refuses_what_cannot_be(recording):
    def refused(match, free, estimator=FILTER, recordings=recording):
        with pytest.raises(TuningError, match=match):
            fit(estimator, MODEL, recordings, free=free)

    refused("'sigma_z' cannot be free", ["sigma_z"])
    refused("'sigma_y.z' cannot be free", ["sigma_y.z"])
    refused("has no Qc", ["Qc"])
    refused("nothing is free", [])
    refused("free names 'sigma_y.y' twice", ["sigma_y", "sigma_y.y"])
    refused("change the same covariance", ["sigma_y", "R"])
    refused("factor of all process noise", ["Q", "sigma_w.q"])
    refused("a whole number: give Choice", ["N"], bs.LinearMHE(NOISE, PRIOR, N=4))
    refused("has no setting 'M'", [Choice("M", (1, 2))], bs.LinearMHE(NOISE, PRIOR, N=4))
    refused("2 groups for 1 recordings", [Free("k", per=("a", "b"))])
    walking = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w={"v": 0.0}), PRIOR)
    refused("starts at 0: give a start value", ["sigma_w.v"], walking)


def test_what_the_data_do_not_tell_is_no_obstacle_without_a_prior(recording):
    free = ["sigma_y", "sigma_w", Free("a", spread=np.inf), Free("c", spread=np.inf)]
    found = fit(bs.EKF(NOISE, PRIOR), TWO_GAINS, recording, free=free)
    assert found.values["a"] * found.values["c"] == pytest.approx(1.0, abs=0.2)
    assert any("a and c cannot be told apart" in d for d in found.doubts)


def test_bounds_of_the_model_are_kept_and_told(recording):
    bounded = dataclasses.replace(MODEL.parameters[0], value=50.0, lower=10.0, upper=80.0)
    model = dataclasses.replace(MODEL, parameters=(bounded, *MODEL.parameters[1:]))
    found = fit(bs.EKF(NOISE, PRIOR), model, recording, free=["k", "sigma_y", "sigma_w"])
    assert 75 < found.values["k"] < 80
    assert any("k is at its bound" in d for d in found.doubts)


def test_passes_are_counted_and_limited(recording):
    given = {"free": ["sigma_y", "sigma_w"], "check": False}
    found = fit(FILTER, MODEL, recording, passes=4, **given)
    assert found.passes <= 5
    assert not found.converged
    assert "has not ended after" in str(found)
    assert fit(FILTER, MODEL, recording, **given).history.sizes["evaluation"] < 60


def test_a_criterion_of_ones_own(recording):
    @dataclasses.dataclass(frozen=True)
    class Size(bs.tune.AbstractCriterion):
        """Innovations as large as predicted, and no more."""

        def residuals(self, z):
            seen = z[np.isfinite(z)]
            return np.array([np.sqrt(len(seen) / 2) * (np.mean(seen**2) - 1)])

    found = fit(FILTER, MODEL, recording, free=["R"], criterion=Size(), check=False)
    assert found.cost < 0.01 < found.before
