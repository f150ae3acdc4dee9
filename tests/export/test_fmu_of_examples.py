"""FMUs of the examples, over their whole recordings."""

import shutil
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
@pytest.mark.parametrize("example", ["beam", "motor", "quarter_car", "stage"])
def test_fmus_of_examples_equal_python(example, tmp_path):
    problem = load(EXAMPLES / example / "problem.toml")
    recording = recording_of(problem)
    assert problem.estimators
    for number, estimator in enumerate(problem.estimators.values()):
        file = export_fmu(estimator, problem.model, recording, tmp_path / f"e{number}.fmu")
        assert validate_fmu(str(file)) == []
        assert file.stat().st_size <= LARGEST
        agrees(file, estimator, problem.model, recording)
