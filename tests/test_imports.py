"""What is imported when: nothing heavy before it is used."""

import ast
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import backsight

DRAWING = ("matplotlib", "plotly")
HEAVY = ("casadi", "numpy", "scipy", "xarray", "pandas", "llvmlite", *DRAWING)


def imported_by(code: str) -> set[str]:
    """Those of the heavy packages that a new process has imported after some code."""
    ask = f"import sys; print(*(m for m in {(*HEAVY, 'typer')!r} if m in sys.modules))"
    command = [sys.executable, "-c", f"{code}\n{ask}"]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    return set(found.stdout.split())


def public() -> dict[str, str]:
    """Public names and their modules as type checkers see them."""
    tree = ast.parse(Path(backsight.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {a.asname: n.module or "" for n in imports for a in n.names if a.asname}


@pytest.mark.parametrize(
    ("code", "missing"),
    [
        ("import backsight; dir(backsight)", (*HEAVY, "typer")),
        ("from backsight.cli import app", HEAVY),
        ("from backsight import estimate, EKF", (*DRAWING, "llvmlite", "typer")),
    ],
)
def test_nothing_heavy_before_it_is_used(code, missing):
    assert not imported_by(code) & set(missing)


def test_lazy_names_are_those_of_the_type_checker():
    names = public()
    assert len(names) > 35
    assert set(names) <= set(dir(backsight))
    for name, module in names.items():
        found = getattr(backsight, name)
        assert found is getattr(sys.modules[module], name)
    assert names == backsight._HOMES


def test_the_function_hides_the_folder_of_the_same_name():
    assert "xarray" in imported_by(
        "import backsight.report.page; assert callable(backsight.report)"
    )


def test_names_pickle_by_the_module_they_live_in():
    assert pickle.loads(pickle.dumps(backsight.EKF)) is backsight.EKF
    assert backsight.EKF.__module__ == "backsight.estimators.kalman.ekf"


def test_a_name_that_does_not_exist():
    with pytest.raises(AttributeError, match="module 'backsight' has no attribute 'EFK'"):
        getattr(backsight, "E" + "FK")
    with pytest.raises(ImportError, match="cannot import name 'EFK'"):
        exec("from backsight import EFK")
    assert backsight.__version__
