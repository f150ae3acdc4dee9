"""The study of the lecture: its checks are met, its files are written, wrong calls are refused."""

import json

import numpy as np
import pytest

from backsight.errors import DataError
from backsight_studies import STUDIES
from backsight_studies.lecture import expected
from backsight_studies.lecture.experiment import input_step, multirate
from backsight_studies.lecture.plants import DT, FORCE, every, masses_motion, two_masses
from oracles import lecture


def test_expected_numbers_are_those_of_the_oracle():
    for name in ("M", "N_u", "L_N", "Ltilde_N", "P_N"):
        np.testing.assert_array_equal(getattr(expected, name), getattr(lecture, name))
    for pair, gain in lecture.MULTIRATE.items():
        np.testing.assert_array_equal(expected.MULTIRATE[pair], gain)


def test_run_writes_everything(tmp_path):
    findings = STUDIES["lecture"].run(tmp_path / "out", seeds=[0])
    assert findings.page.is_file()
    assert "37 of 37 checks are met" in str(findings)
    rows = json.loads((tmp_path / "out" / "checks.json").read_text(encoding="utf-8"))
    assert len(rows) == len(findings.checks) == 37
    assert all(row["passed"] for row in rows)
    for name in ("batch", "recursive", "alpha", "rounding", "increments", "limits"):
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 10_000


def test_incremental_transient_is_that_of_the_oracle():
    """Errors of the incremental estimate while the step of 2 is in the window; bias without."""
    with_increments, plain = input_step(0)
    expected_errors = [
        1.9151865343189018,
        1.2554609966232049,
        0.610060666108897,
        0.1600512954963238,
    ]
    np.testing.assert_allclose(with_increments[41:45], expected_errors, rtol=1e-9)
    assert plain[-1] == pytest.approx(4.787293522510563, rel=1e-9)


def test_recursion_and_batch_see_the_same_data():
    r = multirate("two masses", 2, 6, seed=3)
    slow = np.arange(6, 16, 2)
    np.testing.assert_allclose(
        r.estimates["recursive"][slow], r.estimates["batch"][slow], atol=1e-9
    )
    assert np.abs(r.estimates["batch"] - r.truth)[6:].max() > 1e-4


def test_motion_obeys_the_model():
    motion = masses_motion(60, rng=np.random.default_rng(1), force=FORCE)
    model = two_masses(unknown_force=True)
    steady = np.flatnonzero(np.diff(motion.x[:, 4]) == 0)
    for k in steady:
        ahead = np.array(model.f(motion.x[k], motion.u[k], [])).ravel()
        np.testing.assert_allclose(motion.x[k + 1], ahead, atol=1e-12)
    assert model.dt == DT
    assert set(np.abs(motion.x[:, 4])) == {FORCE}
    assert np.isfinite(every(4, motion.y)).sum() == 15


def test_wrong_calls(tmp_path):
    with pytest.raises(DataError, match="takes no recordings"):
        STUDIES["lecture"].run(tmp_path, recordings=["a.csv"])
    with pytest.raises(DataError, match="not negative"):
        STUDIES["lecture"].run(tmp_path, seeds=[])
