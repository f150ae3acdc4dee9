"""Nothing runs before everything is known to fit."""

import psutil
import pytest

from backsight.errors import DataError
from backsight.estimators import EKF, MHE
from backsight.run.compare import compare
from backsight.run.estimation import estimate
from backsight.testing import TrialProblem

PROBLEM = TrialProblem()
SAMPLES = 60


def test_results_have_to_fit_into_memory_together(monkeypatch):
    """Each of them fits by itself."""
    ekf = EKF(PROBLEM.noise, PROBLEM.prior)
    recording = PROBLEM.simulate(SAMPLES, seed=0, hold="zoh", noisy=True).recording(PROBLEM.model)
    # A result takes between two and three numbers for each one that the recursion puts out.
    three = 3 * sum(ekf.compile(PROBLEM.model, recording.attrs["dt"]).output_sizes)
    real = psutil.virtual_memory()
    little = real._replace(available=8 * SAMPLES * three)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: little)
    estimate(ekf, PROBLEM.model, recording)
    done = []
    with pytest.raises(DataError, match=f"the 2 results of {SAMPLES} samples would take"):
        compare(
            {"EKF": ekf, "again": ekf},
            PROBLEM.model,
            recording,
            progress=lambda *at: done.append(at),
        )
    assert not done


def test_a_window_that_is_longer_than_the_recording_is_refused_before_it_is_built():
    recording = PROBLEM.simulate(20, seed=0, hold="zoh", noisy=True).recording(PROBLEM.model)
    window = MHE(PROBLEM.noise, PROBLEM.prior, N=10**9)
    with pytest.raises(DataError, match="N = 19 takes in all of it"):
        estimate(window, PROBLEM.model, recording)
