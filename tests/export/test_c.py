"""Exported C: compiles without a warning and gives what Python gives."""

import dataclasses
import re
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.c99 import Precision
from backsight.engine.loops import scan
from backsight.errors import DataError, EngineError
from backsight.estimators import EKF, MHO
from backsight.estimators.outliers import StudentT
from backsight.export import export_c
from backsight.models.views.virtual import with_virtual
from backsight.solvers.box import GaussNewton
from backsight.testing import CASES, TrialProblem

STRICT = [
    "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Wdouble-promotion",
    "-Wvla", "-Werror", "-O1",
]  # fmt: skip
COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="needs a C compiler called cc")


def recorded(problem, hold="zoh"):
    """A noisy recording with gaps."""
    data = problem.simulate(60, seed=5, hold=hold, noisy=True)
    data.y[20:30] = np.nan
    data.y[::7, 0] = np.nan
    return data.recording(problem.model)


def run_selftest(folder, name):
    """Compile the export and run its self-test."""
    files = [str(folder / f) for f in (f"{name}.c", f"{name}_selftest.c")]
    program = folder / "selftest"
    built = subprocess.run(
        [str(COMPILER), *STRICT, "-o", str(program), *files, "-lm"], capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    return subprocess.run([str(program)], capture_output=True, text=True)


@needs_compiler
@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("key", list(CASES))
def test_every_estimator_equals_python(key, hold, tmp_path):
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, Integrator("rk4", 2, hold))
    export_c(estimator, problem.model, recorded(problem, hold), tmp_path / "c", name=key)
    ran = run_selftest(tmp_path / "c", key)
    assert ran.returncode == 0, ran.stdout
    assert f"{key}: 60 samples passed" in ran.stdout


@needs_compiler
def test_virtual_outputs_are_those_of_python(tmp_path):
    problem = TrialProblem()
    model = with_virtual(problem.model, {"spring": ("k*q", "N"), "acc": "v_dot"})
    export_c(EKF(problem.noise, problem.prior), model, recorded(problem), tmp_path, name="virtual")
    ran = run_selftest(tmp_path, "virtual")
    assert ran.returncode == 0, ran.stdout
    assert "z_std" in ran.stdout
    assert "| z_hat, z_std | spring [N], acc |" in (tmp_path / "README.md").read_text()


@needs_compiler
def test_angles_turn_as_in_python(tmp_path):
    problem = TrialProblem()
    first = dataclasses.replace(problem.model.outputs[0], wrap=0.09)
    model = dataclasses.replace(problem.model, outputs=(first, problem.model.outputs[1]))
    recording = recorded(problem)
    recording["y"][:, 0] = recording["y"][:, 0] % 0.09
    export_c(EKF(problem.noise, problem.prior), model, recording, tmp_path, name="turning")
    ran = run_selftest(tmp_path, "turning")
    assert ran.returncode == 0, ran.stdout


@dataclasses.dataclass(frozen=True)
class Clashing(EKF):
    """Its estimate goes through a loop whose body has the name of a function in it."""

    def build(self, model, dt):
        plain = super().build(model, dt)
        sizes = len(plain.carry0), *plain.input_sizes
        symbols = [ca.MX.sym(n, k) for n, k in zip("cuym", sizes, strict=True)]
        x, a = ca.SX.sym("x", model.nx), ca.MX.sym("a", model.nx)
        inside = ca.Function("step", [x], [x + 1])
        carry, x_hat, *others = plain.step.call(symbols)
        (x_hat,), _ = scan(ca.Function("step", [a], [2 * inside(a)]), 3, carry=[x_hat])
        return dataclasses.replace(plain, step=ca.Function("ekf", symbols, [carry, x_hat, *others]))


@needs_compiler
def test_outliers_are_weighed_as_in_python(tmp_path):
    problem = TrialProblem()
    noise = dataclasses.replace(problem.noise, outliers=StudentT())
    recording = recorded(problem)
    recording["y"][5, 1] += 30.0
    recording["y"][15] -= 1.0
    export_c(EKF(noise, problem.prior), problem.model, recording, tmp_path, name="heavy")
    ran = run_selftest(tmp_path, "heavy")
    assert ran.returncode == 0, ran.stdout
    assert "weight" in (tmp_path / "heavy.h").read_text()


@needs_compiler
def test_body_may_have_the_name_of_a_function_in_it(tmp_path):
    problem = TrialProblem()
    clashing = Clashing(problem.noise, problem.prior)
    export_c(clashing, problem.model, recorded(problem), tmp_path, name="clash")
    ran = run_selftest(tmp_path, "clash")
    assert ran.returncode == 0, ran.stdout


