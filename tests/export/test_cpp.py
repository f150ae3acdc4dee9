"""The class for C++ does what the functions in C do."""

import shutil
import subprocess

import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.export import export_c
from backsight.testing import CASES

STRICT = [
    "-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Wdouble-promotion", "-Werror",
]  # fmt: skip

PROGRAM = """
#include "KEY.hpp"
using estimator = backsight::KEY_estimator;
int main()
{
    estimator one;
    KEY_memory memory;
    static KEY_workspace work;
    KEY_init(&memory);
    SETTINGS
    estimator::sample given;
    estimator::result found, same;
    int differences = 0;
    for (int k = 0; k < 12; ++k) {
        given.y.fill(0.01 * (k % 5) - 0.02);
        given.mask.fill(k == 4 ? 0.0 : 1.0);
        estimator copy = one;
        found = one.step(given);
        KEY_step(&memory, &work, ARGUMENTS);
        differences += found.x_hat != same.x_hat || found.P != same.P;
        differences += copy.step(given).x_hat != found.x_hat;
    }
    one.reset();
    differences += one.step(given).P == found.P;
    return differences;
}
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler called g++")
@pytest.mark.parametrize("key", ["ekf", "csmhe"])
@pytest.mark.parametrize("standard", ["c++11", "c++20"])
def test_the_class_is_the_function(key, standard, tmp_path):
    problem = CASES[key].problem
    recording = problem.simulate(30, seed=5, hold="zoh", noisy=True).recording(problem.model)
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    export_c(estimator, problem.model, recording, tmp_path, name=key)
    channels = [c.name for c in estimator.compile(problem.model, 0.02).channels]
    weighs = estimator.weighs
    arguments = ["&settings"] * weighs + [f"given.{n}.data()" for n in ("u", "y", "mask")]
    arguments += [f"same.{n}.data()" for n in channels]
    settings = f"{key}_settings settings; {key}_defaults(&settings);" if weighs else ""
    text = PROGRAM.replace("KEY", key).replace("ARGUMENTS", ", ".join(arguments))
    (tmp_path / "main.cpp").write_text(text.replace("SETTINGS", settings))
    commands = [
        ["gcc", "-std=c99", "-O0", "-c", f"{key}.c"],
        ["g++", f"-std={standard}", *STRICT, "main.cpp", f"{key}.o", "-o", "main", "-lm"],
        ["./main"],
    ]
    for command in commands:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
