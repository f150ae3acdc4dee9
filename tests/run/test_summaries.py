"""Totals that accumulate while an estimator runs say what the analysis of its results says."""

import dataclasses

import numpy as np
import pytest

from backsight import settings
from backsight.analysis.comparison import summary
from backsight.data import from_arrays
from backsight.errors import DataError, TuningError
from backsight.estimators import EKF, MHE, KalmanFilter, Noise, Prior
from backsight.models import lti
from backsight.run.estimation import estimate_many
from backsight.run.summaries import estimate_summaries
from backsight.schema import Status
from backsight.testing import TrialProblem

PROBLEM = TrialProblem()
ONE_OUTPUT = TrialProblem(outputs=("position",))


def recordings(problem, count=5):
    """Different lengths and gaps, a spike in one."""
    found = []
    for k in range(count):
        data = problem.simulate(60 + 13 * k, seed=k, hold="zoh", noisy=True)
        data.y[k : 5 * k : 2] = np.nan
        data.y[20 + k, 0] = np.nan
        found.append(data.recording(problem.model))
    found[1]["y"][40, 0] += 3.0
    return found


def discrete(outputs):
    """One state that stays as it is, seen by so many outputs."""
    names = {f"y{k}": "" for k in range(outputs)}
    C = np.ones((outputs, 1))
    return lti([[1.0]], np.empty((1, 0)), C, states={"x": ""}, inputs={}, outputs=names, dt=1.0)


def doubting(problem):
    return dataclasses.replace(problem.noise, outliers=settings.Gate())


@pytest.mark.parametrize(
    ("problem", "estimator"),
    [
        (PROBLEM, EKF(PROBLEM.noise, PROBLEM.prior)),
        (PROBLEM, EKF(doubting(PROBLEM), PROBLEM.prior)),
        (ONE_OUTPUT, MHE(ONE_OUTPUT.noise, ONE_OUTPUT.prior, N=2, lag="N")),
    ],
    ids=["ekf", "gate", "lag"],
)
def test_each_row_is_the_summary_of_the_result(problem, estimator):
    data = recordings(problem)
    table = estimate_summaries(estimator, problem.model, data)
    for k, result in enumerate(estimate_many(estimator, problem.model, data)):
        row, expected = table.isel(recording=k), summary(result)
        last = result.isel(time=-1)
        np.testing.assert_allclose(row["x_hat"], last["x_hat"], rtol=1e-9)
        np.testing.assert_allclose(row["x_std"], last["x_std"], rtol=1e-9)
        np.testing.assert_allclose(row["x_mean"], result["x_hat"].mean("time"), rtol=1e-9)
        for name in ("mean_nis", "nis_expected", "mean_log_likelihood"):
            assert float(row[name]) == pytest.approx(expected[name], rel=1e-9), name
        for output, rms in expected["rms_innovation"].items():
            assert float(row["rms_innovation"].sel(output=output)) == pytest.approx(rms, rel=1e-9)
        counts = {f.upper(): int(c) for f, c in row["status_count"].to_series().items() if c}
        assert counts == {n: c for n, c in expected["status"].items() if n != "OK"}
        assert int(row["status"]) == np.bitwise_or.reduce(result["status"].values)
        assert int(row["failed_at"]) == -1
        assert int(row["samples"]) == result.sizes["time"]


def test_one_that_diverges_is_a_row_that_says_where():
    data = recordings(PROBLEM, 3)
    data[1]["u"][10] = 1e308
    estimator = EKF(PROBLEM.noise, PROBLEM.prior)
    table = estimate_summaries(estimator, PROBLEM.model, data)
    results = estimate_many(estimator, PROBLEM.model, data, throw=False)
    where = np.flatnonzero(results[1]["status"].values & Status.NOT_FINITE)
    assert table["failed_at"].values.tolist() == [-1, where[0], -1]
    assert int(table["status"][1]) & Status.NOT_FINITE
    assert not int(table["status"][0]) & Status.NOT_FINITE
    again = estimate_summaries(estimator, PROBLEM.model, data, restart=True)
    assert np.isfinite(again["x_hat"]).all()
    assert int(again["failed_at"][1]) >= 0


def test_an_estimate_that_is_absurd_is_found_like_in_results():
    """Finite everywhere, but a million times off what was ever measured."""
    model = discrete(outputs=1)
    y = np.array([1.0, 1.0, np.nan, 1.0])
    outputs = {model.outputs[0].name: ""}
    recording = from_arrays(y=y, dt=1.0, inputs={}, outputs=outputs)
    estimator = KalmanFilter(Noise(sigma_y=1.0), Prior(x0=[1e9], sigma_x0=1e-3))
    (result,) = estimate_many(estimator, model, [recording], throw=False)
    table = estimate_summaries(estimator, model, [recording])
    assert int(table["failed_at"][0]) == 0
    assert int(table["status_count"].sel(flag="not_finite")[0]) == np.sum(
        result["status"].values & Status.NOT_FINITE > 0
    )


def test_wrong_recordings_and_too_many_outputs_are_told():
    estimator = EKF(PROBLEM.noise, PROBLEM.prior)
    with pytest.raises(DataError, match="there is no recording"):
        estimate_summaries(estimator, PROBLEM.model, [])
    two = recordings(PROBLEM, 2)
    two[1]["u"][3] = np.nan
    with pytest.raises(DataError, match="recording 1: input 'F' is nan at sample 3"):
        estimate_summaries(estimator, PROBLEM.model, two)
    wide = discrete(outputs=13)
    with pytest.raises(TuningError, match="up to 12 outputs, this one has 13"):
        estimate_summaries(estimator, wide, two)


def test_angles_that_start_anew_are_those_of_the_result():
    """The plain row is the oracle: only the turns differ, which the estimate gives back."""
    turn, data = 0.09, recordings(PROBLEM, 2)
    first = dataclasses.replace(PROBLEM.model.outputs[0], wrap=turn)
    model = dataclasses.replace(PROBLEM.model, outputs=(first, *PROBLEM.model.outputs[1:]))
    told = []
    for recording in data:
        y = recording["y"].copy()
        y[:, 0] = (y[:, 0] + turn / 2) % turn - turn / 2
        told.append(recording.assign(y=y))
    told[1]["y"][40, 0] = data[1]["y"][40, 0] = np.nan  # a spike of many turns
    estimator = EKF(PROBLEM.noise, PROBLEM.prior)
    plain = estimate_summaries(estimator, PROBLEM.model, data)
    table = estimate_summaries(estimator, model, told)
    for name in ("x_hat", "mean_nis", "mean_log_likelihood", "rms_innovation", "measured"):
        np.testing.assert_allclose(table[name], plain[name], rtol=1e-6, atol=1e-9)
    assert (table["failed_at"] == -1).all()
