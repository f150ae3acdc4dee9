"""What innovations are by nature: a gain that is not the Kalman filter's is not blamed for it."""

import re
from collections.abc import Mapping

import numpy as np
import pytest
import scipy
import xarray as xr

from backsight.analysis.comparison import ranked_table, verdicts
from backsight.analysis.comparison._summary import assess
from backsight.analysis.comparison.verdict import sentence
from backsight.analysis.consistency import check_consistency as judge
from backsight.data import from_arrays
from backsight.discrete.noise import discretise_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import (
    EKF,
    HGO,
    MHE,
    MHO,
    UKF,
    KalmanFilter,
    LinearMHE,
    Luenberger,
    Noise,
    Prior,
    RecursiveMHE,
)
from backsight.estimators.arrival import ConstantArrival, NoArrival, SmoothedArrival
from backsight.estimators.base import AbstractEstimator
from backsight.models.lti import lti
from backsight.run.diagnosis._factors_of_results import with_factors
from backsight.run.diagnosis._judges import Judges
from backsight.run.diagnosis.audit import doubts_found, noise_found
from backsight.run.estimation import estimate, estimate_many
from backsight.schema import Status

DT = 0.01
A, B, C = np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([[0.0], [400.0]]), [[1.0, 0.0]]
QC, R, P0 = np.diag([0.0, 4.0]), np.array([[4e-4]]), np.diag([0.04, 4.0])
F, Q = discretise_noise(A, QC, dt=DT)
G = np.linalg.solve(A, (F - np.eye(2)) @ B)
NAMES = {"inputs": {"u": ""}, "outputs": {"y": ""}}
MODEL = lti(A, B, C, states={"x": "", "v": ""}, **NAMES)
NOISE, PRIOR = Noise(R=R, Qc=QC), Prior(P0=P0)
FINE = "consistent, its innovations are as large as it predicts"

ESTIMATORS: Mapping[str, AbstractEstimator] = {
    "fast observer": Luenberger(NOISE, PRIOR, poles=(0.3, 0.35)),
    "slow observer": Luenberger(NOISE, PRIOR, poles=(0.9 + 0.2j, 0.9 - 0.2j)),
    "high gain": HGO(NOISE, PRIOR, gain=40.0),
    "window": LinearMHE(NOISE, PRIOR, N=10),
    "no arrival cost": MHE(NOISE, PRIOR, N=5, arrival=NoArrival(), integrator=Integrator("rk4", 2)),
    "recursive window": RecursiveMHE(NOISE, PRIOR, N=10),
}


