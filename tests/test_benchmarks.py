"""The benchmarks can be built, and say so when a contender cannot take part."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from benchmarks import (
    accuracy,
    bars,
    contest,
    contests,
    every,
    page,
    problems,
    process_noise,
    scaling,
)
from benchmarks.peers import numpy_ekf, shooting_nlp

from backsight.engine import vm
from backsight.estimators import ESTIMATORS
from backsight.solvers.box import GaussNewton
from backsight.testing import CASES


@pytest.mark.parametrize(
    "build",
    [
        lambda: problems.chain(2, samples=40),
        lambda: problems.dense(3, samples=40),
        lambda: problems.chain(7, samples=40),
    ],
)
def test_filters_compute_what_numpy_computes(build):
    problem = build()
    recursion = problem.recursion
    _, outputs = vm.run(recursion, problem.data, carry=recursion.carry0)
    estimates = numpy_ekf.build(problem).work()
    np.testing.assert_allclose(outputs[0] / problem.setting.sx, estimates, rtol=0, atol=1e-12)


def test_a_contender_that_fails_is_told_and_not_dropped():
    def missing() -> contest.Contender:
        raise ModuleNotFoundError("No module named 'peer'", name="peer")

    fine = contest.Contender(lambda: np.ones((2, 1)), 2, np.ones((1, 1)))
    entries = (contest.Entry("fine", lambda: fine), contest.Entry("peer", missing))
    table = contest.Contest("table", "us", entries)
    rows = contest.race(table, rounds=3, seconds=0.0)
    assert [r.failure for r in rows] == ["", "not installed: peer"]
    assert rows[0].rounds == 3
    assert rows[0].difference == 0
    assert page.rows_of(table, rows)[1][:2] == ("peer", "not installed: peer")


def test_every_estimator_is_timed_and_on_the_page():
    """A new estimator needs a case; `make bench` then writes its row, in page and results."""
    table = every.contest()
    assert [entry.name for entry in table.entries] == [every.row(key) for key in ESTIMATORS]
    assert table.title in [each.title for each in contests.contests()]
    root = Path(page.__file__).parent.parent
    for name in ("docs/benchmarks.md", "benchmarks/results/times.csv"):
        text = (root / name).read_text(encoding="utf-8")
        missing = [key for key in ESTIMATORS if every.row(key) not in text]
        assert not missing, f"{name} has no row of {missing}: run `make bench`"


@pytest.mark.parametrize("key", ["ekf", "csmhe"])
def test_what_is_timed_of_an_estimator_can_be_run(key):
    problem = every.problem(CASES[key])
    _, outputs = vm.run(
        problem.recursion, [rows[:50] for rows in problem.data], carry=problem.recursion.carry0
    )
    assert np.isfinite(outputs[0]).all()
    assert problem.data[1].shape == (every.SAMPLES, problem.model.ny)


def test_what_was_not_measured_is_not_reached():
    judged = bars._least({"twice": (2.0, 1.0), "half": (0.5, 1.0), "nothing": (np.nan, 1.0)})
    assert [(b.value, b.met) for b in judged] == [(2.0, True), (0.5, False), (None, False)]
    assert "1 of 3" in page.verdict(judged)


def test_generated_parts_of_the_page_are_replaced():
    text = "before\n" + "\n".join(page.MARK.format(edge=e, part="x") for e in ("begin", "end"))
    once = page.replaced(text + "\nafter", "x", "old")
    twice = page.replaced(once, "x", "new")
    assert "new" in twice
    assert "old" not in twice
    assert twice.startswith("before\n")
    assert twice.endswith("\nafter")
    with pytest.raises(ValueError, match="no place for 'y'"):
        page.replaced(text, "y", "")


def test_the_page_has_a_place_for_every_generated_part(tmp_path):
    copy = tmp_path / "benchmarks.md"
    shutil.copy(Path(page.__file__).parent.parent / "docs" / "benchmarks.md", copy)
    found = accuracy.Accuracy("estimator", {"speed": 0.5, "gain": 0.0312}, 12.3)
    missing = accuracy.Accuracy("peer", {}, np.nan, "not installed: peer")
    page.write(
        copy,
        machine={},
        measured=bars.Measured([], [], []),
        efficiencies=[],
        accuracies=[found, missing],
        bars=[],
        contests=[],
        studies=[],
    )
    text = copy.read_text(encoding="utf-8")
    assert "| estimator | 50 | 3.1 | 12.3 |" in text
    assert "| peer | not installed: peer |" in text


def test_growth_is_the_slope_in_logarithms():
    points = [scaling.Point("s", "a", n, 3.0 * n**1.25, 0.0) for n in (2, 4, 8, 100)]
    points.append(scaling.Point("s", "b", 5, 1.0, 0.0))
    assert scaling.exponent(points, "s", "a") == pytest.approx(1.25)


@pytest.mark.slow
@pytest.mark.parametrize("bounds", process_noise.BOUNDS)
def test_windows_with_process_noise_are_solved_as_by_ipopt(bounds):
    expected = shooting_nlp.minimisers(bounds)
    assert process_noise.native_engine(bounds, GaussNewton(), expected).difference() < 1e-8
