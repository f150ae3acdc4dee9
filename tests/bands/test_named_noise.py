"""Noise that is wrong by a factor of four is named, and a right description is not blamed."""

import re

import pytest

import backsight as bs
from backsight.analysis.comparison._summary import assess
from backsight.analysis.comparison.verdict import sentence
from backsight.run.diagnosis._factors_of_results import with_factors
from backsight.run.diagnosis._judges import Judges
from backsight.run.diagnosis.audit import noise_found
from bands.plants import drawn
from bands.rows import PLANTS, ROWS

SAMPLES, RUNS, RIGHT = 1200, 10, 40
JUDGED = [name for name, row in ROWS.items() if row.forces == "none"]
"""With unknown forces in them, innovations say nothing of the noise."""


def sentences(name: str, runs: int, **wrong: float) -> list[str]:
    """Verdicts on an estimator that is told the nominal noise."""
    plant = PLANTS["oscillator"]()
    estimator = ROWS[name].build(plant)
    truth = drawn(plant, runs, SAMPLES, seed=3, **wrong)
    names = {"inputs": {"F": ""}, "outputs": {"y": ""}}
    data = [bs.from_arrays(u=truth.u, y=y, dt=plant.dt, **names) for y in truth.y.T]
    every = bs.estimate_many(estimator, plant.model, data, threads=1)
    said = []
    for result, recording in zip(every, data, strict=True):
        results, estimators = {"": result}, {"": estimator}
        judges = Judges(plant.model, recording, results, estimators)
        found = noise_found(results, estimators, judges)
        said.append(sentence(assess(with_factors(result, found[""]))))
    return said


@pytest.mark.slow
@pytest.mark.parametrize("name", JUDGED)
def test_a_right_description_is_blamed_in_one_run_of_a_hundred_at_most(name):
    """Of 40 runs; more than two would be blamed in one test of 150."""
    said = sentences(name, RIGHT)
    assert sum(not s.startswith("consistent") for s in said) <= 2


@pytest.mark.slow
@pytest.mark.parametrize("name", JUDGED)
@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"R": 4.0}, r"R is about \d\.?\d? times too small"),
        ({"R": 0.25}, r"R is about \d\.?\d? times too large"),
        ({"Q": 4.0}, r"Q is about \d\.?\d? times too small"),
        ({"Q": 0.25}, r"Q is about \d\.?\d? times too large"),
    ],
)
def test_noise_wrong_by_four_is_named_in_nine_of_ten_runs(name, wrong, says):
    said = sentences(name, RUNS, **wrong)
    assert sum(bool(re.search(says, s)) for s in said) >= 0.9 * RUNS
