"""Problem files of the examples: tuned by the command, and they say so."""

import os
import shutil
import tomllib
from pathlib import Path

import pytest

from backsight.problem import load, tune_problem
from extensions.distributions import install_project

EXAMPLES = Path(__file__).parents[2] / "examples"


def of_the_command(file):
    """Whether there is something to tune: a file for live has no recording to tune by, and hits
    that are followed have no weight."""
    table = tomllib.loads(file.read_text("utf-8"))
    return "recording" in table and not all("follow" in e for e in table["estimators"].values())


FILES = sorted(
    f"{file.parent.name}/{file.name}" for file in EXAMPLES.glob("*/*.toml") if of_the_command(file)
)


def test_they_say_what_was_found():
    assert len(FILES) > 10
    for name in FILES:
        text = (EXAMPLES / name).read_text("utf-8")
        table = tomllib.loads(text)["tune"]
        assert table["free"], name
        assert table["found"], name
        assert "backsight tune" in text, name


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_the_command_finds_it_again(name, tmp_path, monkeypatch):
    if name.startswith("extension/"):
        site = install_project(EXAMPLES / "extension", tmp_path / "site")
        monkeypatch.syspath_prepend(site)
    if "BACKSIGHT_DATA" not in os.environ and "BACKSIGHT_DATA" in (EXAMPLES / name).read_text():
        pytest.skip("needs the recordings of nonlinearbenchmark.org")
    folder = shutil.copytree((EXAMPLES / name).parent, tmp_path / "example")
    problem = load(folder / Path(name).name)
    again = tune_problem(problem, folder / "again.toml").tuned
    found = tomllib.loads((EXAMPLES / name).read_text("utf-8"))["tune"]["found"]
    assert set(found) == {*again.values, *again.chosen}
    for key, was in found.items():
        if key in again.values:
            assert abs(again.values[key] - was["value"]) < 0.3 * was["std"] + 1e-4 * was["value"]
