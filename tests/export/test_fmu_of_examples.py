"""FMUs of the examples, over their whole recordings."""

import shutil
import zipfile
from pathlib import Path

import pytest

from backsight.export import export_fmu
from backsight.problem import load
from backsight.problem.recorded import recording_of

pytest.importorskip("fmpy")
from fmpy.validation import validate_fmu
from tests.export.fmus import agrees

EXAMPLES = Path(__file__).parents[2] / "examples"
LARGEST = 300_000  # bytes

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler called cc")


@pytest.mark.slow
@pytest.mark.parametrize(
    "example",
    ["beam", "bridge", "frame", "motor", "quarter_car", "rotor", "stage", "storeys"],
)
def test_fmus_of_examples_equal_python(example, tmp_path):
    problem = load(EXAMPLES / example / "problem.toml")
    recording = recording_of(problem)
    assert problem.estimators
    for number, estimator in enumerate(problem.estimators.values()):
        file = export_fmu(estimator, problem.model, recording, tmp_path / f"e{number}.fmu")
        assert validate_fmu(str(file)) == []
        assert file.stat().st_size <= LARGEST
        agrees(file, estimator, problem.model, recording)


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["aarch64-linux", "x86_64-windows"])
@pytest.mark.parametrize(("example", "name"), [("motor", "MHE"), ("beam", "CS-MHE")])
def test_fmus_for_other_platforms_are_small(example, name, platform, tmp_path):
    pytest.importorskip("ziglang")
    problem = load(EXAMPLES / example / "problem.toml")
    file = export_fmu(
        problem.estimators[name],
        problem.model,
        recording_of(problem),
        tmp_path / "it.fmu",
        platforms=[platform],
    )
    assert validate_fmu(str(file)) == []
    assert file.stat().st_size <= LARGEST
    with zipfile.ZipFile(file) as archive:
        (library,) = [n for n in archive.namelist() if n.startswith(f"binaries/{platform}/")]
        begin = archive.read(library)[:4]
    assert begin[:2] == (b"\x7fE" if platform.endswith("linux") else b"MZ")
