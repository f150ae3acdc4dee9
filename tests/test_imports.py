"""What is imported when: nothing heavy before it is used."""

import ast
import importlib
import pickle
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from benchmarks.live_start import PROBLEM

import backsight
from backsight.doors import homes

DRAWING = ("matplotlib", "plotly")
HEAVY = ("casadi", "numpy", "scipy", "xarray", "pandas", "llvmlite", *DRAWING)


def packages() -> list[str]:
    """Packages that have a table of what they hand on."""
    root = Path(str(backsight.__file__)).parent
    found = (table.parent.relative_to(root.parent) for table in root.rglob("__init__.pyi"))
    return sorted(".".join(folder.parts) for folder in found)


def imported_by(code: str) -> set[str]:
    """Those of the heavy packages that a new process has imported after some code."""
    ask = f"import sys; print(*(m for m in {(*HEAVY, 'typer')!r} if m in sys.modules))"
    command = [sys.executable, "-c", f"{code}\n{ask}"]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    return set(found.stdout.split())


def public(package: ModuleType) -> dict[str, str]:
    """Public names of a package and their modules as type checkers see them."""
    file = Path(str(package.__file__)).with_suffix(".pyi")
    tree = ast.parse(file.read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {a.asname: n.module or "" for n in imports for a in n.names if a.asname}


@pytest.mark.parametrize(
    ("code", "missing"),
    [
        ("import backsight; dir(backsight)", (*HEAVY, "typer")),
        ("from backsight.cli import app", HEAVY),
        ("from backsight import estimate, EKF", (*DRAWING, "llvmlite", "typer")),
        ("from backsight.run.estimation import compile_once", ("xarray", "pandas", "llvmlite")),
    ],
)
def test_nothing_heavy_before_it_is_used(code, missing):
    assert not imported_by(code) & set(missing)


@pytest.mark.parametrize("name", packages())
def test_lazy_names_are_those_of_the_type_checker(name):
    package = importlib.import_module(name)
    names = public(package)
    assert len(names) > 10
    assert names == homes(package.__path__[0])
    assert set(names) <= set(dir(package))
    for name, module in names.items():
        found = getattr(package, name)
        assert found is getattr(sys.modules[module], name)


def test_what_runs_live_waits_for_no_library_of_recordings(tmp_path):
    """Between a kill and the next estimate are imports, most of all."""
    file = tmp_path / "live.toml"
    file.write_text(PROBLEM.format(port=0), encoding="utf-8")
    code = (
        "from pathlib import Path; from backsight.live import load_live, made_ready; "
        f"made_ready(load_live(Path({str(file)!r})), engine='vm')"
    )
    assert not imported_by(code) & {"xarray", "pandas", "typer", *DRAWING}


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
