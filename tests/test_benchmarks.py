"""The benchmarks can be built, and say so when a contender cannot take part."""

import numpy as np
import pytest
from benchmarks import bars, contest, page, problems
from benchmarks.peers import numpy_ekf

from backsight.engine import vm


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
