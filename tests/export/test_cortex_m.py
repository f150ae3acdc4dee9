"""Exported code on Cortex-M processors, in an emulator."""

import pytest
from benchmarks.controllers.cortex_m import BOARDS

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.program import effort, walk
from backsight.export import export_c
from backsight.testing import CASES

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not all(board.there for board in BOARDS.values()),
        reason="needs arm-none-eabi-gcc with newlib and qemu-system-arm",
    ),
]


@pytest.mark.parametrize("precision", list(BOARDS))
@pytest.mark.parametrize("key", ["ekf", "mho", "mhe", "csmhe"])
def test_selftest_passes_and_every_step_costs_the_same(key, precision, tmp_path):
    problem, board = CASES[key].problem, BOARDS[precision]
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    data = problem.simulate(30, seed=5, hold="zoh", noisy=True)
    recording = data.recording(problem.model)
    arguments = estimator, problem.model, recording, tmp_path
    export_c(*arguments, name="it", precision=precision, accuracy=float("inf"))
    ran = board.selftest(tmp_path, "it")
    assert ran.returncode == 0, ran.stdout
    assert "it: 30 samples passed" in ran.stdout
    recursion = estimator.compile(problem.model, float(recording.attrs["dt"]))
    counted = board.count(tmp_path, "it", recursion, [data.u, data.y, 1.0 + 0 * data.y])
    assert 100 < counted.mean <= counted.most
    assert counted.code > 1000
    if key in ("ekf", "mhe"):  # nothing is searched: 40 instructions are a tick of the clock
        assert counted.most <= 1.05 * counted.mean + 80
    if key == "ekf" and precision == "float":  # 2.5 where all that is short is written to memory
        assert counted.mean <= 2.3 * effort(walk(recursion.step)).arithmetic
