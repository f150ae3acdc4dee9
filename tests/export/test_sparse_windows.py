"""Exported windows with limits and of nonlinear models: right, and never out of bounds."""

import dataclasses
import shutil
import subprocess

import pytest
from tests.export.hardened import FUZZ, filled

import backsight as bs
from backsight.export import export_c
from backsight.export._written import code_of
from estimators import struck
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


def bent():
    stiff = LIMIT("k", {"k": 1.0}, lower=0.2, upper=3.0)
    made = dataclasses.replace(KNOWING, N=4, limits=(stiff,), largest=20.0)
    return made, structure(joint=True), recording()[0]


@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("make")), reason="needs gcc and make")
@pytest.mark.parametrize("case", [limited, bent], ids=["limited", "bent"])
def test_exported_windows(case, tmp_path):
    made, model, data = case()
    export_c(made, model, data, tmp_path, name="win", precision="double")
    code = code_of(made, model, data, name="win", precision="double", names=None, restart=False)
    (tmp_path / "main.c").write_text(filled(FUZZ, "win", code))
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g0"]
    compile_it = ["gcc", "-std=c99", "-O1", *checks, "win.c", "main.c", "-o", "main", "-lm"]
    for command in (compile_it, ["./main"], ["make", "test"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
