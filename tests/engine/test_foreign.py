"""Kernels in C: the same results in every engine, whose own results NumPy confirms."""

import contextlib
import dataclasses
import importlib.machinery
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest

from backsight.engine import foreign, lanes, native, vm
from backsight.engine.llvm import machine
from backsight.engine.loops import iterate, scan
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import EngineError
from backsight.estimators.base import AbstractEstimator
from backsight.export import export_c
from backsight.kernels import library, sources
from backsight.testing import TrialProblem
from closeness import assert_close
from engine.examples import data_for, recursion

COMPILER = shutil.which("cc")
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"]
PACKAGE = sources.FOLDER
N = 5

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="needs a C compiler called cc")
pytestmark = needs_compiler


def compiled(*arguments):
    """Run the compiler."""
    built = subprocess.run([str(COMPILER), *STRICT, *arguments], capture_output=True, text=True)
    assert built.returncode == 0, built.stderr


@contextlib.contextmanager
def kernels_in(folder):
    """Take the kernels from a folder for a while."""
    known = ca.GlobalOptions.getCasadiPath()
    ca.GlobalOptions.setCasadiPath(os.pathsep.join([str(folder), known]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources, "FOLDER", folder)
        native._versions.cache_clear()
        yield folder
    ca.GlobalOptions.setCasadiPath(known)
    native._versions.cache_clear()


@pytest.fixture(scope="module", autouse=True)
def kernels(tmp_path_factory):
    """A library with the one kernel of these tests, in place of that of the package."""
    folder = tmp_path_factory.mktemp("kernels")
    for file in (PACKAGE / "kernels.h", PACKAGE / "bridge.c", Path(__file__).with_name("ranked.c")):
        shutil.copy(file, folder)
    with kernels_in(folder):
        defined = ["-DKERNELS=X(ranked)", f"-DSOURCES={sources.fingerprint()}"]
        target = folder / f"{library.NAME}{importlib.machinery.EXTENSION_SUFFIXES[0]}"
        files = [str(folder / f) for f in ("bridge.c", "ranked.c")]
        compiled("-shared", "-fPIC", *defined, *files, "-o", str(target))
        yield folder


def ranked(x, shift):
    return foreign.call("ranked", (N,), inputs=[x, shift], outputs=[(N, 1), (1, 1)])


def everywhere() -> Recursion:
    """Calls in a counted loop, in one with a condition, and outside of loops."""
    x, shift, u = ca.MX.sym("x", N), ca.MX.sym("shift"), ca.MX.sym("u")
    moved, exchanges = ranked(ca.vertcat(x[1:], ca.sin(x[0] + u)), shift)
    body = ca.Function("body", [x, u, shift], [ca.tanh(moved), exchanges, moved])
    go, count = ca.MX.sym("go"), ca.MX.sym("count")
    # The shift has no entries, and nobody asks for the exchanges.
    up, _ = ranked(x, ca.MX(1, 1))
    turned = 1.1 * ca.vertcat(up[:0:-1], up[0] - 1)
    step = ca.Function("turn", [go, x, count], [ca.sumsqr(turned) < 400, turned, count + 1])

    c, y = ca.MX.sym("carry", N), ca.MX.sym("y")
    us = y * ca.MX(ca.DM(range(4)).T)
    (end,), (exchanged, stack) = scan(body, 4, carry=[c], xs=[us], constants=[0.1 * y])
    _, far, passes = iterate(step, 30, carry=[ca.MX(1), end, ca.MX(0)])
    last, swaps = ranked(far[::-1], y)
    outputs = [ca.vec(exchanged), ca.vec(stack), far, passes, swaps]
    return recursion(ca.Function("everywhere", [c, y], [ca.tanh(last), *outputs]))


def test_kernel_alone():
    x, shift = ca.MX.sym("x", N), ca.MX.sym("shift")
    f = ca.Function("f", [x, shift], ranked(x, shift))
    values = np.random.default_rng(0).standard_normal(N)
    got, exchanges = f(values, 10)
    order = np.argsort(values)
    np.testing.assert_array_equal(np.asarray(got)[:, 0], values[order] + 10 * order)
    inversions = sum(values[i] > values[k] for k in range(N) for i in range(k))
    assert float(exchanges) == inversions


def test_native_is_vm():
    r = everywhere()
    data = data_for(r, 200)
    carry, outputs = native.run(r, data, carry=r.carry0)
    expected, reference = vm.run(r, data, carry=r.carry0)
    np.testing.assert_allclose(carry, expected, rtol=1e-12, atol=1e-12)
    for output, wanted in zip(outputs, reference, strict=True):
        assert_close(output, wanted, 1e-12)
    assert len(np.unique(outputs[3])) > 2, "all samples took the same number of passes"


@pytest.mark.parametrize("width", [4, 8])
def test_lanes_are_single_runs(width, monkeypatch):
    monkeypatch.setattr(machine, "widest", lambda: width)
    r = everywhere()
    data = [data_for(r, n, seed=n) for n in (30, 1, 17, 44, 0, 29, 30, 8, 9)]
    outcomes = lanes.run_many(r, data, carries=[r.carry0] * len(data))
    for one, (end, outputs) in zip(data, outcomes, strict=True):
        expected, alone = native.run(r, one, carry=r.carry0)
        np.testing.assert_allclose(end, expected, rtol=1e-12, atol=1e-12)
        for output, wanted in zip(outputs, alone, strict=True):
            np.testing.assert_allclose(output, wanted, rtol=1e-12, atol=1e-12)


def test_work_space_that_is_the_callers():
    n = 3000
    x = ca.MX.sym("x", n)
    up, exchanges = foreign.call("ranked", (n,), inputs=[x, ca.MX(1)], outputs=[(n, 1), (1, 1)])
    r = recursion(ca.Function("large", [x, ca.MX.sym("y")], [ca.sin(up), exchanges]))
    data = data_for(r, 2)
    wanted = vm.run(r, data, carry=r.carry0)[1][0]
    np.testing.assert_array_equal(native.run(r, data, carry=r.carry0)[1][0], wanted)
    for _, outputs in lanes.run_many(r, [data] * 3, carries=[r.carry0] * 3):
        np.testing.assert_array_equal(outputs[0], wanted)


OTHER_PROCESS = """
import pickle, sys
from pathlib import Path
from typing import ClassVar
from backsight.kernels import sources
sources.FOLDER = Path(sys.argv[1])
from backsight.engine import native, vm
native.walk = None
r, data = pickle.load(open(sys.argv[2], "rb"))
results = [engine.run(r, data, carry=r.carry0)[1] for engine in (vm, native)]
pickle.dump(results, open(sys.argv[2], "wb"))
"""


def test_other_process_takes_pickle_and_machine_code(kernels, tmp_path, monkeypatch):
    monkeypatch.setenv("BACKSIGHT_CACHE", str(tmp_path / "programs"))
    native._compiled.cache_clear()
    with kernels_in(shutil.copytree(kernels, tmp_path / "elsewhere")) as elsewhere:
        r, file = everywhere(), tmp_path / "pickle"
    shutil.rmtree(elsewhere)
    data = data_for(r, 20)
    expected = native.run(r, data, carry=r.carry0)[1]
    file.write_bytes(pickle.dumps((r, data)))
    command = [sys.executable, "-c", OTHER_PROCESS, str(kernels), str(file)]
    subprocess.run(command, check=True)
    by_vm, by_native = pickle.loads(file.read_bytes())
    for output, near, same in zip(expected, by_vm, by_native, strict=True):
        assert_close(near, output, 1e-12)
        np.testing.assert_array_equal(same, output)


@dataclasses.dataclass(frozen=True)
class Ranked(AbstractEstimator):
    """What the export needs of an estimator."""

    title: ClassVar[str] = "Sorted measurements"

    def build(self, model, dt):
        c, u, y, mask = (ca.MX.sym(s, n) for s, n in zip("cuym", (N, 1, 2, 2), strict=True))
        x, shift = ca.MX.sym("x", N), ca.MX.sym("shift")
        body = ca.Function("body", [x, shift], ranked(ca.vertcat(x[3:], x[:3] / 2), shift))
        start = c / 3 + ca.vertcat(y * mask, u, 1, -1)
        (end,), (exchanges,) = scan(body, 3, carry=[start], constants=[u / 10])
        step = ca.Function("sorting", [c, u, y, mask], [end, end, exchanges.T])
        return Recursion(step, np.zeros(N), (Channel("sorted"), Channel("exchanges")), dt)


def size_of_workspace(folder):
    """What the compiler says."""
    (folder / "size.c").write_text(
        '#include <stdio.h>\n#include "sorting.h"\n'
        "int main(void)\n{\n"
        '    printf("%d", (int)sizeof(sorting_workspace));\n    return 0;\n}\n'
    )
    compiled(str(folder / "size.c"), "-o", str(folder / "size"))
    return int(subprocess.run([str(folder / "size")], capture_output=True, text=True).stdout)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_c_export(precision, tmp_path):
    problem = TrialProblem()
    recording = problem.simulate(60, seed=5, hold="zoh", noisy=True).recording(problem.model)
    export_c(Ranked(), problem.model, recording, tmp_path, name="sorting", precision=precision)
    assert (tmp_path / "ranked.c").read_text() == (sources.FOLDER / "ranked.c").read_text()
    code = (tmp_path / "sorting.c").read_text()
    assert "double" not in code
    files = [str(tmp_path / f) for f in ("sorting.c", "sorting_selftest.c")]
    compiled("-O1", *files, "-lm", "-o", str(tmp_path / "selftest"))
    ran = subprocess.run([str(tmp_path / "selftest")], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout
    readme = (tmp_path / "README.md").read_text()
    assert "`ranked.c`, which `sorting.c` includes" in readme
    assert int(re.findall(r"(\d+) bytes workspace", readme)[0]) == size_of_workspace(tmp_path)
    with pytest.raises(EngineError, match="'ranked' is the name of a file of the export"):
        export_c(Ranked(), problem.model, recording, tmp_path, name="ranked")


def test_sources_of_the_package_are_strict(tmp_path):
    for file in sorted(PACKAGE.glob("*.c")):
        code = file.read_text(encoding="utf-8")
        assert not [word for word in ("malloc", "calloc", "free(", "printf") if word in code]
        if file.stem != sources.BRIDGE:
            for precision in ([], ["-DBACKSIGHT_FLOAT", "-Wdouble-promotion"]):
                compiled("-O2", *precision, "-c", str(file), "-o", str(tmp_path / "object"))


def test_what_is_wrong_is_said(kernels, tmp_path, monkeypatch):
    x = ca.MX.sym("x", N)
    with pytest.raises(EngineError, match="no kernel 'rankd': did you mean 'ranked'"):
        foreign.call("rankd", (N,), inputs=[x], outputs=[(N, 1)])
    with pytest.raises(EngineError, match="nothing may be empty"):
        foreign.call("ranked", (N,), inputs=[x], outputs=[(N, 0)])
    r = everywhere()
    copy = shutil.copytree(kernels, tmp_path / "copy")
    with monkeypatch.context() as patch:
        patch.setattr(sources, "FOLDER", copy)
        with pytest.raises(EngineError, match="takes the C kernels from another file than"):
            everywhere()
    with kernels_in(copy):
        (copy / "ranked.c").write_text("other")
        with pytest.raises(EngineError, match="compiled from other sources: install a C compiler"):
            native.run(r, data_for(r, 1), carry=r.carry0)
        library.path().unlink()
        with pytest.raises(EngineError, match="are not compiled: install a C compiler"):
            everywhere()
