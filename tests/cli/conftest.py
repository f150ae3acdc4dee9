"""Run the command line in this process."""

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import small_problem
from backsight.cli import app


@pytest.fixture
def backsight():
    """``backsight("run", path)``: exit code, standard output and standard error."""

    def call(*arguments: object) -> tuple[int, str, str]:
        result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
        return result.exit_code, result.stdout, result.stderr

    return call


@pytest.fixture
def refused(backsight, tmp_path) -> Callable[..., str]:
    """Run a problem that is at fault; return the one line that says so."""

    def call(text: str = small_problem.TEXT, *, out: Path | None = None) -> str:
        path = tmp_path / "problem.toml"
        if not (tmp_path / "spring.csv").exists():
            small_problem.write(tmp_path)
        path.write_text(text, encoding="utf-8")
        before = sorted(p.name for p in tmp_path.rglob("*"))
        code, printed, told = backsight("run", path, "--out", out or tmp_path / "out")
        assert code == 2
        assert printed == ""
        assert told.count("\n") == 1
        assert told.startswith("backsight: ")
        assert sorted(p.name for p in tmp_path.rglob("*")) == before
        return told

    return call
