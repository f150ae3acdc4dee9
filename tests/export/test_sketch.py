"""A sketch compiles as C++ against what an Arduino offers, and its loop is the estimator."""

import shutil
import subprocess

import numpy as np
import pytest
from typer.testing import CliRunner

import small_problem
from backsight.cli import app
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.errors import EngineError
from backsight.export import export_c
from backsight.testing import CASES

ARDUINO = """
#include <cmath>
#include <cstdint>
#include <cstdio>
static uint32_t now = 4294960000U; // the counter begins anew soon
static unsigned long micros() { return now; }
struct {
    void begin(long) {}
    void print(const char *text) { std::printf("%s", text); }
    void print(char text) { std::printf("%c", text); }
    void print(double value, int digits) { std::printf("%.*f", digits, value); }
    void println(double value, int digits) { std::printf("%.*f\\n", digits, value); }
} Serial;
#include "SKETCH"
int main()
{
    setup();
    for (int k = 0; k < 10; ++k) {
        loop();
        now += PERIOD;
    }
}
"""


def recorded(problem):
    return problem.simulate(20, seed=5, hold="zoh", noisy=True).recording(problem.model)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler called g++")
@pytest.mark.parametrize("key", ["ekf", "csmhe"])
def test_a_sketch_predicts_until_it_is_told_what_is_measured(key, tmp_path):
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    folder = export_c(
        estimator,
        problem.model,
        recorded(problem),
        tmp_path / "observer",
        name=key,
        template="arduino",
    )
    # What is in the folder, and no more, is compiled: so is every kernel that is included.
    (tmp_path / "main.cpp").write_text(ARDUINO.replace("SKETCH", "observer.ino"))
    flags = ["-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror", "-O1", f"-I{folder}"]
    objects = []
    for source in sorted(folder.glob("*.c")):
        objects.append(tmp_path / f"{source.stem}.o")
        subprocess.run(["gcc", *flags, "-c", source, "-o", objects[-1]], check=True)
    main = ["g++", "-std=gnu++11", *flags, tmp_path / "main.cpp", *objects, "-o", tmp_path / "it"]
    subprocess.run(main, check=True)
    told = subprocess.run([tmp_path / "it"], capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in told.splitlines()]
    recursion = estimator.compile(problem.model, 0.02)
    nothing = [np.zeros((10, size)) for size in recursion.input_sizes]
    _, outputs = vm.run(recursion, nothing, carry=recursion.carry0)
    wanted = dict(zip([c.name for c in recursion.channels], outputs, strict=True))["x_hat"]
    assert [row[:-1:2] for row in rows] == [[s.name for s in problem.model.states]] * 10
    found = np.array([row[1:-1:2] for row in rows], float)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=6e-7)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("arm-none-eabi-g++") is None, reason="needs arm-none-eabi-g++")
def test_a_sketch_fits_a_microcontroller(tmp_path):
    problem = CASES["ekf"].problem
    estimator = CASES["ekf"].build(problem, Integrator("rk4", 1))
    given = estimator, problem.model, recorded(problem)
    folder = export_c(*given, tmp_path / "it", precision="float", template="arduino")
    small = ["-mcpu=cortex-m4", "-mthumb", "-O2", "-Wall", "-Werror", "-Wdouble-promotion"]
    for source in folder.glob("*.c"):
        subprocess.run(["arm-none-eabi-gcc", *small, "-c", source, "-o", "/dev/null"], check=True)


@pytest.mark.slow
def test_the_command_writes_a_sketch(tmp_path):
    problem = small_problem.write(tmp_path)
    words = ["export", problem, "-e", "EKF", "-o", tmp_path / "spring", "--template"]
    done = CliRunner().invoke(app, list(map(str, [*words, "arduino"])))
    assert done.exit_code == 0, done.output
    names = {p.name for p in (tmp_path / "spring").iterdir() if not p.name.startswith(".")}
    assert names == {"ekf.c", "ekf.h", "ekf.hpp", "spring.ino", "platformio.ini", "README.md"}
    text = (tmp_path / "spring" / "spring.ino").read_text()
    assert "PERIOD = 10000; // us" in text
    assert "u[0] = 0; // u [N]" in text
    assert "mask[0] = 0; // y [m]: mask 1 where measured" in text
    done = CliRunner().invoke(app, list(map(str, [*words, "abacus"])))
    assert done.exit_code == 2
    assert "template" in done.output


def test_a_folder_that_cannot_be_a_sketch_is_refused(tmp_path):
    problem = CASES["ekf"].problem
    estimator = CASES["ekf"].build(problem, Integrator("rk4", 1))
    given = estimator, problem.model, recorded(problem)
    with pytest.raises(EngineError, match="a sketch cannot be called 'my sketch'"):
        export_c(*given, tmp_path / "my sketch", template="arduino")
    assert not list(tmp_path.iterdir())
