"""Exported code on inputs that nobody should give it, and what a step of it costs at most."""

import shutil
import subprocess

import pytest
from tests.export.hardened import COUNTED, COUNTING, FUZZ, filled

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.program import walk
from backsight.engine.program.effort import effort
from backsight.export import export_c
from backsight.export._written import code_of
from backsight.testing import CASES

needs_compilers = pytest.mark.skipif(
    not (shutil.which("gcc") and shutil.which("g++")), reason="needs gcc and g++"
)
QUICK = {"ekf", "csmhe", "mho"}
WITH_KERNELS = {"csmhe", "lmhe"}


def cases(keys):
    """Keys of estimators as parameters; what takes long is slow."""
    return [k if k in QUICK else pytest.param(k, marks=pytest.mark.slow) for k in keys]


def exported(key, folder, precision="double"):
    """Export an estimator; itself, its recording and its recursion."""
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    recording = problem.simulate(30, seed=5, hold="zoh", noisy=True).recording(problem.model)
    export_c(estimator, problem.model, recording, folder, name=key, precision=precision)
    return estimator, recording, estimator.compile(problem.model, 0.02)


def run(command, folder):
    """Run a program and return what it printed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@needs_compilers
@pytest.mark.parametrize("precision", ["double", pytest.param("float", marks=pytest.mark.slow)])
@pytest.mark.parametrize("key", cases(CASES))
def test_no_input_leads_out_of_bounds(key, precision, tmp_path):
    estimator, _, recursion = exported(key, tmp_path, precision)
    weighs = estimator.weighs and not estimator.constant_gain
    (tmp_path / "main.c").write_text(filled(FUZZ, key, recursion, settings=weighs))
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g0"]
    run(["gcc", "-std=c99", "-O1", *checks, f"{key}.c", "main.c", "-o", "main", "-lm"], tmp_path)
    run(["./main"], tmp_path)


@needs_compilers
@pytest.mark.parametrize("key", cases(k for k in CASES if k not in WITH_KERNELS))
def test_a_step_costs_at_most_what_is_told(key, tmp_path):
    """Operations counted by a number that counts them, in C++; kernels are C alone."""
    estimator, recording, recursion = exported(key, tmp_path)
    weighs = estimator.weighs and not estimator.constant_gain
    (tmp_path / "counting.h").write_text(COUNTING)
    header = (tmp_path / f"{key}.h").read_text()
    double = f"typedef double {key}_real;"
    assert double in header
    counting = f'#include "counting.h"\ntypedef Counting {key}_real;'
    (tmp_path / f"{key}.h").write_text(header.replace(double, counting))
    code = (tmp_path / f"{key}.c").read_text()
    (tmp_path / f"{key}.c").write_text(code.replace("static const", "const"))
    (tmp_path / "main.cpp").write_text(filled(COUNTED, key, recursion, settings=weighs))
    run(["g++", "-std=c++17", "-O0", "-w", "main.cpp", "-o", "main"], tmp_path)
    counted = [int(n) for n in run(["./main"], tmp_path).split()]
    code = code_of(
        estimator, CASES[key].problem.model, recording, name=key, names=None, restart=False
    )
    most = effort(walk(code.recursion.step))
    told = [most.plain, most.divisions, most.roots, most.functions]
    assert all(n <= limit for n, limit in zip(counted, told, strict=True)), (counted, told)
    if not code.passes:
        # Without searches every sample costs the same, but for comparisons that need not be made.
        assert counted[1:] == told[1:]
        assert counted[0] >= 0.9 * told[0]
    readme = (tmp_path / "README.md").read_text()
    assert f"| divisions, square roots | at most {told[1]}, {told[2]} |" in readme