@needs_compiler
def test_single_precision(tmp_path):
    problem = TrialProblem()
    estimator = MHO(
        problem.noise, problem.prior, N=5, alpha=0.1, optimiser=GaussNewton(tolerance=1e-3)
    )
    recording = recorded(problem)
    export_c(estimator, problem.model, recording, tmp_path, name="mho", precision="float")
    ran = run_selftest(tmp_path, "mho")
    assert ran.returncode == 0, ran.stdout
    code = (tmp_path / "mho.c").read_text()
    assert "double" not in code
    assert "sqrtf(" in code


@needs_compiler
def test_single_precision_is_refused_where_it_is_too_coarse(tmp_path):
    problem = TrialProblem()
    noise = dataclasses.replace(
        problem.noise, R=1e-10 * problem.noise.measurement(problem.model), sigma_w={"k": 1e-4}
    )
    ekf, recording = EKF(noise, problem.prior), recorded(problem)
    arguments = ekf, problem.model, recording, tmp_path / "ekf"
    with pytest.raises(EngineError, match=r"condition number .* times its standard deviation"):
        export_c(*arguments, name="ekf", precision="float")
    assert not (tmp_path / "ekf").exists()
    export_c(*arguments, name="ekf", precision="float", accuracy=np.inf)
    ran = run_selftest(tmp_path / "ekf", "ekf")
    assert ran.returncode == 1
    assert "x_hat" in ran.stdout
    with pytest.raises(EngineError, match=r"accuracy is -1\.0"):
        export_c(*arguments, precision="float", accuracy=-1.0)


@needs_compiler
def test_the_selftest_can_fail(tmp_path):
    problem = TrialProblem()
    export_c(EKF(problem.noise, problem.prior), problem.model, recorded(problem), tmp_path)
    code = (tmp_path / "estimator.c").read_text()
    start = code.index("start[")
    broken = code[:start] + code[start:].replace("= {", "= {0.001 + ", 1)
    (tmp_path / "estimator.c").write_text(broken)
    ran = run_selftest(tmp_path, "estimator")
    assert ran.returncode == 1
    assert "FAILED" in ran.stdout


def test_nothing_but_arithmetic(tmp_path):
    problem = TrialProblem()
    estimator = MHO(problem.noise, problem.prior, N=5)
    export_c(estimator, problem.model, recorded(problem), tmp_path, name="mho")
    code = (tmp_path / "mho.c").read_text()
    for word in ("malloc", "free(", "memcpy", "memmove", "printf"):
        assert word not in code
    assert code.count("#include") == 2
    assert "pass < 20" in code
    assert "20" in (tmp_path / "README.md").read_text()


def test_the_page_shows_a_whole_call_with_sizes_of_the_header(tmp_path):
    problem = TrialProblem()
    estimator = EKF(problem.noise, problem.prior)
    export_c(estimator, problem.model, recorded(problem), tmp_path, name="ekf")
    page, header = (tmp_path / "README.md").read_text(), (tmp_path / "ekf.h").read_text()
    assert "..." not in page
    sizes = dict(re.findall(r"#define (EKF_\w+_SIZE) (\d+)", header))
    assert set(re.findall(r"EKF_\w+_SIZE", page)) <= set(sizes)
    assert int(sizes["EKF_X_HAT_SIZE"]) == problem.model.nx
    assert int(sizes["EKF_U_SIZE"]) == problem.model.nu


def test_names_and_precisions(tmp_path):
    problem = TrialProblem()
    recording, estimator = recorded(problem), EKF(problem.noise, problem.prior)
    with pytest.raises(EngineError, match="'my ekf' is no name in C"):
        export_c(estimator, problem.model, recording, tmp_path / "a", name="my ekf")
    with pytest.raises(EngineError, match="unknown precision 'half'"):
        export_c(estimator, problem.model, recording, tmp_path / "a", precision="half")
    assert not (tmp_path / "a").exists()


def test_a_recording_that_diverges_is_no_test(tmp_path):
    problem = TrialProblem()
    recording = recorded(problem)
    recording["u"][10] = 1e308
    with pytest.raises(DataError, match="is not finite within the first 60 samples"):
        export_c(EKF(problem.noise, problem.prior), problem.model, recording, tmp_path / "a")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("value", "double", "single"),
    [
        (0.1, "0.1", "0.100000001f"),
        (3.0, "3.0", "3.0f"),
        (-2.5e-20, "(-2.5e-20)", "(-2.49999999e-20f)"),
        (float("inf"), "INFINITY", "INFINITY"),
        (float("nan"), "NAN", "NAN"),
        (1e300, "1e+300", "INFINITY"),
    ],
)
def test_constants(value, double, single):
    assert Precision("double").number(value) == double
    written = Precision("float").number(value)
    if written[0] not in "IN":
        assert np.float32(written.strip("()f")) == np.float32(single.strip("()f"))
    else:
        assert written == single
