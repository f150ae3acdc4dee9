"""An installation made without a C compiler: it says at once what it lacks, and does the rest."""

from pathlib import Path

import numpy as np
import pytest

import backsight as bs
from backsight.errors import EngineError
from backsight.estimators import ESTIMATORS
from backsight.kernels import sources

EXAMPLES = Path(__file__).parents[2] / "examples"
MISSING = "the C kernels of Backsight are not compiled: install a C compiler"


@pytest.fixture
def no_kernels(tmp_path, monkeypatch):
    """The package as it is where nothing could be compiled."""
    (tmp_path / "kernels").mkdir()
    monkeypatch.setattr(sources, "FOLDER", tmp_path / "kernels")


@pytest.mark.parametrize("command", [("check",), ("run", "--out", "out")])
@pytest.mark.usefixtures("no_kernels")
def test_a_problem_that_needs_them_is_refused_in_one_line(
    backsight, tmp_path, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    code, printed, told = backsight(*command, EXAMPLES / "beam" / "problem.toml")
    assert (code, printed, told.count("\n")) == (2, "", 1)
    assert told.startswith(f"backsight: estimators.CS-MHE: {MISSING}")
    assert not Path("out").exists()


@pytest.mark.usefixtures("no_kernels")
def test_the_estimator_is_refused_when_it_is_built():
    with pytest.raises(EngineError, match=MISSING):
        bs.CompressiveSensingMHE(
            bs.Noise(sigma_y=1.0), bs.Prior(sigma_x0=1.0), forces=("F",), lam=1.0
        )


@pytest.mark.parametrize("there", [True, False])
def test_the_list_of_methods_marks_what_is_missing(backsight, request, there):
    if not there:
        request.getfixturevalue("no_kernels")
    code, printed, _ = backsight("methods")
    blocks = {key: block for block in printed.split("\n\n") for key in [block.split('"')[1]]}
    assert code == 0
    assert sorted(blocks) == sorted(ESTIMATORS)
    marked = {key for key, block in blocks.items() if f"# not available: {MISSING}" in block}
    assert marked == (set() if there else {k for k, kind in ESTIMATORS.items() if kind.kernels})


def test_every_kernel_is_told_by_an_estimator():
    """So that none can be missing without a word; those of matrices are for many states only."""
    told = {kernel for kind in ESTIMATORS.values() for kernel in kind.kernels}
    of_matrices = {file.stem for file in sources.kernel_files() if file.parent.name == "matrix"}
    assert told | of_matrices == set(sources.names())
    assert not told & of_matrices


@pytest.mark.usefixtures("no_kernels")
def test_a_model_of_many_states_is_refused_when_the_estimator_is_built():
    n = 14
    states, outputs = ({f"{k}{i}": "" for i in range(n)} for k in "xy")
    model = bs.lti(
        0.5 * np.eye(n), np.zeros((n, 0)), np.eye(n), states=states, inputs={}, outputs=outputs,
        dt=0.1,
    )  # fmt: skip
    kf = bs.KalmanFilter(bs.Noise(sigma_y=1.0, Q=np.eye(n)), bs.Prior(sigma_x0=1.0))
    with pytest.raises(EngineError, match=MISSING):
        kf.compile(model, 0.1)
