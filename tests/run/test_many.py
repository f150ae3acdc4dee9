"""Many recordings at once equal one after the other."""

import numpy as np
import pytest

from backsight.errors import DataError, EstimationError
from backsight.estimators import EKF, MHO
from backsight.run.estimation import estimate, estimate_many
from backsight.testing import TrialProblem

PROBLEM = TrialProblem()


def recordings(count):
    """Different lengths, forces and gaps."""
    found = []
    for k in range(count):
        data = PROBLEM.simulate(80 + 13 * k, seed=k, hold="zoh", noisy=True)
        data.y[k : 5 * k : 2] = np.nan
        found.append(data.recording(PROBLEM.model))
    return found


@pytest.mark.parametrize(
    "estimator",
    [
        EKF(PROBLEM.noise, PROBLEM.prior),
        MHO(PROBLEM.noise, PROBLEM.prior, N=4, alpha=0.1),
    ],
    ids=["ekf", "mho"],
)
def test_each_result_is_that_of_a_run_of_its_own(estimator):
    all_of_them = recordings(11)
    together = estimate_many(estimator, PROBLEM.model, all_of_them)
    for recording, result in zip(all_of_them, together, strict=True):
        alone = estimate(estimator, PROBLEM.model, recording, engine="native")
        assert set(result.variables) == set(alone.variables)
        for name in ("x_hat", "P", "e", "S"):
            size = np.abs(alone[name]).max("time")
            deviation = np.abs(result[name] - alone[name]).max("time")
            assert np.all(deviation <= 1e-12 * size), name
        np.testing.assert_array_equal(result["status"], alone["status"])


def test_one_that_diverges_leaves_the_others_alone():
    three = recordings(3)
    three[1]["u"][10] = 1e308
    estimator = EKF(PROBLEM.noise, PROBLEM.prior)
    with pytest.raises(EstimationError, match="recording 1: ekf failed at sample") as told:
        estimate_many(estimator, PROBLEM.model, three)
    kept = estimate_many(estimator, PROBLEM.model, three, throw=False)
    for k in (0, 2):
        assert np.all(np.isfinite(kept[k]["x_hat"]))
        assert kept[k].identical(told.value.results[k].assign_attrs(kept[k].attrs))


def test_each_restarts_as_a_run_of_its_own():
    """After a value that no estimate survives: what follows, and the others, are as alone."""
    three = recordings(3)
    three[1]["u"][10] = 1e308
    estimator = EKF(PROBLEM.noise, PROBLEM.prior)
    together = estimate_many(estimator, PROBLEM.model, three, restart=True)
    for recording, result in zip(three, together, strict=True):
        alone = estimate(estimator, PROBLEM.model, recording, engine="native", restart=True)
        np.testing.assert_array_equal(result["status"], alone["status"])
        np.testing.assert_allclose(result["x_hat"], alone["x_hat"], rtol=1e-9, atol=1e-12)
    assert together[1]["status"].any()
    assert np.isfinite(together[1]["x_hat"][-1]).all()


def test_wrong_recordings_are_named():
    two = recordings(2)
    estimator = EKF(PROBLEM.noise, PROBLEM.prior)
    with pytest.raises(DataError, match="there is no recording"):
        estimate_many(estimator, PROBLEM.model, [])
    with pytest.raises(DataError, match=r"recording 1 has the sampling period 0\.03 s"):
        estimate_many(estimator, PROBLEM.model, [two[0], two[1].assign_attrs(dt=0.03)])
    two[1]["u"][3] = np.nan
    with pytest.raises(DataError, match="recording 1: input 'F' is nan at sample 3"):
        estimate_many(estimator, PROBLEM.model, two)
