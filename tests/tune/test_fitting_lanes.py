"""Innovations in lanes are those of runs with the values in the descriptions, however judged."""

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.analysis.consistency import log_likelihood
from backsight.run.estimation import match
from backsight.tune import Prediction, fit
from backsight.tune.fitting.runners import Rebuilt, lanes_of
from backsight.tune.fitting.values import Free, unknowns_of
from tune import noisy_motion

MODEL = bs.Model(
    f=lambda x, u, p: [x.v, -p.k * x.q - 0.5 * x.v + u.u],
    h=lambda x, _u, _p: [x.q, x.q + 0.1 * x.v],
    states={"q": "m", "v": "m/s"},
    inputs={"u": "N"},
    outputs={"y1": "m", "y2": "m"},
    parameters={"k": 100.0},
)
NOISE = bs.Noise(R=np.array([[1e-6, 4e-7], [4e-7, 1e-6]]), sigma_w={"q": 1e-4, "v": 1e-2})
PRIOR = bs.Prior(sigma_x0=0.1)


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(0)
    y = 0.05 * rng.standard_normal((120, 2))
    y[20:30, 0], y[50:55] = np.nan, np.nan
    found = bs.from_arrays(
        dt=0.01, u=rng.standard_normal((120, 1)), y=y, inputs={"u": "N"},
        outputs={"y1": "m", "y2": "m"},
    )  # fmt: skip
    factor = np.where(rng.uniform(size=(120, 2)) < 0.3, 3.0, 1.0)
    return found.assign(sigma_factor=(("time", "output"), factor))


@pytest.mark.parametrize("kind", [bs.KalmanFilter, bs.UKF])
def test_lanes_are_runs_of_their_own(kind, recording):
    estimator = kind(NOISE, PRIOR)
    names = ("R", "sigma_w.v", "sigma_x0", "x0.q")
    unknowns = unknowns_of([Free(n) for n in names], estimator, MODEL)
    u, y, mask = match(MODEL, recording, estimator=estimator)
    seen = mask.copy()
    seen[80:90] = 0
    data = (u, y, seen, y, mask)
    starts = {n.name: n.start for n in unknowns}
    settings = [starts, {n.name: n.scale.value(0.7) for n in unknowns}, starts | {"R": 5.0}]
    lanes = lanes_of(estimator, MODEL, 0.01, unknowns)
    (fast,) = lanes.innovations(data, settings)
    (slow,) = Rebuilt(estimator, MODEL, unknowns, 0.01).innovations(data, settings)
    # Sensors have noise of 1e-3, the motion is 0.05.
    np.testing.assert_allclose(fast[0], slow[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(fast[1], slow[1], rtol=1e-8)


def test_cost_is_the_likelihood_of_correlated_and_missing_outputs(recording):
    found = fit(bs.KalmanFilter(NOISE, PRIOR), MODEL, recording, free=["R"], check=False)
    result = bs.estimate(found.estimator, MODEL, recording)
    assert found.cost == pytest.approx(-float(log_likelihood(result).sum()), rel=1e-9)
    before = bs.estimate(bs.KalmanFilter(NOISE, PRIOR), MODEL, recording)
    assert found.before == pytest.approx(-float(log_likelihood(before).sum()), rel=1e-9)


def test_predictions_are_those_of_samples_that_are_not_there():
    recording = noisy_motion.oscillation(200, seed=1)
    model, criterion = bs.sdof(k=100.0, b=0.5), Prediction(ahead=5, every=20)
    ekf = bs.EKF(bs.Noise(sigma_y=2e-3, sigma_w={"v": 1e-2}), PRIOR)
    found = fit(ekf, model, recording, free=["sigma_y"], criterion=criterion, check=False)
    hidden = criterion.hidden(200)
    assert hidden.sum() == 50
    blind = recording.copy(deep=True)
    blind["y"][hidden] = np.nan
    result = bs.estimate(found.estimator, model, blind, engine="vm")
    variance = result["P"].values[:, 0, 0] + found.values["sigma_y.y"] ** 2
    error = recording["y"].values[:, 0] - result["y_hat"].values[:, 0]
    density = scipy.stats.norm.logpdf(error[hidden], scale=np.sqrt(variance[hidden]))
    assert found.cost == pytest.approx(-density.sum(), rel=1e-9)
    assert found.measured == 50


def test_parameters_of_a_linear_model_make_it_an_extended_filter(recording):
    unknowns = unknowns_of([Free("k")], bs.KalmanFilter(NOISE, PRIOR), MODEL)
    lanes = lanes_of(bs.KalmanFilter(NOISE, PRIOR), MODEL, 0.01, unknowns)
    assert isinstance(lanes.wide.varied, bs.EKF)
    steady = bs.KalmanFilter(NOISE, PRIOR, steady_state=True)
    assert not lanes_of(steady, MODEL, 0.01, unknowns).wide.varied.constant_gain


def test_a_program_is_kept_for_what_says_the_same():
    R = np.diag([1e-6, 4e-6])

    def lanes():
        estimator = bs.KalmanFilter(bs.Noise(R=R, sigma_w=NOISE.sigma_w), PRIOR)
        unknowns = unknowns_of([Free("sigma_w.v")], estimator, MODEL)
        return lanes_of(estimator, MODEL, 0.01, unknowns)

    first = lanes()
    assert lanes().recursion is first.recursion
    R[0, 0] = 2e-6
    assert lanes().recursion is not first.recursion
    R[0, 0] = 1e-6
    again = lanes()
    assert again.recursion is first.recursion
    np.testing.assert_array_equal(again.estimator.noise.R, R)