def recordings(
    seeds: int, *, n: int = 1200, R_true: float = 1.0, Q_true: float = 1.0, every: int = 1
) -> list[xr.Dataset]:
    """The exact machine, driven by steps of random size, with noise of the sizes believed in."""
    rng = np.random.default_rng(11)
    u = np.repeat(0.3 * rng.standard_normal((n // 5 + 1, seeds)), 5, axis=0)[:n]
    x = rng.standard_normal((seeds, 2)) @ np.sqrt(P0)
    root, y = np.linalg.cholesky(Q_true * Q), np.full((n, seeds), np.nan)
    for k in range(n):
        if k % every == 0:
            y[k] = x[:, 0] + np.sqrt(R_true * R[0, 0]) * rng.standard_normal(seeds)
        x = x @ F.T + u[k][:, None] * G[:, 0] + rng.standard_normal((seeds, 2)) @ root.T
    return [from_arrays(u=u[:, s], y=y[:, s], dt=DT, **NAMES) for s in range(seeds)]


def judged(estimator: AbstractEstimator, data: list[xr.Dataset]) -> list[xr.Dataset]:
    """Results with what is found out about their noise."""
    results = estimate_many(estimator, MODEL, data, threads=1)
    found = [
        noise_found({"": r}, {"": estimator}, Judges(MODEL, d, {"": r}, {"": estimator}))
        for r, d in zip(results, data, strict=True)
    ]
    return [with_factors(r, f[""]) for r, f in zip(results, found, strict=True)]


@pytest.fixture(scope="module")
def right() -> list[xr.Dataset]:
    return recordings(3)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_right_description_is_not_blamed_for_the_gain(name, right):
    for result in judged(ESTIMATORS[name], right):
        found = judge(result)
        assert sentence(assess(result)).startswith(FINE)
        assert found.consistent
        assert found.coloured is None
        assert "its gain makes some" in str(found)


@pytest.mark.parametrize("name", ["fast observer", "high gain", "window"])
@pytest.mark.parametrize("wrong", [{"R_true": 4.0}, {"Q_true": 4.0}])
def test_wrong_noise_is_named_whatever_the_gain(name, wrong):
    says = "R is about" if "R_true" in wrong else "the process noise Q is about"
    for result in judged(ESTIMATORS[name], recordings(2, **wrong)):
        text = sentence(assess(result))
        assert says in text
        assert "too small" in text
        assert not judge(result).consistent


def test_colour_of_an_observer_is_that_of_its_gain(right):
    """By Lyapunov's equation for this gain: so coloured are innovations of a right description."""
    observer = ESTIMATORS["fast observer"]
    K = observer.observer(MODEL, DT).gain
    closed = F @ (np.eye(2) - K @ np.array(C))
    P = scipy.linalg.solve_discrete_lyapunov(closed, F @ K @ R @ K.T @ F.T + Q)
    S = np.array(C) @ P @ np.transpose(C) + R
    ahead = F @ (P @ np.transpose(C) - K @ S)
    lag1 = float((np.array(C) @ ahead / S)[0, 0])
    assert abs(lag1) > 0.2
    results = judged(observer, right)
    assert float(results[0].S[-1, 0, 0]) == pytest.approx(S[0, 0], rel=1e-6)
    seen = np.mean([judge(r).colours[0].lag1 for r in results])
    assert seen == pytest.approx(lag1, abs=0.05)


def test_size_of_coloured_innovations_has_a_wider_band(right):
    (result, *_) = judged(ESTIMATORS["slow observer"], right)
    low, high = judge(result).nis_band
    plain_low, plain_high = judge(result.assign_attrs(innovations="white")).nis_band
    assert low < plain_low
    assert plain_high < high


def test_only_size_is_judged_where_nothing_else_can_be():
    data = recordings(1, n=400)
    (result,) = judged(ESTIMATORS["fast observer"], data)
    assert "no more than their size is judged" in sentence(assess(result))


@pytest.mark.parametrize("every", [1, 15])
def test_sparse_measurements_of_a_right_description_raise_no_alarm(every):
    """One sample in `every` is measured, over a thousand in all."""
    data = recordings(3, n=1100 * every, every=every)
    for result in judged(KalmanFilter(NOISE, PRIOR), data):
        assert sentence(assess(result)) == FINE
        noise = judge(result).noise
        assert noise is None or abs(noise.R - 1) < 4 * noise.R_std or noise.R_std > 0.1


def test_estimators_say_what_their_innovations_are():
    said = {
        "white": [
            KalmanFilter(NOISE, PRIOR),
            EKF(NOISE, PRIOR),
            UKF(NOISE, PRIOR),
            MHE(NOISE, PRIOR),
            LinearMHE(NOISE, PRIOR, arrival_weight=1.0),
        ],
        "coloured": [
            EKF(NOISE, PRIOR, measurement="continuous"),
            MHE(NOISE, PRIOR, arrival=ConstantArrival()),
            MHE(NOISE, PRIOR, arrival=SmoothedArrival(naive=True)),
            LinearMHE(NOISE, PRIOR, arrival_weight=0.5),
            MHO(NOISE, PRIOR),
            *ESTIMATORS.values(),
        ],
    }
    for kind, estimators in said.items():
        assert {e.innovations for e in estimators} == {kind}


def test_a_lead_by_rounding_ranks_nothing(right):
    (result, *_) = judged(KalmanFilter(NOISE, PRIOR), right)
    nudged = result.assign(e=result.e * (1 + 1e-11))
    first = verdicts(ranked_table({"A": result, "B": nudged}))[0]
    assert "explain the recording equally well" in first
    worse = result.assign(e=result.e * 1.1)
    assert "by " in verdicts(ranked_table({"A": result, "B": worse}))[0]


@pytest.mark.parametrize("size", [1e10, 1e155, 1e300])
@pytest.mark.parametrize("variable", ["P", "S", "x_hat", "e"])
def test_diverged_results_are_judged_without_a_crash(right, variable, size):
    (result, *_) = judged(ESTIMATORS["fast observer"], right)
    values = result[variable].values.copy()
    values[200:] *= size
    wild = result.assign({variable: (result[variable].dims, values)})
    with np.errstate(over="ignore", invalid="ignore"):
        found = judge(wild.assign(x_true=result.x_hat))
    if variable in "Se":
        assert not found.consistent
    assert sentence(assess(wild))


def test_a_filter_that_runs_away_fails_by_its_status():
    """It grows by a half per sample, and the filter is told of nothing that could mend that."""
    model = lti([[1.5]], [[1.0]], [[1.0]], states={"x": ""}, dt=DT, **NAMES)
    sure = KalmanFilter(Noise(sigma_y=1.0), Prior(sigma_x0=0.0, x0=[1.0]))
    data = from_arrays(u=np.zeros(80), y=np.zeros(80), dt=DT, **NAMES)
    blind = data.assign(y=data.y.where(np.arange(80)[:, None] > 70))
    result = estimate(sure, model, blind, throw=False, engine="vm")
    assert int(result.status[-1]) & Status.NOT_FINITE
    assert int(result.status[0]) == 0
    assert "diverged" in sentence(assess(result))


@pytest.mark.slow
def test_right_kalman_filter_is_doubted_in_one_run_of_a_hundred_at_most():
    """Of 600 runs; six alarms are expected at most, and 13 in one test of a hundred."""
    results = judged(KalmanFilter(NOISE, PRIOR), recordings(600, n=1500))
    found = [judge(r) for r in results]
    sentences = [sentence(assess(r)) for r in results]
    assert sum(not f.consistent for f in found) <= 12
    assert [s.startswith("consistent, ") for s in sentences] == [f.consistent for f in found]
    assert np.mean([f.noise.R for f in found]) == pytest.approx(1.0, abs=0.01)
    assert np.mean([f.noise.Q for f in found]) == pytest.approx(1.0, abs=0.025)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fast observer", "slow observer", "high gain", "window"])
def test_right_observer_is_doubted_as_seldom(name):
    results = judged(ESTIMATORS[name], recordings(200, n=1500))
    found = [judge(r) for r in results]
    assert sum(not f.consistent for f in found) <= 6
    sentences = [sentence(assess(r)) for r in results]
    assert [s.startswith("consistent, ") for s in sentences] == [f.consistent for f in found]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Kalman filter", "fast observer"])
@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"R_true": 4.0}, r"R is about \d\.?\d? times too small"),
        ({"R_true": 0.25}, r"R is about \d\.?\d? times too large"),
        ({"Q_true": 4.0}, r"Q is about \d\.?\d? times too small"),
        ({"Q_true": 0.25}, r"Q is about \d\.?\d? times too large"),
    ],
)
def test_noise_wrong_by_four_is_named_in_nine_of_ten(name, wrong, says):
    estimator = {**ESTIMATORS, "Kalman filter": KalmanFilter(NOISE, PRIOR)}[name]
    results = judged(estimator, recordings(100, n=1500, **wrong))
    assert sum(bool(re.search(says, sentence(assess(r)))) for r in results) >= 90


@pytest.mark.parametrize("with_filter", [False, True])
def test_the_filter_that_judges_runs_once_for_all(with_filter, monkeypatch):
    """For estimators of the same belief, R as a matrix; not at all if it is one of them."""
    recording = recordings(1, n=600)[0]
    estimators = {
        f"MHE {N}": MHE(Noise(R=R.copy(), Q=Q), PRIOR, N=N, arrival=NoArrival()) for N in (2, 3)
    }
    if with_filter:
        estimators["KF"] = KalmanFilter(Noise(R=R.copy(), Q=Q), PRIOR)
    results = {k: estimate(e, MODEL, recording, engine="vm") for k, e in estimators.items()}
    judges = Judges(MODEL, recording, results, estimators)
    ran = []
    trial = judges.trial
    monkeypatch.setattr(judges, "trial", lambda judge: ran.append(judge) or trial(judge))
    noise_found(results, estimators, judges)
    doubts_found(results, estimators, judges)
    assert len(ran) == (not with_filter)
