"""An interrupt keeps what has finished, and something moves before."""

import json

import small_problem
from backsight.run import compare


def test_an_interrupt_keeps_estimators_that_have_finished(backsight, tmp_path, monkeypatch):
    path = small_problem.write(tmp_path)
    carry_out, done = compare.carry_out, []

    def interrupted(task, **how):
        if done:
            raise KeyboardInterrupt
        done.append(task)
        return carry_out(task, **how)

    monkeypatch.setattr(compare, "carry_out", interrupted)
    code, printed, told = backsight("run", path, "-o", tmp_path / "out")
    assert code == 130
    assert told.startswith("backsight: warning: interrupted: MHO left out")
    written = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert list(written["estimators"]) == ["EKF"]
    assert "EKF: consistent" in printed


def test_it_is_said_what_is_prepared(tmp_path):
    from backsight.problem import load, run_problem

    steps = []
    run_problem(
        load(small_problem.write(tmp_path)), tmp_path / "out", progress=lambda *s: steps.append(s)
    )
    assert steps[:2] == [("preparing EKF, 4 states", 0, 1), ("preparing EKF, 4 states", 1, 1)]
    assert ("EKF", 0, small_problem.SAMPLES) in steps
