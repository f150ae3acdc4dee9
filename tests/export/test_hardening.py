"""Exported code on inputs that nobody should give it, and what a step of it costs at most."""

import dataclasses
import math
import shutil
import subprocess
from pathlib import Path
from typing import Literal

import pytest
from tests.export.hardened import COUNTED, COUNTING, FUZZ, STACK, filled, recorded

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.c99.stack import stack_bytes
from backsight.engine.program.effort import effort
from backsight.export import export_c
from backsight.export._written import code_of
from backsight.kernels import effort as efforts
from backsight.kernels import sources
from backsight.problem import load
from backsight.problem.recorded import recording_of
from backsight.solvers.box import GaussNewton
from backsight.testing import CASES

needs_compilers = pytest.mark.skipif(
    not (shutil.which("gcc") and shutil.which("g++")), reason="needs gcc and g++"
)
EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK = {"ekf", "csmhe", "mho"}
MORE = [k for k in CASES if k != "ekf"]
SEARCHING = {"mhe", "csmhe"}
"""Whose searches may take far more passes than they need, unless their effort is fixed."""

FIXED = GaussNewton(3, tolerance=0.0, active_set_passes=3)


def cases(keys):
    """Keys of estimators as parameters; what takes long is slow."""
    return [k if k in QUICK else pytest.param(k, marks=pytest.mark.slow) for k in keys]


def with_fixed_effort(estimator):
    """The estimator with a number of passes that is always the same."""
    if hasattr(estimator, "optimiser"):
        return dataclasses.replace(estimator, optimiser=FIXED)
    if hasattr(estimator, "max_steps"):
        return dataclasses.replace(estimator, max_steps=6, max_active=40)
    return estimator


def tried(key, *, fixed=False):
    """An estimator of the contract, its model and a recording."""
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    recording = problem.simulate(30, seed=5, hold="zoh", noisy=True).recording(problem.model)
    return with_fixed_effort(estimator) if fixed else estimator, problem.model, recording


def of_example(example, name):
    """An estimator of an example with a fixed effort, its model and the recording."""
    problem = load(EXAMPLES / example / "problem.toml")
    estimator = with_fixed_effort(problem.estimators[name])
    return estimator, problem.model, recording_of(problem)


def run(command, folder):
    """Run a program and return what it printed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def exported(on, folder, precision: Literal["double", "float"] = "double"):
    """Export an estimator; what was written."""
    estimator, model, recording = on
    export_c(estimator, model, recording, folder, name="it", precision=precision, accuracy=math.inf)
    return code_of(
        estimator, model, recording, name="it", precision=precision, names=None, restart=False
    )


@needs_compilers
@pytest.mark.parametrize("precision", ["double", pytest.param("float", marks=pytest.mark.slow)])
@pytest.mark.parametrize("key", cases(CASES))
def test_no_input_leads_out_of_bounds(key, precision, tmp_path):
    code = exported(tried(key), tmp_path, precision)
    (tmp_path / "main.c").write_text(filled(FUZZ, "it", code))
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g0"]
    run(["gcc", "-std=c99", "-O1", *checks, "it.c", "main.c", "-o", "main", "-lm"], tmp_path)
    run(["./main"], tmp_path)


def counted(code, folder):
    """Operations of a step at most, by a number that counts them, in C++."""
    (folder / "counting.h").write_text(COUNTING)
    (folder / "recorded.h").write_text(recorded(code.data))
    changes = {
        "it.h": ("typedef double it_real;", '#include "counting.h"\ntypedef Counting it_real;'),
        "it.c": ("static const", "const"),
        "kernels.h": ("#define real double", "#define real Counting"),
    }
    for name in ("it.h", "it.c", *(["kernels.h"] if code.kernels else [])):
        text = (folder / name).read_text()
        assert changes[name][0] in text
        (folder / name).write_text(text.replace(*changes[name]))
    (folder / "main.cpp").write_text(filled(COUNTED, "it", code))
    flags = ["-std=c++17", "-O0", "-w", "-Drestrict="]
    run(["g++", *flags, "main.cpp", "-o", "main"], folder)
    return [int(n) for n in run(["./main"], folder).split()]


def compare(code, folder, *, close):
    """What is counted is at most what is told, and not far below."""
    most, found = effort(code.program), counted(code, folder)
    told = [most.plain, most.divisions, most.roots, most.functions]
    assert all(n <= limit for n, limit in zip(found, told, strict=True)), (found, told)
    if not code.passes and not code.kernels:
        # Without searches every sample costs the same, but for comparisons that need not be made.
        assert found[1:] == told[1:]
        assert found[0] >= 0.9 * told[0]
    if close:
        assert sum(told) <= 3 * sum(found)
    readme = (folder / "README.md").read_text()
    assert f"| divisions, square roots | at most {told[1]}, {told[2]} |" in readme


@needs_compilers
@pytest.mark.parametrize("key", cases(CASES))
def test_a_step_costs_at_most_what_is_told(key, tmp_path):
    compare(exported(tried(key), tmp_path), tmp_path, close=key not in SEARCHING)


@needs_compilers
@pytest.mark.slow
@pytest.mark.parametrize("key", ["mho", "mhe", "csmhe"])
def test_a_fixed_effort_costs_what_is_told(key, tmp_path):
    compare(exported(tried(key, fixed=True), tmp_path), tmp_path, close=True)


@needs_compilers
@pytest.mark.slow
@pytest.mark.parametrize(
    ("example", "name"),
    [
        ("beam", "CS-MHE"), ("beam", "KF"), ("bridge", "KF"), ("frame", "CS-MHE"), ("motor", "MHE"),
        ("quarter_car", "EKF"), ("rotor", "UKF"), ("stage", "MHO"), ("storeys", "IEKF"),
    ],
)  # fmt: skip
def test_examples_cost_what_is_told(example, name, tmp_path):
    compare(exported(of_example(example, name), tmp_path), tmp_path, close=True)


@needs_compilers
@pytest.mark.parametrize("key", ["ekf", *(pytest.param(k, marks=pytest.mark.slow) for k in MORE)])
def test_memory_and_stack_are_what_is_told(key, tmp_path):
    """A painted stack; glibc's functions included, which are linked before."""
    code = exported(tried(key), tmp_path)
    (tmp_path / "main.c").write_text(filled(STACK, "it", code))
    found = {}
    for level in ("-O0", "-O2"):
        flags = ["-std=c99", level, "-w", "-Wl,-z,now"]
        run(["gcc", *flags, "it.c", "main.c", "-o", "main", "-lm"], tmp_path)
        stack, memory, work = map(int, run(["./main"], tmp_path).split())
        found[level] = stack
    bound = stack_bytes(code.program, code.kind)
    assert found["-O2"] <= found["-O0"] <= bound <= 3 * found["-O0"]
    readme = (tmp_path / "README.md").read_text()
    assert f"| RAM | {memory} bytes memory, {work} bytes workspace |" in readme
    assert f"| stack | at most {bound} bytes" in readme


def test_every_kernel_says_what_it_costs():
    assert sorted(efforts.KERNELS) == sorted(sources.names())
