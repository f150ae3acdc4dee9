"""Exported windows with limits and of nonlinear models: right, and never out of bounds."""

import dataclasses
import shutil
import subprocess

import pytest
from tests.export.hardened import FUZZ, filled

import backsight as bs
from estimators import struck
from export.test_hardening import compare, exported
from run.test_nonlinear_sparse_forces import KNOWING, recording, structure

LIMIT = bs.settings.Limit


def limited():
    of = struck.system()
    u, y = struck.record(of, 30, seed=1)
    data = bs.from_arrays(
        u=u, y=y, dt=struck.DT, inputs={"f": "N"}, outputs={"y": "m", "z": "m"}
    )  # fmt: skip
    made = bs.CompressiveSensingMHE(
        **struck.gaussians(of), forces=struck.FORCES, lam=0.6, N=4, sigma_force=struck.SIGMA_FORCE,
        threshold=0.5, largest=3.0, carryover=bs.forces.Carryover((2.0, 30.0), change=0.5),
        limits=(
            LIMIT("a", {"a": 1.0}, lower=-0.006, upper=0.004),
            LIMIT("n", {"va": 1.0}, lower=-4e-4, upper=4e-4, of="noise"),
            LIMIT("r", {"y": 1.0}, lower=-4e-4, upper=4e-4, of="residual"),
        ),
    )  # fmt: skip
    return made, struck.model(of), data


def chosen():
    made, model, data = limited()
    plain = {"limits": (), "carryover": None, "largest": float("inf")}
    return dataclasses.replace(made, refinement=bs.forces.Exchanges(), **plain), model, data


def shrunk():
    made, model, data = chosen()
    how = bs.forces.Reweighting(groups=(struck.FORCES[:2],))
    return dataclasses.replace(made, refinement=how, nonnegative=struck.FORCES[:1]), model, data


def bent():
    stiff = LIMIT("k", {"k": 1.0}, lower=0.2, upper=3.0)
    made = dataclasses.replace(KNOWING, N=4, limits=(stiff,), largest=20.0)
    return made, structure(joint=True), recording()[0]


@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("make")), reason="needs gcc and make")
@pytest.mark.parametrize("case", [limited, bent, chosen, shrunk], ids=lambda case: case.__name__)
def test_exported_windows(case, tmp_path):
    code = exported(case(), tmp_path)
    (tmp_path / "main.c").write_text(filled(FUZZ, "it", code))
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g0"]
    compile_it = ["gcc", "-std=c99", "-O1", *checks, "it.c", "main.c", "-o", "main", "-lm"]
    for command in (compile_it, ["./main"], ["make", "test"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
@pytest.mark.parametrize("case", [chosen, shrunk], ids=lambda case: case.__name__)
def test_a_window_costs_at_most_what_is_told(case, tmp_path):
    compare(exported(case(), tmp_path), tmp_path, close=False)
